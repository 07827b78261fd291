// DICOM series: one file a slice, through ITK's GDCM.
#include "scenarios/loader/image_itk.h"
// (ITK's readers stand behind what image_itk.h prepares)
#include <gdcmTrace.h>
#include <itkGDCMImageIO.h>
#include <itkGDCMSeriesFileNames.h>
#include <itkMetaDataObject.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

constexpr double max_slice_offset = 0.01;  // of the distance between slices, from where it should be

// GDCM's remarks would go to the standard error.
void be_quiet() {
  gdcm::Trace::SetDebug(false);
  gdcm::Trace::SetWarning(false);
  gdcm::Trace::SetError(false);
}

Vec3 vector_of(const std::vector<double>& numbers) {
  return {numbers.at(0), numbers.at(1), numbers.at(2)};
}

Vec3 origin_mm(const itk::ImageIOBase& io) {
  return {io.GetOrigin(0), io.GetOrigin(1), io.GetOrigin(2)};
}

// The files of the one series in a folder, ordered along the slices' normal.
std::vector<std::string> series_files(const fs::path& folder) {
  const auto names = itk::GDCMSeriesFileNames::New();
  names->SetDirectory(folder.string());
  const std::vector<std::string>& series = names->GetSeriesUIDs();
  if (series.size() != 1) {
    throw InputError(folder.string() + ": " + std::to_string(series.size()) +
                     " DICOM series are in this folder; give one with the files of exactly one series");
  }
  return names->GetFileNames(series.front());
}

itk::GDCMImageIO::Pointer open_slice(const std::string& file) {
  const auto io = itk::GDCMImageIO::New();
  io->SetFileName(file);
  io->ReadImageInformation();
  if (io->GetNumberOfComponents() != 1) {
    throw InputError(file + ": a voxel has " + std::to_string(io->GetNumberOfComponents()) +
                     " components; give grey values");
  }
  if (io->GetDimensions(2) != 1) {
    throw InputError(file + ": it holds " + std::to_string(io->GetDimensions(2)) +
                     " slices; store one slice a file, or the image as .nrrd");
  }
  return io;
}

// Spacing and axes of the stack from its first slice, its last, and their number.
void stack_geometry(const fs::path& folder, const itk::ImageIOBase& first, const itk::ImageIOBase& last,
                    int slices, ImageGeometry& geometry) {
  Vec3 spacing_mm(first.GetSpacing(0), first.GetSpacing(1), first.GetSpacing(2));
  Mat3 direction;
  for (unsigned axis = 0; axis < 3; ++axis) direction.col(axis) = vector_of(first.GetDirection(axis));
  if (slices > 1) {
    const Vec3 step_mm = (origin_mm(last) - origin_mm(first)) / (slices - 1);
    spacing_mm[2] = step_mm.norm();
    direction.col(2) = step_mm / spacing_mm[2];
  }
  geometry.size = {static_cast<int>(std::min<itk::SizeValueType>(first.GetDimensions(0), 1 << 30)),
                   static_cast<int>(std::min<itk::SizeValueType>(first.GetDimensions(1), 1 << 30)), slices};
  check_voxel_count(folder, geometry.size);
  take_geometry(folder, spacing_mm, origin_mm(first), direction, geometry);
}

// An image that GDCM stores in 16 bits a voxel: whole numbers as they are, real ones as slope * stored +
// intercept.
struct Stored {
  VoxelType type = VoxelType::uint16;
  std::vector<char> bytes;
  double slope = 1, intercept = 0;
};

template <class To, class From>
std::vector<char> converted(const From* values, std::size_t count) {
  std::vector<char> bytes(count * sizeof(To));
  To* out = reinterpret_cast<To*>(bytes.data());
  for (std::size_t n = 0; n < count; ++n) out[n] = static_cast<To>(values[n]);
  return bytes;
}

template <class T>
Stored store(const VoxelImage& image) {
  const T* values = reinterpret_cast<const T*>(image.bytes.data());
  const std::size_t count = image.bytes.size() / sizeof(T);
  const auto [low, high] = std::minmax_element(values, values + count);
  Stored stored;
  if constexpr (std::is_integral_v<T>) {
    const bool is_signed = std::cmp_less(*low, 0);
    if (std::cmp_less(*low, -32768) || std::cmp_greater(*high, is_signed ? 32767 : 65535)) {
      throw InputError("DICOM: the values reach from " + std::to_string(*low) + " to " +
                       std::to_string(*high) + ", beyond 16 bits; write .nrrd, .nii.gz or .mha instead");
    }
    stored.type = is_signed ? VoxelType::int16 : VoxelType::uint16;
    stored.bytes =
        is_signed ? converted<std::int16_t>(values, count) : converted<std::uint16_t>(values, count);
  } else {
    if (!std::all_of(values, values + count, [](T value) { return std::isfinite(value); })) {
      throw InputError("DICOM: a value is not finite; write .nrrd, .nii.gz or .mha instead");
    }
    stored.type = VoxelType::float64;
    stored.intercept = static_cast<double>(*low);
    stored.slope = *high > *low ? (static_cast<double>(*high) - static_cast<double>(*low)) / 65535 : 1;
    stored.bytes = converted<double>(values, count);
  }
  return stored;
}

// A unique identifier made of the content: the same image gets the same.
std::string content_uid(const Stored& stored, const ImageGeometry& geometry, const std::string& what) {
  std::string key = what;
  const auto add = [&](double number) { key.append(reinterpret_cast<const char*>(&number), sizeof number); };
  for (int axis = 0; axis < 3; ++axis) {
    add(geometry.size[axis]);
    add(geometry.spacing[axis]);
    add(geometry.origin[axis]);
    for (int row = 0; row < 3; ++row) add(geometry.direction(row, axis));
  }
  add(static_cast<double>(XXH3_64bits(stored.bytes.data(), stored.bytes.size()) >> 11));
  const XXH128_hash_t hash = XXH3_128bits(key.data(), key.size());
  unsigned __int128 number = static_cast<unsigned __int128>(hash.high64) << 64 | hash.low64;
  std::string digits;
  do {
    digits.insert(digits.begin(), static_cast<char>('0' + static_cast<int>(number % 10)));
    number /= 10;
  } while (number != 0);
  return "2.25." + digits;
}

std::string decimal(double number) {  // at most 16 characters, as the format asks
  char text[32];
  for (int digits = 15; digits > 0; --digits) {
    std::snprintf(text, sizeof text, "%.*g", digits, number);
    if (std::strlen(text) <= 16) break;
  }
  return text;
}

}  // namespace

VoxelImage read_dicom_series(const fs::path& folder) {
  be_quiet();
  VoxelImage image;
  try {
    const std::vector<std::string> files = series_files(folder);
    const int slices = static_cast<int>(files.size());
    const auto first = open_slice(files.front());
    stack_geometry(folder, *first, *open_slice(files.back()), slices, image.geometry);
    image.type = voxel_type(first->GetComponentType(), folder);
    const auto bytes = static_cast<std::size_t>(first->GetImageSizeInBytes());  // of a slice
    image.bytes.resize(bytes * files.size());
    for (int k = 0; k < slices; ++k) {
      const std::string& file = files[static_cast<std::size_t>(k)];
      const auto io = open_slice(file);
      if (io->GetDimensions(0) != first->GetDimensions(0) ||
          io->GetDimensions(1) != first->GetDimensions(1) ||
          io->GetComponentType() != first->GetComponentType()) {
        throw InputError(file + ": its size or type differs from that of the other slices");
      }
      const ImageGeometry& g = image.geometry;
      const Vec3 expected_mm = 1000 * (g.origin + k * g.spacing[2] * g.direction.col(2));
      if (!((origin_mm(*io) - expected_mm).norm() <= max_slice_offset * 1000 * g.spacing[2])) {
        throw InputError(file +
                         ": the slices are not at equal distances (one may be missing); resample them");
      }
      io->SetIORegion(whole_region(*io));
      io->Read(image.bytes.data() + bytes * static_cast<std::size_t>(k));
    }
  } catch (const itk::ExceptionObject& error) {
    throw InputError(folder.string() + ": the DICOM series cannot be read (" + reason(error) + ")");
  } catch (const std::bad_alloc&) {
    throw InputError(folder.string() + ": not enough memory for this image; crop or resample it");
  }
  return image;
}

void write_dicom_series(const fs::path& folder, const VoxelImage& image) {
  be_quiet();
  const Stored stored = visit_voxel_type(image.type, [&]<class T>(T) { return store<T>(image); });
  const ImageGeometry& g = image.geometry;
  const std::size_t bytes = stored.bytes.size() / static_cast<std::size_t>(g.size[2]);
  const std::string series = content_uid(stored, g, "series"), study = content_uid(stored, g, "study"),
                    place = content_uid(stored, g, "frame of reference");
  for (int k = 0; k < g.size[2]; ++k) {
    ImageGeometry slice = g;
    slice.size[2] = 1;
    slice.origin += k * g.spacing[2] * g.direction.col(2);
    const auto io = itk::GDCMImageIO::New();
    const auto put = [&](const char* tag, const std::string& value) {
      itk::EncapsulateMetaData<std::string>(io->GetMetaDataDictionary(), tag, value);
    };
    put("0008|0008", "DERIVED\\SECONDARY");
    put("0008|0016", "1.2.840.10008.5.1.4.1.1.4");  // MR image storage
    put("0008|0018", content_uid(stored, g, "slice " + std::to_string(k)));
    put("0008|0060", "MR");
    put("0008|103e", "Sulcus, deformed volume");
    put("0010|0010", "Sulcus");
    put("0010|0020", "Sulcus");
    put("0018|0050", decimal(1000 * g.spacing[2]));
    put("0018|0088", decimal(1000 * g.spacing[2]));
    put("0020|000d", study);
    put("0020|000e", series);
    put("0020|0011", "1");
    put("0020|0013", std::to_string(k + 1));
    put("0020|0052", place);
    if (stored.type == VoxelType::float64) {  // how they are to be stored
      put("0028|0100", "16");
      put("0028|0101", "16");
      put("0028|0102", "15");
      put("0028|0103", "0");
    }
    put("0028|1052", decimal(stored.intercept));
    put("0028|1053", decimal(stored.slope));
    io->KeepOriginalUIDOn();
    char name[32];
    std::snprintf(name, sizeof name, "slice_%04d.dcm", k + 1);
    io->SetFileName((folder / name).string());
    set_geometry(slice, *io);
    io->SetPixelType(itk::IOPixelEnum::SCALAR);
    io->SetNumberOfComponents(1);
    io->SetComponentType(itk_component(stored.type));
    io->SetIORegion(whole_region(*io));
    io->Write(stored.bytes.data() + bytes * static_cast<std::size_t>(k));
  }
}

}  // namespace sulcus
