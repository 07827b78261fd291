// What the recording needs of HDF5's C interface: handles that close themselves, growing columns to write,
// and datasets read with distrust. Used by recording_write.cpp and recording_read.cpp alone.
#pragma once

#include <hdf5.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace sulcus::hdf5 {

// A call of HDF5 failed; what() is its innermost reason. Does not leave the recording.
struct Failure : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Handle {
 public:
  Handle() = default;
  Handle(hid_t id, herr_t (*closer)(hid_t)) : id_(id), close_(closer) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() { close(); }
  operator hid_t() const { return id_; }
  bool close() { return id_ < 0 || close_(std::exchange(id_, -1)) >= 0; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

// Once: no printing of errors, no plug-ins, no clean-up at exit (all handles close themselves).
void prepare_library();

std::string innermost_error();                          // of the call that failed last
hid_t checked(hid_t result, const std::string& doing);  // throws Failure if negative

// Types in the file (little endian) and in memory.
template <class T>
hid_t file_type();
template <class T>
hid_t memory_type();

// --- writing

inline constexpr hsize_t user_block_bytes = 512;  // before the HDF5 part of the file: the seal

Handle create_file(const std::string& path);
Handle create_group(hid_t parent,
                    const std::string& path);  // with the groups on the way; opens an existing one
void write_attribute(hid_t object, const std::string& name, const std::string& text);
void write_attribute(hid_t object, const std::string& name, std::int64_t value);
void write_attribute(hid_t object, const std::string& name, double value);
void write_strings(hid_t parent, const std::string& path, std::span<const std::string> strings);
template <class T>
void write_array(hid_t parent, const std::string& path, std::span<const T> values,
                 const std::string& unit = "");

// A compressed dataset [rows] or [rows, components] that grows by whole rows; keeps rows_per_chunk rows in
// memory.
class Column {
 public:
  // components < 0: one number a row, shape [rows].
  template <class T>
  static Column create(hid_t parent, const std::string& path, std::int64_t components, hsize_t rows_per_chunk,
                       const std::string& unit = "") {
    return Column(parent, path, file_type<T>(), memory_type<T>(), sizeof(T), components, rows_per_chunk,
                  unit);
  }
  void append(const void* row);
  void flush();
  void close();

 private:
  Column(hid_t parent, const std::string& path, hid_t in_file, hid_t in_memory, std::size_t element_bytes,
         std::int64_t components, hsize_t rows_per_chunk, const std::string& unit);

  Handle dataset_;
  std::string path_;
  hid_t memory_type_ = -1;
  int rank_ = 1;
  std::size_t row_bytes_ = 0;
  hsize_t components_ = 1, rows_per_chunk_ = 1, rows_written_ = 0, rows_buffered_ = 0;
  std::vector<std::byte> buffer_;
};

// --- reading; everything throws InputError with file and place

class Reader {
 public:
  Reader(std::string path, std::uint64_t file_bytes);

  std::int64_t integer_attribute(const std::string& name) const;  // of the root
  double real_attribute(const std::string& name) const;
  std::string text_attribute(const std::string& object, const std::string& name) const;
  std::vector<std::string> strings(const std::string& path);
  bool exists(const std::string& path) const;

  static constexpr std::int64_t any = -1;
  // All of a dataset whose shape is `shape`, where `any` leaves an extent free (and sets it to what was
  // found).
  template <class T>
  std::vector<T> array(const std::string& path, std::vector<std::int64_t>& shape);
  template <class T>
  std::vector<T> array(const std::string& path, std::vector<std::int64_t>&& shape) {
    return array<T>(path, shape);
  }
  std::vector<std::int64_t> shape(const std::string& path) const;

  // Paths of all datasets below a group, relative to it, sorted.
  std::vector<std::string> datasets_below(const std::string& group) const;

  [[noreturn]] void refuse(const std::string& place, const std::string& what) const;

 private:
  Handle open_object(const std::string& path, H5O_type_t type) const;
  void claim(const std::string& path, hid_t dataset, std::uint64_t elements, std::uint64_t element_bytes);
  void collect(const std::string& group, const std::string& prefix, int depth,
               std::vector<std::string>& paths) const;

  std::string path_;
  std::uint64_t file_bytes_ = 0, budget_bytes_ = 0;
  Handle file_;
};

}  // namespace sulcus::hdf5
