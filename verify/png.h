// Pictures as plain pixels, and as PNG files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace sulcus {

struct Image {
  int width = 0, height = 0;      // pixels
  std::vector<std::uint8_t> rgb;  // [height*width*3], sRGB, rows from the top
};

// The bytes of a PNG file. The same pixels give the same bytes. Throws InputError for an image whose array
// does not fit its size.
std::string encode_png(const Image& image);

// Pixels of a PNG of any kind (grey, palette, 16 bits); transparency is laid over white.
// Throws InputError naming `name` for anything else, cut-off files, and more than 2^28 pixels.
Image decode_png(const std::string& bytes, const std::string& name);

// Files; written whole or not at all (temporary name, then rename).
// write_png throws EnvironmentError (folder missing, disk full); read_png throws InputError.
void write_png(const Image& image, const std::filesystem::path& path);
Image read_png(const std::filesystem::path& path);

}  // namespace sulcus
