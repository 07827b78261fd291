// Label maps in files: images whose voxels are labels (image_io.h).
#pragma once

#include <filesystem>
#include <vector>

#include "engine/volume/label_map.h"
#include "scenarios/loader/image_io.h"

namespace sulcus {

// Reads a three-dimensional scalar image of any integer type. A floating-point image is refused, whole
// numbers or not: labels that went through floating point may have been interpolated or rescaled. A NIfTI
// image whose header rescales its values (scl_slope, scl_inter other than 0, 0 or 1, 0) is refused for the
// same reason.
//
// Throws InputError as read_image does, and for values outside int32 and an image of only background.
LabelMap read_label_map(const std::filesystem::path& path);

// The files that hold the image: the header, and its data file if that is another one (.nhdr, .mhd, .hdr).
// Throws InputError if one of them is missing.
std::vector<std::filesystem::path> label_map_files(const std::filesystem::path& path);

// The map as an image, in the smallest of uint8, int16, int32 that holds its labels.
VoxelImage label_image(const LabelMap& map);

// A grey image with values of one type, rescaled as its header says.
struct GreyImage {
  ImageGeometry geometry;
  std::vector<float> values;  // [voxels], i fastest
};
GreyImage read_grey_image(const std::filesystem::path& path);  // throws as read_image does

// write_image(path, label_image(map))
void write_label_map(const std::filesystem::path& path, const LabelMap& map);

}  // namespace sulcus
