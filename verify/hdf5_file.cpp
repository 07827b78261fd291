#include "verify/hdf5_file.h"

#include <algorithm>
#include <cstring>

namespace sulcus::hdf5 {

void prepare_library() {
  static const bool prepared = [] {
    H5dont_atexit();
    H5open();
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    H5PLset_loading_state(0);
    return true;
  }();
  static_cast<void>(prepared);
}

std::string innermost_error() {
  std::string text;
  const auto visit = [](unsigned, const H5E_error2_t* entry, void* data) -> herr_t {
    if (entry->desc != nullptr) *static_cast<std::string*>(data) = entry->desc;
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_DOWNWARD, visit, &text);
  H5Eclear2(H5E_DEFAULT);
  // Of a failed system call only the system's reason is for people.
  const std::string mark = "error message = '";
  if (const std::size_t start = text.find(mark); start != std::string::npos) {
    const std::size_t from = start + mark.size();
    text = text.substr(from, text.find('\'', from) - from);
  }
  return text.empty() ? "no reason given" : text;
}

hid_t checked(hid_t result, const std::string& doing) {
  if (result < 0) throw Failure(doing + ": " + innermost_error());
  return result;
}

template <>
hid_t file_type<double>() {
  return H5T_IEEE_F64LE;
}
template <>
hid_t file_type<std::int64_t>() {
  return H5T_STD_I64LE;
}
template <>
hid_t file_type<std::int32_t>() {
  return H5T_STD_I32LE;
}
template <>
hid_t file_type<std::uint64_t>() {
  return H5T_STD_U64LE;
}
template <>
hid_t file_type<std::uint32_t>() {
  return H5T_STD_U32LE;
}
template <>
hid_t file_type<std::uint8_t>() {
  return H5T_STD_U8LE;
}
template <>
hid_t memory_type<double>() {
  return H5T_NATIVE_DOUBLE;
}
template <>
hid_t memory_type<std::int64_t>() {
  return H5T_NATIVE_INT64;
}
template <>
hid_t memory_type<std::int32_t>() {
  return H5T_NATIVE_INT32;
}
template <>
hid_t memory_type<std::uint64_t>() {
  return H5T_NATIVE_UINT64;
}
template <>
hid_t memory_type<std::uint32_t>() {
  return H5T_NATIVE_UINT32;
}
template <>
hid_t memory_type<std::uint8_t>() {
  return H5T_NATIVE_UINT8;
}

namespace {

constexpr unsigned deflate_level = 4;
constexpr hsize_t largest_chunk_columns = 65536;

Handle property_list(hid_t kind) {
  return {checked(H5Pcreate(kind), "preparing HDF5"), H5Pclose};
}

Handle string_type(std::size_t bytes) {
  Handle type(checked(H5Tcopy(H5T_C_S1), "preparing HDF5"), H5Tclose);
  checked(H5Tset_size(type, std::max<std::size_t>(bytes, 1)), "preparing HDF5");
  checked(H5Tset_strpad(type, H5T_STR_NULLPAD), "preparing HDF5");
  checked(H5Tset_cset(type, H5T_CSET_UTF8), "preparing HDF5");
  return type;
}

Handle create_dataset(hid_t parent, const std::string& path, hid_t type, hid_t space, hid_t creation,
                      hid_t access = H5P_DEFAULT) {
  const Handle links = property_list(H5P_LINK_CREATE);
  checked(H5Pset_create_intermediate_group(links, 1), path);
  return {checked(H5Dcreate2(parent, path.c_str(), type, space, links, creation, access), path), H5Dclose};
}

void write_scalar_attribute(hid_t object, const std::string& name, hid_t in_file, hid_t in_memory,
                            const void* value) {
  const Handle space(checked(H5Screate(H5S_SCALAR), name), H5Sclose);
  Handle attribute(checked(H5Acreate2(object, name.c_str(), in_file, space, H5P_DEFAULT, H5P_DEFAULT), name),
                   H5Aclose);
  checked(H5Awrite(attribute, in_memory, value), name);
  if (!attribute.close()) throw Failure(name + ": " + innermost_error());
}

// The whole of a plain (not chunked) dataset.
void write_whole(hid_t parent, const std::string& path, hid_t in_file, hid_t in_memory, hsize_t count,
                 const void* data, const std::string& unit) {
  const Handle space(checked(H5Screate_simple(1, &count, nullptr), path), H5Sclose);
  Handle dataset = create_dataset(parent, path, in_file, space, H5P_DEFAULT);
  if (!unit.empty()) write_attribute(dataset, "unit", unit);
  if (count > 0) checked(H5Dwrite(dataset, in_memory, H5S_ALL, H5S_ALL, H5P_DEFAULT, data), path);
  if (!dataset.close()) throw Failure(path + ": " + innermost_error());
}

}  // namespace

Handle create_file(const std::string& path) {
  prepare_library();
  const Handle creation = property_list(H5P_FILE_CREATE);
  const Handle access = property_list(H5P_FILE_ACCESS);
  checked(H5Pset_userblock(creation, user_block_bytes), path);
  checked(H5Pset_fclose_degree(access, H5F_CLOSE_STRONG), path);
  checked(H5Pset_file_locking(access, false, true), path);  // locks fail on some network file systems
  return {checked(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, access), path), H5Fclose};
}

Handle create_group(hid_t parent, const std::string& path) {
  if (H5Lexists(parent, path.c_str(), H5P_DEFAULT) > 0)
    return {checked(H5Gopen2(parent, path.c_str(), H5P_DEFAULT), path), H5Gclose};
  const Handle links = property_list(H5P_LINK_CREATE);
  checked(H5Pset_create_intermediate_group(links, 1), path);
  return {checked(H5Gcreate2(parent, path.c_str(), links, H5P_DEFAULT, H5P_DEFAULT), path), H5Gclose};
}

void write_attribute(hid_t object, const std::string& name, const std::string& text) {
  const Handle type = string_type(text.size());
  const std::string bytes = text.empty() ? std::string(1, '\0') : text;
  write_scalar_attribute(object, name, type, type, bytes.data());
}

void write_attribute(hid_t object, const std::string& name, std::int64_t value) {
  write_scalar_attribute(object, name, file_type<std::int64_t>(), memory_type<std::int64_t>(), &value);
}

void write_attribute(hid_t object, const std::string& name, double value) {
  write_scalar_attribute(object, name, file_type<double>(), memory_type<double>(), &value);
}

void write_strings(hid_t parent, const std::string& path, std::span<const std::string> strings) {
  std::size_t longest = 1;
  for (const std::string& text : strings) longest = std::max(longest, text.size());
  std::vector<char> bytes(longest * strings.size());
  for (std::size_t i = 0; i < strings.size(); ++i)
    std::memcpy(bytes.data() + i * longest, strings[i].data(), strings[i].size());
  const Handle type = string_type(longest);
  write_whole(parent, path, type, type, strings.size(), bytes.data(), "");
}

template <class T>
void write_array(hid_t parent, const std::string& path, std::span<const T> values, const std::string& unit) {
  write_whole(parent, path, file_type<T>(), memory_type<T>(), values.size(), values.data(), unit);
}
template void write_array(hid_t, const std::string&, std::span<const double>, const std::string&);
template void write_array(hid_t, const std::string&, std::span<const std::int64_t>, const std::string&);
template void write_array(hid_t, const std::string&, std::span<const std::int32_t>, const std::string&);
template void write_array(hid_t, const std::string&, std::span<const std::uint8_t>, const std::string&);

Column::Column(hid_t parent, const std::string& path, hid_t in_file, hid_t in_memory,
               std::size_t element_bytes, std::int64_t components, hsize_t rows_per_chunk,
               const std::string& unit)
    : path_(path),
      memory_type_(in_memory),
      rank_(components < 0 ? 1 : 2),
      components_(components < 0 ? 1 : static_cast<hsize_t>(components)),
      rows_per_chunk_(rows_per_chunk) {
  row_bytes_ = element_bytes * components_;
  buffer_.resize(row_bytes_ * rows_per_chunk);
  const hsize_t extent[2] = {0, components_};
  const hsize_t limit[2] = {H5S_UNLIMITED, H5S_UNLIMITED};
  const hsize_t chunk[2] = {rows_per_chunk, std::clamp<hsize_t>(components_, 1, largest_chunk_columns)};
  const Handle space(checked(H5Screate_simple(rank_, extent, limit), path), H5Sclose);
  const Handle creation = property_list(H5P_DATASET_CREATE);
  checked(H5Pset_chunk(creation, rank_, chunk), path);
  checked(H5Pset_shuffle(creation), path);
  checked(H5Pset_deflate(creation, deflate_level), path);
  // No cache of chunks: rows are written by whole chunks, so that memory stays bounded and a full disk is
  // seen at once.
  const Handle access = property_list(H5P_DATASET_ACCESS);
  checked(H5Pset_chunk_cache(access, 0, 0, 1.0), path);
  dataset_ = create_dataset(parent, path, in_file, space, creation, access);
  if (!unit.empty()) write_attribute(dataset_, "unit", unit);
}

void Column::append(const void* row) {
  if (row_bytes_ > 0) std::memcpy(buffer_.data() + rows_buffered_ * row_bytes_, row, row_bytes_);
  if (++rows_buffered_ == rows_per_chunk_) flush();
}

void Column::flush() {
  if (rows_buffered_ == 0) return;
  const hsize_t start[2] = {rows_written_, 0};
  const hsize_t count[2] = {rows_buffered_, components_};
  const hsize_t extent[2] = {rows_written_ + rows_buffered_, components_};
  checked(H5Dset_extent(dataset_, extent), path_);
  if (components_ > 0) {
    const Handle in_file(checked(H5Dget_space(dataset_), path_), H5Sclose);
    const Handle in_memory(checked(H5Screate_simple(rank_, count, nullptr), path_), H5Sclose);
    checked(H5Sselect_hyperslab(in_file, H5S_SELECT_SET, start, nullptr, count, nullptr), path_);
    checked(H5Dwrite(dataset_, memory_type_, in_memory, in_file, H5P_DEFAULT, buffer_.data()), path_);
  }
  rows_written_ += rows_buffered_;
  rows_buffered_ = 0;
}

void Column::close() {
  flush();
  if (!dataset_.close()) throw Failure(path_ + ": " + innermost_error());
}

}  // namespace sulcus::hdf5
