#include "scenarios/loader/image_io.h"

#include "scenarios/loader/image_itk.h"
// (ITK's readers stand behind what image_itk.h prepares)
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <cassert>
#include <cmath>
#include <iostream>
#include <optional>
#include <string>

#include "engine/numerics/error.h"
#include "scenarios/loader/image_files.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

// ITK's MetaImage reader explains itself on the standard error, beside the exception.
struct QuietErrors {
  QuietErrors() : before(std::cerr.rdbuf(nullptr)) {}
  ~QuietErrors() { std::cerr.rdbuf(before); }
  QuietErrors(const QuietErrors&) = delete;
  QuietErrors& operator=(const QuietErrors&) = delete;
  std::streambuf* before;
};

itk::ImageIOBase::Pointer make_image_io(ImageFormat format) {
  itk::Object::SetGlobalWarningDisplay(false);  // ITK's remarks would go to the standard error
  if (format == ImageFormat::nrrd) return itk::NrrdImageIO::New().GetPointer();
  if (format == ImageFormat::meta) return itk::MetaImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

Index3 size_of(const itk::ImageIOBase& io) {
  Index3 size;
  for (unsigned axis = 0; axis < 3; ++axis)
    size[axis] = static_cast<int>(std::min<itk::SizeValueType>(io.GetDimensions(axis), 1 << 30));
  return size;
}

// The header's promises, each refused before memory is taken.
void check_header(const fs::path& path, ImageFormat format, ImageUse use, const itk::ImageIOBase& io) {
  const std::string place = path.string() + ": ";
  const unsigned dimensions = io.GetNumberOfDimensions();
  for (unsigned axis = 3; axis < dimensions; ++axis) {
    if (io.GetDimensions(axis) != 1) {
      throw InputError(place + "the image has " + std::to_string(dimensions) +
                       " dimensions; give one three-dimensional label map");
    }
  }
  if (dimensions < 3) {
    throw InputError(place + "the image has " + std::to_string(dimensions) +
                     " dimensions; a label map has three");
  }
  if (io.GetNumberOfComponents() != 1) {
    throw InputError(place + "a voxel has " + std::to_string(io.GetNumberOfComponents()) +
                     " components; a label map has one number a voxel");
  }

  check_voxel_count(path, size_of(io));
  std::uint64_t stored_bytes = io.GetComponentSize();  // of a voxel in the file

  using Component = itk::IOComponentEnum;
  const Component type = io.GetComponentType();
  if (format == ImageFormat::nifti) {
    const NiftiHeader header = read_nifti_header(path);
    stored_bytes = header.bits / 8;
    if (use == ImageUse::labels &&
        ((header.slope != 0 && header.slope != 1) || (header.slope != 0 && header.shift != 0))) {
      throw InputError(place + "the header rescales the values (scl_slope " + std::to_string(header.slope) +
                       ", scl_inter " + std::to_string(header.shift) +
                       "); store the labels themselves, with slope 1 and intercept 0");
    }
  }
  if (use == ImageUse::labels &&
      (type == Component::FLOAT || type == Component::DOUBLE || type == Component::LDOUBLE)) {
    throw InputError(place + "voxels are floating-point numbers; store the labels as integers (int16, say)");
  }
  voxel_type(type, path);

  std::uint64_t voxels = 1;
  for (unsigned axis = 0; axis < 3; ++axis) voxels *= io.GetDimensions(axis);
  require_data(path, find_image_data(path, format), voxels * stored_bytes);
}

// In a NIfTI image whose sform is set, that decides (ITK's choice between sform and qform differs between its
// versions).
void read_geometry(const fs::path& path, ImageFormat format, const itk::ImageIOBase& io,
                   ImageGeometry& geometry) {
  std::optional<NiftiHeader::Affine> sform;
  if (format == ImageFormat::nifti) sform = read_nifti_header(path).sform;
  Vec3 spacing_mm, origin_mm;
  Mat3 direction;
  for (unsigned axis = 0; axis < 3; ++axis) {
    spacing_mm[axis] = io.GetSpacing(axis);
    origin_mm[axis] = io.GetOrigin(axis);
    const std::vector<double> column = io.GetDirection(axis);
    direction.col(axis) = Vec3(column.at(0), column.at(1), column.at(2));
    if (sform) {
      spacing_mm[axis] = sform->step_mm.col(axis).norm();
      origin_mm[axis] = sform->origin_mm[axis];
      direction.col(axis) = sform->step_mm.col(axis) / spacing_mm[axis];
    }
  }
  geometry.size = size_of(io);
  take_geometry(path, spacing_mm, origin_mm, direction, geometry);
}

VoxelImage read_single_file(const fs::path& path, ImageUse use) {
  const ImageFormat format = image_format(path);
  find_image_data(path, format);  // refuses what is missing, and NIfTI headers that are no such
  const QuietErrors quiet;
  VoxelImage image;
  try {
    const itk::ImageIOBase::Pointer io = make_image_io(format);
    if (!io->CanReadFile(path.string().c_str())) {
      throw InputError(path.string() + ": this is not what its name says (no valid header of that format)");
    }
    io->SetFileName(path.string());
    io->ReadImageInformation();
    check_header(path, format, use, *io);
    read_geometry(path, format, *io, image.geometry);
    image.type = voxel_type(io->GetComponentType(), path);
    image.bytes.resize(static_cast<std::size_t>(io->GetImageSizeInBytes()));
    io->SetIORegion(whole_region(*io));
    io->Read(image.bytes.data());
  } catch (const itk::ExceptionObject& error) {
    throw InputError(path.string() + ": the image cannot be read; is it truncated or damaged? (" +
                     reason(error) + ")");
  } catch (const std::bad_alloc&) {
    throw InputError(path.string() + ": not enough memory for this image; crop or resample it");
  }
  return image;
}

void write_single_file(const fs::path& path, const VoxelImage& image) {
  const itk::ImageIOBase::Pointer io = make_image_io(image_format(path));
  io->SetFileName(path.string());
  set_geometry(image.geometry, *io);
  io->SetPixelType(itk::IOPixelEnum::SCALAR);
  io->SetNumberOfComponents(1);
  io->SetComponentType(itk_component(image.type));
  io->SetUseCompression(true);
  io->SetIORegion(whole_region(*io));
  io->WriteImageInformation();
  io->Write(image.bytes.data());
}

bool names_a_folder(const fs::path& path) {
  return path.filename().empty() || path.extension().empty();
}

// The same without a slash at its end.
fs::path plain(const fs::path& path) {
  return path.filename().empty() ? path.parent_path() : path;
}

// Of an image that was just written.
fs::path data_file(const fs::path& path) {
  try {
    return find_image_data(path, image_format(path)).file;
  } catch (const InputError&) {
    throw EnvironmentError(path.string() + ": the image was not written completely; check the free space");
  }
}

}  // namespace

VoxelImage read_image(const fs::path& path, ImageUse use) {
  std::error_code ignored;
  if (use == ImageUse::grey && fs::is_directory(path, ignored)) return read_dicom_series(path);
  return read_single_file(path, use);
}

void check_image_name(const fs::path& path) {
  if (!names_a_folder(path)) {
    image_format(path);
    return;
  }
  std::error_code ignored;
  if (fs::exists(path, ignored) && !(fs::is_directory(path, ignored) && fs::is_empty(path, ignored))) {
    throw InputError(path.string() +
                     ": a name without an ending becomes a folder with a DICOM series, and this one exists "
                     "and is not an empty folder; give another name");
  }
}

void write_image(const fs::path& wanted, const VoxelImage& image) {
  check_image_name(wanted);
  const fs::path path = plain(wanted);
  // Written in a directory beside the target, then moved: data file first, header last.
  const fs::path parent = path.has_parent_path() ? path.parent_path() : fs::path(".");
  const fs::path workplace = parent / ("." + path.filename().string() + ".tmp");
  std::error_code ignored;
  try {
    fs::remove_all(workplace);
    fs::create_directory(workplace);
    if (names_a_folder(wanted)) {
      write_dicom_series(workplace, image);
      fs::remove(path);
      fs::rename(workplace, path);
      return;
    }
    write_single_file(workplace / path.filename(), image);
    const fs::path data = data_file(workplace / path.filename());
    if (data.filename() != path.filename()) fs::rename(data, parent / data.filename());
    fs::rename(workplace / path.filename(), path);
    fs::remove_all(workplace);
  } catch (const itk::ExceptionObject& error) {
    fs::remove_all(workplace, ignored);
    throw EnvironmentError(path.string() + ": the image cannot be written (" + reason(error) + ")");
  } catch (const fs::filesystem_error& error) {
    fs::remove_all(workplace, ignored);
    throw EnvironmentError(path.string() + ": the image cannot be written (" + error.code().message() +
                           "); check the directory and its free space");
  } catch (...) {
    fs::remove_all(workplace, ignored);
    throw;
  }
}

}  // namespace sulcus
