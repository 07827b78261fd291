// What the loader itself looks up in image files before ITK reads them: which files hold the image, where its
// data lies and whether it is all there (ITK reads truncated NIfTI and MetaImage files without a word), and
// the parts of a NIfTI header that readers interpret differently.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "engine/numerics/types.h"

namespace sulcus {

enum class ImageFormat { nrrd, nifti, meta };

// By the name's ending. Throws InputError for an unknown one.
ImageFormat image_format(const std::filesystem::path& path);

// Throws InputError, with a remedy, unless the path is a readable regular file that is not empty.
void require_file(const std::filesystem::path& path, const std::string& what);

enum class DataEncoding { raw, deflated, other };

struct ImageData {
  std::filesystem::path file;  // that holds the data
  DataEncoding encoding = DataEncoding::other;
  std::uint64_t file_offset = 0;    // bytes before the data or its compressed stream
  std::uint64_t stream_offset = 0;  // bytes before the data within the decompressed stream
};

// Throws InputError for files that are missing or spread over several data files.
ImageData find_image_data(const std::filesystem::path& path, ImageFormat format);

// Throws InputError unless the file holds at least `bytes` bytes of data; deflated data are inflated to the
// end of their stream (checksum included), a buffer at a time.
void require_data(const std::filesystem::path& path, const ImageData& data, std::uint64_t bytes);

struct NiftiHeader {
  double slope = 0, shift = 0;  // scl_slope, scl_inter
  double data_offset = 0;       // bytes, vox_offset
  unsigned bits = 0;            // of a voxel
  // sform, if its code says that it is set: millimetres, left-posterior-superior; column a = step along voxel
  // axis a.
  struct Affine {
    Mat3 step_mm;
    Vec3 origin_mm;
  };
  std::optional<Affine> sform;
};

// NIfTI-1 or NIfTI-2, either byte order, compressed or not. Throws InputError for anything else.
NiftiHeader read_nifti_header(const std::filesystem::path& path);

}  // namespace sulcus
