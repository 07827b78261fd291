// Reading with distrust: nothing is allocated before it is known that the file can hold it.
#include <algorithm>
#include <cstring>
#include <limits>

#include "engine/numerics/error.h"
#include "verify/hdf5_file.h"

namespace sulcus::hdf5 {

namespace {

constexpr std::uint64_t largest_inflation = 1100;  // deflate does not compress better than 1032 : 1
constexpr std::uint64_t largest_chunk_bytes = 1 << 26;
constexpr std::size_t largest_dataset_count = 10'000;
constexpr int deepest_group = 8;

std::string shape_text(const std::vector<std::int64_t>& shape) {
  std::string text = "[";
  for (std::size_t i = 0; i < shape.size(); ++i)
    text += (i > 0 ? ", " : "") + (shape[i] == Reader::any ? "any" : std::to_string(shape[i]));
  return text + "]";
}

std::vector<std::int64_t> extents(hid_t dataset) {
  const Handle space(H5Dget_space(dataset), H5Sclose);
  hsize_t extent[H5S_MAX_RANK] = {};
  const int rank = space < 0 ? -1 : H5Sget_simple_extent_dims(space, extent, nullptr);
  std::vector<std::int64_t> shape;
  for (int i = 0; i < rank; ++i)
    shape.push_back(static_cast<std::int64_t>(
        std::min<hsize_t>(extent[i], static_cast<hsize_t>(std::numeric_limits<std::int64_t>::max()))));
  return shape;
}

// Trailing padding off.
std::string trimmed(const char* bytes, std::size_t size) {
  return {bytes, ::strnlen(bytes, size)};
}

}  // namespace

Reader::Reader(std::string path, std::uint64_t file_bytes) : path_(std::move(path)), file_bytes_(file_bytes) {
  prepare_library();
  budget_bytes_ = std::min<std::uint64_t>(file_bytes * largest_inflation, std::uint64_t{1} << 40);
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_fclose_degree(access, H5F_CLOSE_STRONG);
  H5Pset_file_locking(access, false, true);
  file_ = Handle(H5Fopen(path_.c_str(), H5F_ACC_RDONLY, access), H5Fclose);
  if (file_ < 0) throw InputError(path_ + ": not a readable HDF5 file (" + innermost_error() + ")");
}

void Reader::refuse(const std::string& place, const std::string& what) const {
  throw InputError(path_ + ": " + place + " " + what +
                   "; the recording cannot be used, record the run again");
}

// Follows hard links only: a link out of the file would read what nobody meant to give.
Handle Reader::open_object(const std::string& path, H5O_type_t type) const {
  for (std::size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
    const std::string part = path.substr(0, end);
    H5L_info_t link;
    if (H5Lexists(file_, part.c_str(), H5P_DEFAULT) <= 0 ||
        H5Lget_info(file_, part.c_str(), &link, H5P_DEFAULT) < 0)
      refuse(path, "is missing");
    if (link.type != H5L_TYPE_HARD)
      refuse(part, "is a soft or external link, which a recording does not have");
    if (end == std::string::npos) break;
  }
  Handle object(H5Oopen(file_, path.c_str(), H5P_DEFAULT), H5Oclose);
  H5O_info_t info;
  if (object < 0 || H5Oget_info2(object, &info, H5O_INFO_BASIC) < 0) refuse(path, "cannot be opened");
  if (info.type != type) refuse(path, type == H5O_TYPE_GROUP ? "is not a group" : "is not a dataset");
  return object;
}

bool Reader::exists(const std::string& path) const {
  for (std::size_t end = path.find('/', 1);; end = path.find('/', end + 1)) {
    if (H5Lexists(file_, path.substr(0, end).c_str(), H5P_DEFAULT) <= 0) return false;
    if (end == std::string::npos) return true;
  }
}

// Refuses a dataset that says it is larger than its bytes in the file can make it.
void Reader::claim(const std::string& path, hid_t dataset, std::uint64_t elements,
                   std::uint64_t element_bytes) {
  if (elements == 0 || element_bytes == 0) return;
  if (elements > budget_bytes_ / element_bytes) refuse(path, "is larger than the file can hold");
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  const H5D_layout_t layout = creation < 0 ? H5D_LAYOUT_ERROR : H5Pget_layout(creation);
  const std::uint64_t stored = H5Dget_storage_size(dataset);
  std::uint64_t inflation = 1;
  if (layout == H5D_CHUNKED) {
    hsize_t chunk[H5S_MAX_RANK] = {};
    const int rank = H5Pget_chunk(creation, H5S_MAX_RANK, chunk);
    std::uint64_t chunk_bytes = element_bytes;
    for (int i = 0; i < rank; ++i) {
      if (chunk[i] == 0 || chunk[i] > largest_chunk_bytes / chunk_bytes)
        refuse(path, "has chunks that are too large");
      chunk_bytes *= chunk[i];
    }
    const int filters = H5Pget_nfilters(creation);
    for (int i = 0; i < filters; ++i) {
      unsigned flags = 0;
      std::size_t parameters = 0;
      const H5Z_filter_t filter = H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &parameters,
                                                 nullptr, 0, nullptr, nullptr);
      if (filter == H5Z_FILTER_DEFLATE) inflation = largest_inflation;
      if (filter != H5Z_FILTER_DEFLATE && filter != H5Z_FILTER_SHUFFLE) refuse(path, "has an unknown filter");
    }
    if (filters > 2) refuse(path, "has too many filters");
  } else if (layout != H5D_CONTIGUOUS || H5Pget_external_count(creation) != 0) {
    refuse(path, "has a layout that a recording does not have");
  }
  const std::uint64_t bytes = elements * element_bytes;
  if (stored == 0 || stored > file_bytes_ || bytes / inflation > stored)
    refuse(path, "says it holds " + std::to_string(bytes) + " bytes but has " + std::to_string(stored) +
                     " in the file");
  budget_bytes_ -= bytes;
}

std::vector<std::int64_t> Reader::shape(const std::string& path) const {
  return extents(open_object(path, H5O_TYPE_DATASET));
}

template <class T>
std::vector<T> Reader::array(const std::string& path, std::vector<std::int64_t>& shape) {
  const Handle dataset = open_object(path, H5O_TYPE_DATASET);
  const Handle type(H5Dget_type(dataset), H5Tclose);
  if (type < 0 || H5Tequal(type, file_type<T>()) <= 0) refuse(path, "has the wrong element type");
  const std::vector<std::int64_t> found = extents(dataset);
  bool fits = found.size() == shape.size();
  for (std::size_t i = 0; fits && i < shape.size(); ++i) fits = shape[i] == any || shape[i] == found[i];
  if (!fits) refuse(path, "has shape " + shape_text(found) + ", expected " + shape_text(shape));
  shape = found;

  std::uint64_t elements = 1;
  for (const std::int64_t extent : found) {
    const auto count = static_cast<std::uint64_t>(extent);
    if (count > 0 && elements > budget_bytes_ / count) refuse(path, "is larger than the file can hold");
    elements *= count;
  }
  claim(path, dataset, elements, sizeof(T));
  std::vector<T> values(elements);
  if (elements > 0 && H5Dread(dataset, memory_type<T>(), H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
    refuse(path, "cannot be read (" + innermost_error() + ")");
  return values;
}
template std::vector<double> Reader::array(const std::string&, std::vector<std::int64_t>&);
template std::vector<std::int64_t> Reader::array(const std::string&, std::vector<std::int64_t>&);
template std::vector<std::int32_t> Reader::array(const std::string&, std::vector<std::int64_t>&);
template std::vector<std::uint64_t> Reader::array(const std::string&, std::vector<std::int64_t>&);
template std::vector<std::uint32_t> Reader::array(const std::string&, std::vector<std::int64_t>&);
template std::vector<std::uint8_t> Reader::array(const std::string&, std::vector<std::int64_t>&);

std::vector<std::string> Reader::strings(const std::string& path) {
  const Handle dataset = open_object(path, H5O_TYPE_DATASET);
  const Handle type(H5Dget_type(dataset), H5Tclose);
  if (type < 0 || H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0)
    refuse(path, "is not a list of texts");
  const std::vector<std::int64_t> found = extents(dataset);
  if (found.size() != 1) refuse(path, "has shape " + shape_text(found) + ", expected [any]");
  const std::size_t bytes = H5Tget_size(type);
  const auto count = static_cast<std::uint64_t>(found[0]);
  claim(path, dataset, count, bytes);
  std::vector<char> text(count * bytes);
  if (count > 0 && H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text.data()) < 0)
    refuse(path, "cannot be read (" + innermost_error() + ")");
  std::vector<std::string> list(count);
  for (std::size_t i = 0; i < count; ++i) list[i] = trimmed(text.data() + i * bytes, bytes);
  return list;
}

namespace {

Handle open_scalar(hid_t object, const std::string& name, hid_t type) {
  Handle attribute(H5Aexists(object, name.c_str()) > 0 ? H5Aopen(object, name.c_str(), H5P_DEFAULT) : -1,
                   H5Aclose);
  if (attribute < 0) return attribute;
  const Handle space(H5Aget_space(attribute), H5Sclose);
  const Handle found(H5Aget_type(attribute), H5Tclose);
  const bool typed = type < 0 || H5Tequal(found, type) > 0;
  return space >= 0 && H5Sget_simple_extent_npoints(space) == 1 && typed ? std::move(attribute) : Handle();
}

}  // namespace

std::int64_t Reader::integer_attribute(const std::string& name) const {
  std::int64_t value = 0;
  const Handle attribute = open_scalar(file_, name, file_type<std::int64_t>());
  if (attribute < 0 || H5Aread(attribute, memory_type<std::int64_t>(), &value) < 0)
    refuse("attribute " + name, "is missing or not an integer");
  return value;
}

double Reader::real_attribute(const std::string& name) const {
  double value = 0;
  const Handle attribute = open_scalar(file_, name, file_type<double>());
  if (attribute < 0 || H5Aread(attribute, memory_type<double>(), &value) < 0)
    refuse("attribute " + name, "is missing or not a number");
  return value;
}

std::string Reader::text_attribute(const std::string& object, const std::string& name) const {
  const Handle owner = object == "/" ? Handle(H5Oopen(file_, "/", H5P_DEFAULT), H5Oclose)
                                     : open_object(object, H5O_TYPE_DATASET);
  const Handle attribute = open_scalar(owner, name, -1);
  if (attribute < 0) return "";
  const Handle type(H5Aget_type(attribute), H5Tclose);
  const std::size_t bytes = type < 0 ? 0 : H5Tget_size(type);
  if (type < 0 || H5Tget_class(type) != H5T_STRING || H5Tis_variable_str(type) != 0 || bytes > 65536)
    refuse(object, "has an attribute " + name + " that is not a text");
  std::vector<char> text(bytes);
  if (H5Aread(attribute, type, text.data()) < 0) refuse(object, "has an unreadable attribute " + name);
  return trimmed(text.data(), bytes);
}

void Reader::collect(const std::string& group, const std::string& prefix, int depth,
                     std::vector<std::string>& paths) const {
  if (depth > deepest_group) refuse(group, "is nested too deeply");
  std::vector<std::string> names;
  const auto note = [](hid_t, const char* name, const H5L_info_t*, void* data) -> herr_t {
    auto& list = *static_cast<std::vector<std::string>*>(data);
    list.emplace_back(name);
    return list.size() > largest_dataset_count ? -1 : 0;
  };
  const Handle parent = open_object(group, H5O_TYPE_GROUP);
  if (H5Literate(parent, H5_INDEX_NAME, H5_ITER_INC, nullptr, note, &names) < 0)
    refuse(group, "cannot be listed");
  for (const std::string& name : names) {
    const std::string path = group + "/" + name;
    H5L_info_t link;
    if (H5Lget_info(parent, name.c_str(), &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD)
      refuse(path, "is a soft or external link, which a recording does not have");
    H5O_info_t info;
    if (H5Oget_info_by_name2(parent, name.c_str(), &info, H5O_INFO_BASIC, H5P_DEFAULT) < 0)
      refuse(path, "cannot be opened");
    if (info.type == H5O_TYPE_GROUP)
      collect(path, prefix + name + "/", depth + 1, paths);
    else
      paths.push_back(prefix + name);
    if (paths.size() > largest_dataset_count) refuse(group, "holds too many datasets");
  }
}

std::vector<std::string> Reader::datasets_below(const std::string& group) const {
  std::vector<std::string> paths;
  collect(group, "", 0, paths);
  std::sort(paths.begin(), paths.end());
  return paths;
}

}  // namespace sulcus::hdf5
