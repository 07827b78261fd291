#include "verify/picture_diff.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/numerics/error.h"

namespace sulcus {
namespace {

// sRGB transfer curve (IEC 61966-2-1), one value a byte.
const std::array<double, 256>& linear_light() {
  static const std::array<double, 256> table = [] {
    std::array<double, 256> values{};
    for (int byte = 0; byte < 256; ++byte) {
      const double share = byte / 255.0;
      values[static_cast<std::size_t>(byte)] =
          share <= 0.04045 ? share / 12.92 : std::pow((share + 0.055) / 1.055, 2.4);
    }
    return values;
  }();
  return table;
}

double lab_curve(double t) {
  constexpr double d = 6.0 / 29.0;
  return t > d * d * d ? std::cbrt(t) : t / (3 * d * d) + 4.0 / 29.0;
}

std::array<double, 3> to_lab(const std::uint8_t* rgb) {
  const auto& light = linear_light();
  const double r = light[rgb[0]], g = light[rgb[1]], b = light[rgb[2]];
  const double x = lab_curve((0.4124 * r + 0.3576 * g + 0.1805 * b) / 0.9505);
  const double y = lab_curve(0.2126 * r + 0.7152 * g + 0.0722 * b);
  const double z = lab_curve((0.0193 * r + 0.1192 * g + 0.9505 * b) / 1.0890);
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

void check_same_size(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.rgb.size() != b.rgb.size()) {
    throw InputError("pictures of " + std::to_string(a.width) + " x " + std::to_string(a.height) + " and " +
                     std::to_string(b.width) + " x " + std::to_string(b.height) +
                     " pixels cannot be compared; render both in one size");
  }
}

}  // namespace

double colour_distance(const std::uint8_t* rgb_a, const std::uint8_t* rgb_b) {
  if (std::equal(rgb_a, rgb_a + 3, rgb_b)) return 0;
  const auto a = to_lab(rgb_a), b = to_lab(rgb_b);
  const double dl = a[0] - b[0], da = a[1] - b[1], db = a[2] - b[2];
  return std::sqrt(dl * dl + da * da + db * db);
}

namespace {

constexpr int block = 4;  // pixels

double largest_distance(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t p = 0; p < a.rgb.size(); p += 3)
    largest = std::max(largest, colour_distance(&a.rgb[p], &b.rgb[p]));
  return largest;
}

}  // namespace

PictureDifference compare_pictures(const Image& a, const Image& b, double threshold) {
  check_same_size(a, b);
  PictureDifference difference;
  std::int64_t differing = 0;
  double sum = 0;
  const std::size_t pixels = a.rgb.size() / 3;
  for (std::size_t p = 0; p < pixels; ++p) {
    const double distance = colour_distance(&a.rgb[3 * p], &b.rgb[3 * p]);
    if (distance > threshold) ++differing;
    sum += distance;
    difference.max_distance = std::max(difference.max_distance, distance);
  }
  if (pixels > 0) {
    difference.differing_fraction = static_cast<double>(differing) / static_cast<double>(pixels);
    difference.mean_distance = sum / static_cast<double>(pixels);
    const int factor = std::min({block, a.width, a.height});
    difference.max_block_distance = largest_distance(shrunk(a, factor), shrunk(b, factor));
  }
  return difference;
}

Image difference_picture(const Image& a, const Image& b, double threshold) {
  check_same_size(a, b);
  Image picture = a;
  for (std::size_t p = 0; p < a.rgb.size() / 3; ++p) {
    const std::uint8_t* rgb = &a.rgb[3 * p];
    // Washed-out grey, so that the glow is the only colour.
    const int grey = (54 * rgb[0] + 183 * rgb[1] + 19 * rgb[2]) / 256;
    const auto pale = static_cast<std::uint8_t>(128 + grey / 2);
    std::array<std::uint8_t, 3> colour{pale, pale, pale};
    const double distance = colour_distance(rgb, &b.rgb[3 * p]);
    if (distance > threshold) {
      const double glow = threshold > 0 ? std::min(1.0, (distance / threshold - 1) / 3) : 1;
      colour = {static_cast<std::uint8_t>(150 + 105 * glow), static_cast<std::uint8_t>(210 * glow), 0};
    }
    std::copy(colour.begin(), colour.end(), &picture.rgb[3 * p]);
  }
  return picture;
}

Image shrunk(const Image& image, int factor) {
  if (factor < 1 || factor > image.width || factor > image.height) {
    throw InputError("picture of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                     " pixels cannot be shrunk " + std::to_string(factor) + " times");
  }
  Image small{image.width / factor, image.height / factor, {}};
  const int pixels = factor * factor;
  for (int y = 0; y < small.height; ++y) {
    for (int x = 0; x < small.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        int sum = pixels / 2;
        for (int dy = 0; dy < factor; ++dy) {
          for (int dx = 0; dx < factor; ++dx) {
            const auto at =
                (static_cast<std::size_t>(y * factor + dy) * static_cast<std::size_t>(image.width) +
                 static_cast<std::size_t>(x * factor + dx)) *
                    3 +
                static_cast<std::size_t>(c);
            sum += image.rgb[at];
          }
        }
        small.rgb.push_back(static_cast<std::uint8_t>(sum / pixels));
      }
    }
  }
  return small;
}

}  // namespace sulcus
