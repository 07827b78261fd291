#include "scenarios/loader/images.h"

#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <string>
#include <utility>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

constexpr double deflate_limit = 1032;  // bytes that one byte of deflate can become, at most
constexpr std::uintmax_t max_text_header_bytes = 1 << 16;

enum class Format { nrrd, nifti, meta };

bool ends_with(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() &&
         text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

Format format_of(const fs::path& path) {
  const std::string name = lower(path.filename().string());
  if (ends_with(name, ".nrrd") || ends_with(name, ".nhdr")) return Format::nrrd;
  if (ends_with(name, ".mha") || ends_with(name, ".mhd")) return Format::meta;
  for (const char* ending : {".nii", ".nii.gz", ".hdr", ".img", ".hdr.gz", ".img.gz"}) {
    if (ends_with(name, ending)) return Format::nifti;
  }
  throw InputError(path.string() +
                   ": unknown image format; give a label map that ends in .nrrd, .nhdr, .nii, .nii.gz, .hdr, "
                   ".mha or .mhd");
}

itk::ImageIOBase::Pointer make_image_io(Format format) {
  itk::Object::SetGlobalWarningDisplay(false);  // ITK's remarks would go to the standard error
  if (format == Format::nrrd) return itk::NrrdImageIO::New().GetPointer();
  if (format == Format::meta) return itk::MetaImageIO::New().GetPointer();
  return itk::NiftiImageIO::New().GetPointer();
}

void require_file(const fs::path& path, const std::string& what) {
  std::error_code error;
  if (!fs::exists(path, error)) {
    std::string message = path.string() + ": " + what + " does not exist";
    if (path.string().find("/mricron/") != std::string::npos) {
      message += "; it belongs to the Debian package mricron-data (apt install mricron-data)";
    }
    throw InputError(message);
  }
  if (!fs::is_regular_file(path, error))
    throw InputError(path.string() + ": " + what + " is not a regular file");
  if (fs::file_size(path, error) == 0) throw InputError(path.string() + ": " + what + " is empty (0 bytes)");
  if (!std::ifstream(path))
    throw InputError(path.string() + ": " + what + " cannot be read; check its permissions");
}

// What the text header of an NRRD or MetaImage says about the place of its data.
struct DataPlace {
  fs::path file;              // of the data
  std::uintmax_t offset = 0;  // of the data in that file, if known
  bool raw = false;           // stored as it is, neither compressed nor text
};

DataPlace data_place(const fs::path& path, Format format) {
  std::ifstream stream(path, std::ios::binary);
  std::map<std::string, std::string> fields;
  std::string line;
  std::uintmax_t read = 0;
  while (read < max_text_header_bytes && std::getline(stream, line)) {
    read += line.size() + 1;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (format == Format::nrrd && line.empty()) break;
    const std::size_t mark = line.find(format == Format::nrrd ? ':' : '=');
    if (mark == std::string::npos) continue;
    const auto trimmed = [](const std::string& text) {
      const std::size_t first = text.find_first_not_of(" \t=");
      return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t") - first + 1);
    };
    fields[lower(trimmed(line.substr(0, mark)))] = trimmed(line.substr(mark + 1));
    if (format == Format::meta && lower(line).rfind("elementdatafile", 0) == 0) break;
  }
  DataPlace place;
  std::string name = fields[format == Format::meta ? "elementdatafile" : "data file"];
  if (format == Format::nrrd) {
    if (name.empty()) name = fields["datafile"];
    place.raw = lower(fields["encoding"]) == "raw";
  } else {
    place.raw = lower(fields["compresseddata"]) != "true" && lower(fields["binarydata"]) != "false";
  }
  if (name.empty() || lower(name) == "local") {
    place.file = path;
    place.offset = read;
  } else {
    if (lower(name).rfind("list", 0) == 0 || name.find('%') != std::string::npos) {
      throw InputError(path.string() + ": the data is spread over several files (" + name +
                       "); store it in one file");
    }
    place.file = path.parent_path() / name;
    require_file(place.file, "the data file that " + path.filename().string() + " names");
  }
  return place;
}

fs::path nifti_partner(const fs::path& path) {
  std::string name = path.string();
  for (const auto& [from, to] : {std::pair{".hdr", ".img"}, std::pair{".img", ".hdr"}}) {
    for (const char* zip : {"", ".gz"}) {
      if (ends_with(name, from + std::string(zip))) {
        return name.substr(0, name.size() - 4 - std::string(zip).size()) + to + zip;
      }
    }
  }
  return {};
}

// First line of an exception's text that says something.
std::string reason(const itk::ExceptionObject& error) {
  std::string text = error.GetDescription();
  for (char& c : text) c = c == '\n' || c == '\r' ? ' ' : c;
  if (text.rfind("ITK ERROR: ", 0) == 0) text = text.substr(11);
  return text.substr(0, 300);
}

// The header's promises, each refused before memory is taken.
void check_header(const fs::path& path, Format format, const itk::ImageIOBase& io) {
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
  if (format == Format::nifti) {
    const auto& nifti = dynamic_cast<const itk::NiftiImageIO&>(io);
    const double slope = nifti.GetRescaleSlope(), shift = nifti.GetRescaleIntercept();
    if ((slope != 0 && slope != 1) || (slope != 0 && shift != 0)) {
      throw InputError(place + "the header rescales the values (scl_slope " + std::to_string(slope) +
                       ", scl_inter " + std::to_string(shift) +
                       "); store the labels themselves, with slope 1 and intercept 0");
    }
  }
  if (type == Component::FLOAT || type == Component::DOUBLE || type == Component::LDOUBLE) {
    throw InputError(place + "voxels are floating-point numbers; store the labels as integers (int16, say)");
  }
  if (type == Component::UNKNOWNCOMPONENTTYPE) {
    throw InputError(place + "the type of the voxels is unknown; store the labels as integers (int16, say)");
  }

  const double promised = voxels * static_cast<double>(io.GetComponentSize());
  double available = 0, limit = deflate_limit;
  bool exact = false;
  if (format == Format::nifti) {
    for (const fs::path& file : label_map_files(path)) available += static_cast<double>(fs::file_size(file));
    exact = !ends_with(lower(path.string()), ".gz");
  } else {
    const DataPlace data = data_place(path, format);
    available = static_cast<double>(fs::file_size(data.file)) - static_cast<double>(data.offset);
    exact = data.raw;
  }
  if (exact) limit = 1;
  if (promised > available * limit) {
    throw InputError(place + "the header promises " + sizes + " voxels (" +
                     std::to_string(static_cast<std::int64_t>(promised)) + " bytes), but " +
                     std::to_string(static_cast<std::int64_t>(available)) + " bytes of " +
                     (exact ? "" : "compressed ") +
                     "data cannot hold them; the file is truncated or damaged");
  }
}

void read_geometry(const fs::path& path, const itk::ImageIOBase& io, LabelMap& map) {
  for (unsigned axis = 0; axis < 3; ++axis) {
    const double spacing_mm = io.GetSpacing(axis);
    if (!(spacing_mm >= 1e-3 && spacing_mm <= 1e3)) {
      throw InputError(path.string() + ": the spacing along axis " + std::to_string(axis) + " is " +
                       std::to_string(spacing_mm) + " mm; expected 0.001 to 1000 mm");
    }
    map.size[axis] = static_cast<int>(io.GetDimensions(axis));
    map.spacing[axis] = spacing_mm / 1000;
    map.origin[axis] = io.GetOrigin(axis) / 1000;
    const std::vector<double> direction = io.GetDirection(axis);
    for (unsigned row = 0; row < 3; ++row) map.direction(row, axis) = direction.at(row);
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
  const Format format = format_of(path);
  require_file(path, "the label map");
  fs::path partner;
  if (format == Format::nifti) {
    partner = nifti_partner(path);
    if (!partner.empty()) require_file(partner, "the other half of " + path.filename().string());
  } else {
    partner = data_place(path, format).file;
  }
  if (partner.empty() || partner == path) return {path};
  return {path, partner};
}

LabelMap read_label_map(const fs::path& path) {
  const Format format = format_of(path);
  label_map_files(path);  // refuses what is missing
  LabelMap map;
  try {
    const itk::ImageIOBase::Pointer io = make_image_io(format);
    if (!io->CanReadFile(path.string().c_str())) {
      throw InputError(path.string() + ": this is not what its name says (no valid header of that format)");
    }
    io->SetFileName(path.string());
    io->ReadImageInformation();
    check_header(path, format, *io);
    read_geometry(path, *io, map);
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
  const Format format = format_of(path);
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
