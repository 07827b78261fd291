// Two pictures compared as an eye would: distance of colours in CIELAB (CIE 1976 Delta E, white point D65),
// where about 2.3 is a just noticeable difference.
#pragma once

#include "verify/png.h"

namespace sulcus {

struct PictureDifference {
  double differing_fraction = 0;  // of the pixels whose distance exceeds the threshold, 0..1
  double max_distance = 0;        // largest Delta E of a pixel
  double mean_distance = 0;       // Delta E, over all pixels
  // Largest Delta E of the means of 4 x 4 pixels: hardly moved by an edge that shifts by a part of a pixel,
  // but by any thing that is missing, however small beside the picture.
  double max_block_distance = 0;
};

// CIE 1976 Delta E of two sRGB colours; 0 for equal ones, 100 from black to white.
double colour_distance(const std::uint8_t* rgb_a, const std::uint8_t* rgb_b);

// Throws InputError if the sizes differ, with both sizes.
PictureDifference compare_pictures(const Image& a, const Image& b, double threshold);

// The picture at 1/factor of its size, each pixel the mean of factor x factor (a last incomplete row or
// column is left out). Throws InputError for a factor below 1 or above the picture's size.
Image shrunk(const Image& image, int factor);

// Grey copy of `a` on which the distance to `b` glows, from the threshold (dark red) to 4 thresholds
// (yellow).
Image difference_picture(const Image& a, const Image& b, double threshold);

}  // namespace sulcus
