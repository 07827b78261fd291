// What the files that talk to ITK share. Include it first: it stands before ITK's own headers.
#pragma once

#ifdef __clang__  // Debian's ITK asks for gcc; this stands for its compiler test
#define ITK_COMPILER_DETECTION_H
#define ITK_NOEXCEPT noexcept
#endif
#include <itkImageIOBase.h>

#include <filesystem>
#include <string>

#include "scenarios/loader/image_io.h"

namespace sulcus {

itk::IOComponentEnum itk_component(VoxelType type);
VoxelType voxel_type(itk::IOComponentEnum component, const std::filesystem::path& path);

itk::ImageIORegion whole_region(const itk::ImageIOBase& io);
void set_geometry(const ImageGeometry& geometry, itk::ImageIOBase& io);  // size, spacing, origin, axes
std::string reason(const itk::ExceptionObject& error);                   // in one line

// Throws InputError with the remedy unless the numbers (mm) are a geometry that is accepted; then fills
// spacing, origin and direction.
void take_geometry(const std::filesystem::path& path, const Vec3& spacing_mm, const Vec3& origin_mm,
                   const Mat3& direction, ImageGeometry& geometry);
void check_voxel_count(const std::filesystem::path& path, const Index3& size);

// A DICOM series, a file a slice.
VoxelImage read_dicom_series(const std::filesystem::path& folder);
void write_dicom_series(const std::filesystem::path& folder, const VoxelImage& image);  // which exists, empty

}  // namespace sulcus
