#include "verify/png.h"

#include <png.h>

#include <cstring>
#include <fstream>
#include <sstream>

#include "engine/numerics/error.h"
#include "verify/check.h"

namespace sulcus {
namespace {

constexpr std::uint64_t max_pixels = std::uint64_t{1} << 28;

// libpng's messages arrive by longjmp; the text is kept here for the exception thrown afterwards.
struct PngMessage {
  char text[200] = "";
};

void keep_message(png_structp png, png_const_charp text) {
  auto* message = static_cast<PngMessage*>(png_get_error_ptr(png));
  std::strncpy(message->text, text, sizeof(message->text) - 1);
  png_longjmp(png, 1);
}

void ignore_warning(png_structp, png_const_charp) {}

void append_bytes(png_structp png, png_bytep data, png_size_t count) {
  static_cast<std::string*>(png_get_io_ptr(png))->append(reinterpret_cast<const char*>(data), count);
}

struct Source {
  const std::string& bytes;
  std::size_t position;
};

void take_bytes(png_structp png, png_bytep data, png_size_t count) {
  auto* source = static_cast<Source*>(png_get_io_ptr(png));
  if (source->bytes.size() - source->position < count) png_error(png, "the file ends too early");
  std::memcpy(data, source->bytes.data() + source->position, count);
  source->position += count;
}

// Only plain data and C calls between setjmp and longjmp; false on failure.
bool encode_rows(png_structp png, png_infop info, const Image& image, std::string& bytes) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_write_fn(png, &bytes, append_bytes, nullptr);
  png_set_IHDR(png, info, static_cast<png_uint_32>(image.width), static_cast<png_uint_32>(image.height), 8,
               PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
  png_set_compression_level(png, 6);
  png_write_info(png, info);
  for (int y = 0; y < image.height; ++y) {
    png_write_row(png,
                  image.rgb.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) * 3);
  }
  png_write_end(png, nullptr);
  return true;
}

bool decode_rows(png_structp png, png_infop info, Source& source, Image& image) {
  if (setjmp(png_jmpbuf(png))) return false;
  png_set_read_fn(png, &source, take_bytes);
  png_set_user_limits(png, 1 << 20, 1 << 20);
  png_read_info(png, info);
  const std::uint64_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
  if (width * height > max_pixels) png_error(png, "it has more than 2^28 pixels");
  png_set_expand(png);
  png_set_scale_16(png);
  png_set_gray_to_rgb(png);
  png_color_16 white{};
  white.red = white.green = white.blue = white.gray = 255;
  png_set_background(png, &white, PNG_BACKGROUND_GAMMA_SCREEN, 0, 1.0);
  const int passes = png_set_interlace_handling(png);
  png_read_update_info(png, info);
  if (png_get_rowbytes(png, info) != width * 3) png_error(png, "its pixels are of an unknown kind");
  image.width = static_cast<int>(width);
  image.height = static_cast<int>(height);
  image.rgb.assign(width * height * 3, 0);
  for (int pass = 0; pass < passes; ++pass) {
    for (std::uint64_t y = 0; y < height; ++y) png_read_row(png, image.rgb.data() + y * width * 3, nullptr);
  }
  png_read_end(png, nullptr);
  return true;
}

}  // namespace

std::string encode_png(const Image& image) {
  const auto pixels = static_cast<std::uint64_t>(image.width) * static_cast<std::uint64_t>(image.height);
  if (image.width < 1 || image.height < 1 || pixels > max_pixels || image.rgb.size() != pixels * 3) {
    throw InputError("an image of " + std::to_string(image.width) + " x " + std::to_string(image.height) +
                     " pixels with " + std::to_string(image.rgb.size()) +
                     " bytes cannot be written; expected width*height*3 bytes and at most 2^28 pixels");
  }
  PngMessage message;
  std::string bytes;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, keep_message, ignore_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  const bool done = info && encode_rows(png, info, image, bytes);
  png_destroy_write_struct(&png, &info);
  if (!done) throw EnvironmentError(std::string("libpng could not make the picture: ") + message.text);
  return bytes;
}

Image decode_png(const std::string& bytes, const std::string& name) {
  if (bytes.size() < 8 || png_sig_cmp(reinterpret_cast<png_const_bytep>(bytes.data()), 0, 8) != 0) {
    throw InputError(name + " is not a PNG picture (its first 8 bytes are not PNG's)");
  }
  PngMessage message;
  Image image;
  Source source{bytes, 0};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, keep_message, ignore_warning);
  png_infop info = png ? png_create_info_struct(png) : nullptr;
  const bool done = info && decode_rows(png, info, source, image);
  png_destroy_read_struct(&png, &info, nullptr);
  if (!done) throw InputError(name + " cannot be read as PNG: " + message.text);
  return image;
}

void write_png(const Image& image, const std::filesystem::path& path) {
  write_file_atomically(path, encode_png(image));
}

Image read_png(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path.string() + " cannot be read; give the path of a PNG picture");
  std::ostringstream bytes;
  bytes << file.rdbuf();
  return decode_png(bytes.str(), path.string());
}

}  // namespace sulcus
