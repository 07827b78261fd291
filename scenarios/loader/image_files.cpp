#include "scenarios/loader/image_files.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <map>
#include <memory>
#include <vector>

#include "engine/numerics/error.h"

namespace sulcus {

namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t max_text_header_bytes = 1 << 16;

std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

bool ends_with(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() &&
         text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

std::string trimmed(const std::string& text) {
  const std::size_t first = text.find_first_not_of(" \t=");
  return first == std::string::npos ? "" : text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// Fields of the text header of an NRRD ("key: value", up to an empty line) or a MetaImage ("key = value", up
// to ElementDataFile), keys in lower case.
struct TextHeader {
  std::map<std::string, std::string> fields;
  std::uint64_t bytes = 0;

  std::string field(const std::string& key) const {
    const auto entry = fields.find(key);
    return entry == fields.end() ? "" : entry->second;
  }
};

TextHeader read_text_header(const fs::path& path, ImageFormat format) {
  std::ifstream stream(path, std::ios::binary);
  TextHeader header;
  std::string line;
  while (header.bytes < max_text_header_bytes && std::getline(stream, line)) {
    header.bytes += line.size() + 1;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (format == ImageFormat::nrrd && line.empty()) break;
    const std::size_t mark = line.find(format == ImageFormat::nrrd ? ':' : '=');
    if (mark == std::string::npos) continue;
    const std::string key = lower(trimmed(line.substr(0, mark)));
    header.fields[key] = trimmed(line.substr(mark + 1));
    if (format == ImageFormat::meta && key == "elementdatafile") break;
  }
  return header;
}

ImageData find_nrrd_data(const TextHeader& header, std::string& name) {
  name = header.field("data file").empty() ? header.field("datafile") : header.field("data file");
  const std::string encoding = lower(header.field("encoding"));
  const bool skips = header.fields.count("line skip") + header.fields.count("lineskip") +
                         header.fields.count("byte skip") + header.fields.count("byteskip") >
                     0;
  ImageData data;
  if (encoding == "raw") data.encoding = DataEncoding::raw;
  if ((encoding == "gzip" || encoding == "gz") && !skips) data.encoding = DataEncoding::deflated;
  return data;
}

ImageData find_meta_data(const TextHeader& header, std::string& name) {
  name = header.field("elementdatafile");
  ImageData data;
  if (lower(header.field("compresseddata")) == "true") {
    data.encoding = DataEncoding::deflated;
  } else if (lower(header.field("binarydata")) != "false") {
    data.encoding = DataEncoding::raw;
  }
  return data;
}

// The data file of a NIfTI header in a file of its own, or an empty path.
fs::path nifti_partner(const fs::path& path) {
  const std::string name = path.string();
  for (const std::string zip : {"", ".gz"}) {
    if (ends_with(name, ".hdr" + zip)) return name.substr(0, name.size() - 4 - zip.size()) + ".img" + zip;
  }
  return {};
}

ImageData find_nifti_data(const fs::path& path) {
  ImageData data;
  data.file = path;
  if (const fs::path partner = nifti_partner(path); !partner.empty()) {
    require_file(partner, "the data file of " + path.filename().string());
    data.file = partner;
  }
  const double offset = read_nifti_header(path).data_offset;
  const bool zipped = ends_with(lower(path.string()), ".gz");
  data.encoding = zipped ? DataEncoding::deflated : DataEncoding::raw;
  (zipped ? data.stream_offset : data.file_offset) =
      offset > 0 && offset < 1e9 ? static_cast<std::uint64_t>(offset) : 0;
  // ITK's NIfTI reader would take the header from x.nii.gz and the voxels from x.nii.
  if (const fs::path unzipped = path.string().substr(0, path.string().size() - 3);
      zipped && fs::exists(unzipped)) {
    throw InputError(path.string() + ": " + unzipped.filename().string() +
                     " lies beside it, and the two would be mixed up; rename or move one of them");
  }
  return data;
}

enum class Inflated { whole, damaged, truncated };

// Inflates a gzip or zlib stream; `bytes` becomes what it gives. Stops without a verdict on the rest beyond
// `enough`.
Inflated inflate_stream(std::ifstream& stream, std::uint64_t enough, std::uint64_t& bytes) {
  z_stream inflater{};
  inflateInit2(&inflater, 15 + 32);  // either header
  const std::unique_ptr<z_stream, int (*)(z_stream*)> closer(&inflater, inflateEnd);
  std::vector<char> input(1 << 16), output(1 << 18);
  bool ended = false;
  while (bytes <= enough) {
    if (inflater.avail_in == 0) {
      stream.read(input.data(), static_cast<std::streamsize>(input.size()));
      inflater.avail_in = static_cast<uInt>(stream.gcount());
      inflater.next_in = reinterpret_cast<Bytef*>(input.data());
      if (inflater.avail_in == 0) return ended ? Inflated::whole : Inflated::truncated;
    }
    if (ended) {  // a further member of a gzip file, or something else that is not ours
      if (*inflater.next_in != 0x1f) return Inflated::whole;
      inflateReset(&inflater);
    }
    inflater.avail_out = static_cast<uInt>(output.size());
    inflater.next_out = reinterpret_cast<Bytef*>(output.data());
    const int result = inflate(&inflater, Z_NO_FLUSH);
    bytes += output.size() - inflater.avail_out;
    ended = result == Z_STREAM_END;
    if (result != Z_OK && result != Z_BUF_ERROR && !ended) return Inflated::damaged;
  }
  return Inflated::whole;
}

// Numbers of a binary header in either byte order.
class BinaryHeader {
 public:
  explicit BinaryHeader(const fs::path& path) {
    const gzFile file = gzopen(path.c_str(), "rb");  // reads what is not compressed, too
    if (file == nullptr) throw InputError(path.string() + ": the file cannot be read; check its permissions");
    const int count = gzread(file, bytes_.data(), static_cast<unsigned>(bytes_.size()));
    gzclose(file);
    const std::size_t length = count < 0 ? 0 : static_cast<std::size_t>(count);
    for (const bool swapped : {false, true}) {
      swapped_ = swapped;
      size_ = at<std::int32_t>(0);
      if ((size_ == 348 || size_ == 540) && length >= static_cast<std::size_t>(size_)) return;
    }
    throw InputError(path.string() +
                     ": this is no NIfTI image (no header of 348 or 540 bytes); it may be truncated");
  }

  bool second_version() const { return size_ == 540; }

  template <class T>
  T at(std::size_t offset) const {
    std::array<char, sizeof(T)> raw;
    std::memcpy(raw.data(), &bytes_.at(offset), sizeof(T));
    if (swapped_) std::reverse(raw.begin(), raw.end());
    T value;
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }

  // A floating-point field: single precision in NIfTI-1, double in NIfTI-2.
  double real(std::size_t first_version_offset, std::size_t second_version_offset) const {
    return second_version() ? at<double>(second_version_offset)
                            : static_cast<double>(at<float>(first_version_offset));
  }

 private:
  std::array<char, 540> bytes_{};
  bool swapped_ = false;
  std::int32_t size_ = 0;
};

}  // namespace

ImageFormat image_format(const fs::path& path) {
  const std::string name = lower(path.filename().string());
  if (ends_with(name, ".nrrd") || ends_with(name, ".nhdr")) return ImageFormat::nrrd;
  if (ends_with(name, ".mha") || ends_with(name, ".mhd")) return ImageFormat::meta;
  for (const char* ending : {".nii", ".nii.gz", ".hdr", ".hdr.gz"}) {
    if (ends_with(name, ending)) return ImageFormat::nifti;
  }
  throw InputError(
      path.string() +
      ": unknown image format; the name must end in .nrrd, .nhdr, .nii, .nii.gz, .hdr, .mha or .mhd");
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

ImageData find_image_data(const fs::path& path, ImageFormat format) {
  require_file(path, "the image");
  if (format == ImageFormat::nifti) return find_nifti_data(path);
  const TextHeader header = read_text_header(path, format);
  std::string name;
  ImageData data = format == ImageFormat::nrrd ? find_nrrd_data(header, name) : find_meta_data(header, name);
  if (name.empty() || lower(name) == "local") {
    data.file = path;
    data.file_offset = header.bytes;
  } else {
    if (lower(name).rfind("list", 0) == 0 || name.find('%') != std::string::npos) {
      throw InputError(path.string() + ": the data is spread over several files (" + name +
                       "); store it in one file");
    }
    data.file = path.parent_path() / name;
    require_file(data.file, "the data file that " + path.filename().string() + " names");
  }
  return data;
}

void require_data(const fs::path& path, const ImageData& data, std::uint64_t bytes) {
  if (data.encoding == DataEncoding::other) return;
  const std::uint64_t size = fs::file_size(data.file);
  std::uint64_t found = size > data.file_offset ? size - data.file_offset : 0;
  Inflated state = Inflated::whole;
  if (data.encoding == DataEncoding::deflated) {
    std::ifstream stream(data.file, std::ios::binary);
    stream.seekg(static_cast<std::streamoff>(data.file_offset));
    found = 0;
    state = inflate_stream(stream, data.stream_offset + bytes, found);
    found = found > data.stream_offset ? found - data.stream_offset : 0;
  }
  const std::string place =
      path.string() + ": the header promises " + std::to_string(bytes) + " bytes of voxels, ";
  if (state == Inflated::damaged) {
    throw InputError(place + "but the compressed data is damaged after " + std::to_string(found) +
                     " bytes; get the file again");
  }
  if (state == Inflated::truncated || found < bytes) {
    throw InputError(place + "but the data ends after " + std::to_string(found) +
                     " bytes; the file is truncated, get it again");
  }
}

NiftiHeader read_nifti_header(const fs::path& path) {
  const BinaryHeader binary(path);
  const bool second = binary.second_version();
  NiftiHeader header;
  header.slope = binary.real(112, 176);
  header.shift = binary.real(116, 184);
  header.data_offset = second ? static_cast<double>(binary.at<std::int64_t>(168)) : binary.at<float>(108);
  header.bits = binary.at<std::uint16_t>(second ? 14 : 72);
  const int code = second ? binary.at<std::int32_t>(348) : binary.at<std::int16_t>(254);
  if (code <= 0) return header;
  // Units 1: metres, 3: micrometres, else millimetres. Rows x, y, z point right, anterior, superior.
  const int unit = (second ? binary.at<std::int32_t>(500) : binary.at<std::uint8_t>(123)) & 7;
  const double unit_mm = unit == 1 ? 1000 : unit == 3 ? 0.001 : 1;
  header.sform.emplace();
  for (int row = 0; row < 3; ++row) {
    const double sign_mm = row < 2 ? -unit_mm : unit_mm;
    const auto entry = [&](int column) {
      const auto number = static_cast<std::size_t>(4 * row + column);
      return sign_mm * binary.real(280 + 4 * number, 400 + 8 * number);
    };
    for (int column = 0; column < 3; ++column) header.sform->step_mm(row, column) = entry(column);
    header.sform->origin_mm[row] = entry(3);
  }
  return header;
}

}  // namespace sulcus
