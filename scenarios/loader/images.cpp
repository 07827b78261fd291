#include "scenarios/loader/images.h"

#ifdef __clang__  // Debian's ITK asks for gcc; this stands for its compiler test
#define ITK_COMPILER_DETECTION_H
#define ITK_NOEXCEPT noexcept
#endif
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "engine/numerics/error.h"
#include "scenarios/loader/image_files.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

itk::ImageIOBase::Pointer make_image_io(ImageFormat format) {
  itk::Object::SetGlobalWarningDisplay(false);  // ITK's remarks would go to the standard error
  if (format == ImageFormat::nrrd) return itk::NrrdImageIO::New().GetPointer();
  if (format == ImageFormat::meta) return itk::MetaImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

// First line of an exception's text that says something.
std::string reason(const itk::ExceptionObject& error) {
  std::string text = error.GetDescription();
  for (char& c : text) c = c == '\n' || c == '\r' ? ' ' : c;
  if (text.rfind("ITK ERROR: ", 0) == 0) text = text.substr(11);
  return text.substr(0, 300);
}

// The header's promises, each refused before memory is taken.
void check_header(const fs::path& path, ImageFormat format, const itk::ImageIOBase& io) {
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

  double voxels = 1;
  for (unsigned axis = 0; axis < 3; ++axis) voxels *= static_cast<double>(io.GetDimensions(axis));
  if (!(voxels >= 1)) throw InputError(place + "the image has no voxels");
  const std::string sizes = std::to_string(io.GetDimensions(0)) + " x " +
                            std::to_string(io.GetDimensions(1)) + " x " + std::to_string(io.GetDimensions(2));
  if (voxels > static_cast<double>(max_label_map_voxels)) {
    throw InputError(place + "the header promises " + sizes + " voxels; at most " +
                     std::to_string(max_label_map_voxels) + " are taken: crop or resample the image");
  }

  using Component = itk::IOComponentEnum;
  const Component type = io.GetComponentType();
  if (format == ImageFormat::nifti) {
    const NiftiHeader header = read_nifti_header(path);
    if ((header.slope != 0 && header.slope != 1) || (header.slope != 0 && header.shift != 0)) {
      throw InputError(place + "the header rescales the values (scl_slope " + std::to_string(header.slope) +
                       ", scl_inter " + std::to_string(header.shift) +
                       "); store the labels themselves, with slope 1 and intercept 0");
    }
  }
  if (type == Component::FLOAT || type == Component::DOUBLE || type == Component::LDOUBLE) {
    throw InputError(place + "voxels are floating-point numbers; store the labels as integers (int16, say)");
  }
  if (type == Component::UNKNOWNCOMPONENTTYPE) {
    throw InputError(place + "the type of the voxels is unknown; store the labels as integers (int16, say)");
  }

  require_data(path, find_image_data(path, format),
               static_cast<std::uint64_t>(voxels) * io.GetComponentSize());
}

// In a NIfTI image whose sform is set, that decides (ITK's choice between sform and qform differs between its
// versions).
void read_geometry(const fs::path& path, ImageFormat format, const itk::ImageIOBase& io, LabelMap& map) {
  std::optional<NiftiHeader::Affine> sform;
  if (format == ImageFormat::nifti) sform = read_nifti_header(path).sform;
  for (unsigned axis = 0; axis < 3; ++axis) {
    double spacing_mm = io.GetSpacing(axis), origin_mm = io.GetOrigin(axis);
    const std::vector<double> column = io.GetDirection(axis);
    Vec3 direction(column.at(0), column.at(1), column.at(2));
    if (sform) {
      spacing_mm = sform->step_mm.col(axis).norm();
      origin_mm = sform->origin_mm[axis];
      direction = sform->step_mm.col(axis) / spacing_mm;
    }
    if (!(spacing_mm >= 1e-3 && spacing_mm <= 1e3)) {
      throw InputError(path.string() + ": the spacing along axis " + std::to_string(axis) + " is " +
                       std::to_string(spacing_mm) + " mm; expected 0.001 to 1000 mm");
    }
    map.size[axis] = static_cast<int>(io.GetDimensions(axis));
    map.spacing[axis] = spacing_mm / 1000;
    map.origin[axis] = origin_mm / 1000;
    map.direction.col(axis) = direction;
  }
  const Mat3 product = map.direction.transpose() * map.direction;
  if (!map.origin.allFinite() || !((product - Mat3::Identity()).cwiseAbs().maxCoeff() <= 1e-4)) {
    throw InputError(
        path.string() +
        ": the image's axes are not orthonormal (a sheared image) or its origin is not finite; resample "
        "the label map onto a right-angled grid");
  }
}

template <class T>
void copy_labels(const std::vector<char>& bytes, const fs::path& path, LabelMap& map) {
  using Limits = std::numeric_limits<std::int32_t>;
  const T* values = reinterpret_cast<const T*>(bytes.data());
  for (std::size_t voxel = 0; voxel < map.labels.size(); ++voxel) {
    const T value = values[voxel];
    if (std::cmp_less(value, Limits::min()) || std::cmp_greater(value, Limits::max())) {
      throw InputError(path.string() + ": voxel " + std::to_string(voxel) + " has the label " +
                       std::to_string(value) + "; labels must lie within " + std::to_string(Limits::min()) +
                       " .. " + std::to_string(Limits::max()));
    }
    map.labels[voxel] = static_cast<std::int32_t>(value);
  }
}

void convert_labels(const std::vector<char>& bytes, itk::IOComponentEnum type, const fs::path& path,
                    LabelMap& map) {
  using Component = itk::IOComponentEnum;
  switch (type) {
    case Component::CHAR:
      return copy_labels<signed char>(bytes, path, map);
    case Component::UCHAR:
      return copy_labels<unsigned char>(bytes, path, map);
    case Component::SHORT:
      return copy_labels<short>(bytes, path, map);
    case Component::USHORT:
      return copy_labels<unsigned short>(bytes, path, map);
    case Component::INT:
      return copy_labels<int>(bytes, path, map);
    case Component::UINT:
      return copy_labels<unsigned>(bytes, path, map);
    case Component::LONG:
      return copy_labels<long>(bytes, path, map);
    case Component::ULONG:
      return copy_labels<unsigned long>(bytes, path, map);
    case Component::LONGLONG:
      return copy_labels<long long>(bytes, path, map);
    case Component::ULONGLONG:
      return copy_labels<unsigned long long>(bytes, path, map);
    default:
      throw InputError(path.string() + ": the voxels are no integers; store the labels as int16, say");
  }
}

itk::ImageIORegion whole_region(const itk::ImageIOBase& io) {
  itk::ImageIORegion region(io.GetNumberOfDimensions());
  for (unsigned axis = 0; axis < io.GetNumberOfDimensions(); ++axis) {
    region.SetIndex(axis, 0);
    region.SetSize(axis, io.GetDimensions(axis));
  }
  return region;
}

// The smallest type for the labels, and the labels in it.
template <class T>
std::vector<char> labels_as(const LabelMap& map) {
  std::vector<char> bytes(map.labels.size() * sizeof(T));
  T* values = reinterpret_cast<T*>(bytes.data());
  for (std::size_t voxel = 0; voxel < map.labels.size(); ++voxel)
    values[voxel] = static_cast<T>(map.labels[voxel]);
  return bytes;
}

}  // namespace

std::vector<fs::path> label_map_files(const fs::path& path) {
  const fs::path data = find_image_data(path, image_format(path)).file;
  if (data == path) return {path};
  return {path, data};
}

LabelMap read_label_map(const fs::path& path) {
  const ImageFormat format = image_format(path);
  find_image_data(path, format);  // refuses what is missing
  LabelMap map;
  try {
    const itk::ImageIOBase::Pointer io = make_image_io(format);
    if (!io->CanReadFile(path.string().c_str())) {
      throw InputError(path.string() + ": this is not what its name says (no valid header of that format)");
    }
    io->SetFileName(path.string());
    io->ReadImageInformation();
    check_header(path, format, *io);
    read_geometry(path, format, *io, map);
    const std::size_t voxels = map.index(0, 0, map.size[2]);
    std::vector<char> bytes(voxels * io->GetComponentSize());
    map.labels.resize(voxels);
    io->SetIORegion(whole_region(*io));
    io->Read(bytes.data());
    convert_labels(bytes, io->GetComponentType(), path, map);
  } catch (const itk::ExceptionObject& error) {
    throw InputError(path.string() + ": the image cannot be read; is it truncated or damaged? (" +
                     reason(error) + ")");
  } catch (const std::bad_alloc&) {
    throw InputError(path.string() + ": not enough memory for this image; crop or resample it");
  }
  if (std::none_of(map.labels.begin(), map.labels.end(), [](std::int32_t label) { return label != 0; })) {
    throw InputError(path.string() + ": every voxel has label 0 (empty); give a segmented image");
  }
  return map;
}

void write_label_map(const fs::path& path, const LabelMap& map) {
  const ImageFormat format = image_format(path);
  assert(map.labels.size() == map.index(0, 0, map.size[2]));
  const auto [low, high] = std::minmax_element(map.labels.begin(), map.labels.end());
  const bool as_uint8 = *low >= 0 && *high <= 255, as_int16 = *low >= -32768 && *high <= 32767;
  const std::vector<char> bytes = as_uint8   ? labels_as<std::uint8_t>(map)
                                  : as_int16 ? labels_as<std::int16_t>(map)
                                             : labels_as<std::int32_t>(map);
  // Written in a directory beside the target, then moved: data file first, header last.
  const fs::path parent = path.has_parent_path() ? path.parent_path() : fs::path(".");
  const fs::path workplace = parent / ("." + path.filename().string() + ".tmp");
  std::error_code ignored;
  try {
    fs::remove_all(workplace);
    fs::create_directory(workplace);
    const itk::ImageIOBase::Pointer io = make_image_io(format);
    io->SetFileName((workplace / path.filename()).string());
    io->SetNumberOfDimensions(3);
    for (unsigned axis = 0; axis < 3; ++axis) {
      io->SetDimensions(axis, static_cast<itk::SizeValueType>(map.size[axis]));
      io->SetSpacing(axis, map.spacing[axis] * 1000);
      io->SetOrigin(axis, map.origin[axis] * 1000);
      const Vec3 direction = map.direction.col(axis);
      io->SetDirection(axis, std::vector<double>{direction[0], direction[1], direction[2]});
    }
    io->SetPixelType(itk::IOPixelEnum::SCALAR);
    io->SetNumberOfComponents(1);
    io->SetComponentType(as_uint8   ? itk::IOComponentEnum::UCHAR
                         : as_int16 ? itk::IOComponentEnum::SHORT
                                    : itk::IOComponentEnum::INT);
    io->SetUseCompression(true);
    io->SetIORegion(whole_region(*io));
    io->WriteImageInformation();
    io->Write(bytes.data());

    std::vector<fs::path> files = label_map_files(workplace / path.filename());
    for (auto file = files.rbegin(); file != files.rend(); ++file)
      fs::rename(*file, parent / file->filename());
    fs::remove_all(workplace);
  } catch (const itk::ExceptionObject& error) {
    fs::remove_all(workplace, ignored);
    throw EnvironmentError(path.string() + ": the image cannot be written (" + reason(error) + ")");
  } catch (const fs::filesystem_error& error) {
    fs::remove_all(workplace, ignored);
    throw EnvironmentError(path.string() + ": the image cannot be written (" + error.code().message() +
                           "); check the directory and its free space");
  } catch (const InputError&) {
    fs::remove_all(workplace, ignored);
    throw EnvironmentError(path.string() + ": the image was not written completely; check the free space");
  }
}

}  // namespace sulcus
