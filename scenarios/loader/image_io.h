// Images in files, whatever their voxels mean: NRRD (.nrrd, .nhdr), NIfTI (.nii, .nii.gz, .hdr/.img),
// MetaImage (.mha, .mhd) and DICOM series (a folder), through ITK.
//
// World coordinates are ITK's physical space (for NIfTI: LPS, +x left, +y posterior, +z up; the sform decides
// where it is set, else the qform), millimetres in the file, metres here: the only place where the two meet.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "engine/mesh/resample.h"

namespace sulcus {

inline constexpr std::int64_t max_image_voxels = std::int64_t{1} << 28;

enum class VoxelType { int8, uint8, int16, uint16, int32, uint32, int64, uint64, float32, float64 };

struct VoxelImage {
  ImageGeometry geometry;
  VoxelType type = VoxelType::uint8;
  std::vector<char> bytes;  // voxels of that type, i fastest
};

// Calls visit(T{}) with the C++ type of the voxels.
template <class Visit>
decltype(auto) visit_voxel_type(VoxelType type, Visit&& visit) {
  switch (type) {
    case VoxelType::int8:
      return visit(std::int8_t{});
    case VoxelType::uint8:
      return visit(std::uint8_t{});
    case VoxelType::int16:
      return visit(std::int16_t{});
    case VoxelType::uint16:
      return visit(std::uint16_t{});
    case VoxelType::int32:
      return visit(std::int32_t{});
    case VoxelType::uint32:
      return visit(std::uint32_t{});
    case VoxelType::int64:
      return visit(std::int64_t{});
    case VoxelType::uint64:
      return visit(std::uint64_t{});
    case VoxelType::float32:
      return visit(float{});
    default:
      return visit(double{});
  }
}

// What the voxels are wanted for. Labels must be whole numbers as they stand in the file; grey values may be
// of any type, and are rescaled as a header says (scl_slope, RescaleSlope).
enum class ImageUse { labels, grey };

// Reads a three-dimensional scalar image; a folder is read as a DICOM series of grey values (one series,
// parallel slices at equal distances).
//
// The header is checked before memory is taken: a file that promises more than max_image_voxels, or more than
// its data holds, is refused; compressed data are inflated once for that, a buffer at a time, checksum
// included.
//
// Throws InputError, naming the file, what was found, what was expected and the remedy: missing file, unknown
// format, not three dimensions, no voxel, more than one component, spacing that is not positive and finite
// (accepted: 1e-3 to 1e3 mm), direction that is not orthonormal, truncated or damaged data; for labels,
// floating-point or rescaled voxels.
VoxelImage read_image(const std::filesystem::path& path, ImageUse use);

// Writes the image in the format that the name's ending says (.nrrd, .nii, .nii.gz, .mha, .mhd; no ending: a
// folder with a DICOM series); .nrrd, .nii.gz and .mha compressed. It appears under its name only when it is
// complete (.mhd: header and data file). A DICOM series holds 16 bits a voxel: whole numbers that fit are
// kept, others refused; floating-point ones are stored with a slope, exact to 1/65535 of their range.
//
// Throws InputError for an unknown ending, a type that the format does not hold, a folder that is not empty;
// EnvironmentError if writing fails.
void write_image(const std::filesystem::path& path, const VoxelImage& image);

// Throws what write_image would throw because of the name, before the work is done.
void check_image_name(const std::filesystem::path& path);

}  // namespace sulcus
