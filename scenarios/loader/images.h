// Label maps in files: NRRD (.nrrd, .nhdr), NIfTI (.nii, .nii.gz, .hdr/.img) and MetaImage (.mha, .mhd),
// through ITK.
//
// World coordinates are ITK's physical space (for NIfTI: LPS, +x left, +y posterior, +z up; the sform decides
// where it is set, else the qform), millimetres in the file, metres in the label map: the only place where
// the two meet.
#pragma once

#include <filesystem>
#include <vector>

#include "engine/volume/label_map.h"

namespace sulcus {

// Reads a three-dimensional scalar image of any integer type. A floating-point image is refused, whole
// numbers or not: labels that went through floating point may have been interpolated or rescaled. A NIfTI
// image whose header rescales its values (scl_slope, scl_inter other than 0, 0 or 1, 0) is refused for the
// same reason.
//
// The header is checked before memory is taken: a file that promises more than max_label_map_voxels, or more
// than its data holds, is refused; compressed data are inflated once for that, a buffer at a time, checksum
// included.
//
// Throws InputError, naming the file, what was found, what was expected and the remedy: missing file, unknown
// format, not three dimensions, no voxel, more than one component, values outside int32, spacing that is not
// positive and finite (accepted: 1e-3 to 1e3 mm), direction that is not orthonormal, truncated or damaged
// data.
LabelMap read_label_map(const std::filesystem::path& path);

inline constexpr std::int64_t max_label_map_voxels = std::int64_t{1} << 28;  // 1 GiB of labels

// The files that hold the image: the header, and its data file if that is another one (.nhdr, .mhd, .hdr).
// Throws InputError if one of them is missing.
std::vector<std::filesystem::path> label_map_files(const std::filesystem::path& path);

// Writes the map in the format that the name's ending says (.nrrd, .nii, .nii.gz, .mha, .mhd), in the
// smallest of uint8, int16, int32 that holds its labels; .nrrd, .nii.gz and .mha compressed. The file appears
// under its name only when it is complete (.mhd: header and data file). Throws InputError for an unknown
// ending, EnvironmentError if writing fails.
void write_label_map(const std::filesystem::path& path, const LabelMap& map);

}  // namespace sulcus
