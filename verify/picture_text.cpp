// Title, legend and colour bar, in DejaVu Sans by FreeType, unhinted so that the glyphs do not depend on
// settings.
#include <ft2build.h>
//
#include FT_FREETYPE_H

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "engine/numerics/error.h"
#include "verify/picture_parts.h"

namespace sulcus::picture {
namespace {

constexpr Colour ink{38, 42, 52}, pale_ink{86, 92, 106}, rim_colour{242, 243, 246};

struct Font {
  FT_Library library = nullptr;
  FT_Face regular = nullptr, bold = nullptr;

  Font() {
    if (FT_Init_FreeType(&library) != 0)
      throw EnvironmentError("FreeType does not start; reinstall libfreetype6");
    regular = load("DejaVuSans.ttf");
    bold = load("DejaVuSans-Bold.ttf");
  }
  ~Font() { FT_Done_FreeType(library); }
  Font(const Font&) = delete;
  Font& operator=(const Font&) = delete;

  FT_Face load(const std::string& name) {
    const std::string path = std::string(SULCUS_FONT_DIR) + "/" + name;
    FT_Face face = nullptr;
    if (FT_New_Face(library, path.c_str(), 0, &face) != 0) {
      FT_Done_FreeType(library);
      throw EnvironmentError("the font " + path +
                             " cannot be read; install DejaVu (Debian: fonts-dejavu-core)");
    }
    return face;
  }
};

// Next code point of UTF-8; bytes that are none give the replacement character.
std::uint32_t next_character(const std::string& text, std::size_t& at) {
  const auto first = static_cast<unsigned char>(text[at++]);
  if (first < 0x80) return first;
  const int following = first >= 0xf0 ? 3 : first >= 0xe0 ? 2 : first >= 0xc0 ? 1 : 0;
  if (following == 0) return 0xfffd;
  std::uint32_t code = first & (0x3fu >> following);
  for (int i = 0; i < following; ++i) {
    if (at >= text.size() || (static_cast<unsigned char>(text[at]) & 0xc0) != 0x80) return 0xfffd;
    code = code << 6 | (static_cast<unsigned char>(text[at++]) & 0x3fu);
  }
  return code;
}

void blend(Image& image, int x, int y, const Colour& colour, int cover) {
  if (x < 0 || y < 0 || x >= image.width || y >= image.height) return;
  std::uint8_t* pixel = &image.rgb[(static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                                    static_cast<std::size_t>(x)) *
                                   3];
  for (std::size_t c = 0; c < 3; ++c) {
    pixel[c] = static_cast<std::uint8_t>((pixel[c] * (255 - cover) + colour[c] * cover + 127) / 255);
  }
}

// Draws from pen position x (26.6 fixed point would be lost on whole pixels: unhinted glyphs are placed at
// 1/64 px) with the baseline at y; with image == nullptr only measures. Returns the width in pixels.
double text_line(Image* image, FT_Face face, double size_px, double x, double y, const std::string& text,
                 const Colour& colour) {
  FT_Set_Char_Size(face, 0, static_cast<FT_F26Dot6>(size_px * 64), 72, 72);
  FT_Pos pen = static_cast<FT_Pos>(x * 64);
  const FT_Pos start = pen;
  FT_UInt before = 0;
  for (std::size_t at = 0; at < text.size();) {
    const FT_UInt glyph = FT_Get_Char_Index(face, next_character(text, at));
    FT_Vector kern{0, 0};
    if (before && glyph) FT_Get_Kerning(face, before, glyph, FT_KERNING_UNFITTED, &kern);
    pen += kern.x;
    before = glyph;
    FT_Vector shift{pen & 63, 0};
    FT_Set_Transform(face, nullptr, &shift);
    if (FT_Load_Glyph(face, glyph, FT_LOAD_NO_HINTING | FT_LOAD_NO_BITMAP) != 0) continue;
    const FT_Pos advance = face->glyph->linearHoriAdvance / 1024;  // 16.16 px -> 26.6
    if (image && FT_Render_Glyph(face->glyph, FT_RENDER_MODE_NORMAL) == 0) {
      const FT_Bitmap& bitmap = face->glyph->bitmap;
      const int left = static_cast<int>(pen >> 6) + face->glyph->bitmap_left;
      const int top = static_cast<int>(std::lround(y)) - face->glyph->bitmap_top;
      for (int row = 0; row < static_cast<int>(bitmap.rows); ++row) {
        for (int column = 0; column < static_cast<int>(bitmap.width); ++column) {
          blend(*image, left + column, top + row, colour, bitmap.buffer[row * bitmap.pitch + column]);
        }
      }
    }
    pen += advance;
  }
  return static_cast<double>(pen - start) / 64;
}

// Text with a pale rim, readable on whatever lies behind.
void rimmed_line(Image& image, FT_Face face, double size_px, double x, double y, const std::string& text,
                 const Colour& colour) {
  const double rim = std::max(1.0, size_px / 14);
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if (dx || dy) text_line(&image, face, size_px, x + dx * rim, y + dy * rim, text, rim_colour);
    }
  }
  text_line(&image, face, size_px, x, y, text, colour);
}

void fill_rounded(Image& image, double x0, double y0, double x1, double y1, double radius,
                  const Colour& colour) {
  for (int y = static_cast<int>(y0) - 1; y <= static_cast<int>(y1) + 1; ++y) {
    for (int x = static_cast<int>(x0) - 1; x <= static_cast<int>(x1) + 1; ++x) {
      // Distance of the pixel's centre to the rounded rectangle.
      const double dx = std::max({x0 + radius - (x + 0.5), x + 0.5 - (x1 - radius), 0.0});
      const double dy = std::max({y0 + radius - (y + 0.5), y + 0.5 - (y1 - radius), 0.0});
      const double outside = std::sqrt(dx * dx + dy * dy) - radius;
      blend(image, x, y, colour, static_cast<int>(255 * std::clamp(0.5 - outside, 0.0, 1.0)));
    }
  }
}

// A step of 1, 2 or 5 times a power of ten that cuts the range into about five.
double tick_step(double range) {
  const double rough = range / 5, power = std::pow(10.0, std::floor(std::log10(rough)));
  const double share = rough / power;
  return (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10) * power;
}

struct Prefix {
  double factor;
  const char* letter;
};

Prefix unit_prefix(double largest, const std::string& unit) {
  if (unit.empty()) return {1, ""};
  for (const Prefix& prefix : {Prefix{1e9, "G"}, {1e6, "M"}, {1e3, "k"}, {1, ""}, {1e-3, "m"}, {1e-6, "µ"}}) {
    if (largest >= prefix.factor) return prefix;
  }
  return {1e-9, "n"};
}

std::string number(double value, double step) {
  const int decimals = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  char text[64];
  std::snprintf(text, sizeof(text), "%.*f", decimals, value);
  return text;
}

void draw_colour_bar(Font& font, const ColourBar& bar, double unit_px, Image& image) {
  const double size = 16 * unit_px, top = 0.22 * image.height, bottom = 0.78 * image.height;
  const double width = 14 * unit_px, right = image.width - 84 * unit_px, left = right - width;
  for (int y = static_cast<int>(top); y < static_cast<int>(bottom); ++y) {
    const Colour colour = colour_of(bar.map, 1 - (y + 0.5 - top) / (bottom - top));
    for (int x = static_cast<int>(left); x < static_cast<int>(right); ++x) blend(image, x, y, colour, 255);
  }
  const double range = bar.high - bar.low;
  const Prefix prefix = unit_prefix(std::max(std::abs(bar.low), std::abs(bar.high)), bar.unit);
  if (range > 0 && std::isfinite(range)) {
    const double step = tick_step(range / prefix.factor), low = bar.low / prefix.factor;
    const double span = range / prefix.factor;
    for (double tick = std::ceil(low / step - 1e-9) * step; tick <= low + span * (1 + 1e-9); tick += step) {
      const double y = bottom - (bottom - top) * (tick - low) / span;
      const double shown = std::abs(tick) < 1e-9 * step ? 0 : tick;
      fill_rounded(image, right + 2 * unit_px, y - 0.5 * unit_px, right + 6 * unit_px, y + 0.5 * unit_px, 0,
                   ink);
      rimmed_line(image, font.regular, size, right + 10 * unit_px, y + 0.36 * size, number(shown, step), ink);
    }
  }
  const std::string unit = bar.unit.empty() ? "" : " [" + std::string(prefix.letter) + bar.unit + "]";
  const std::string title = bar.title + unit;
  const double title_width = text_line(nullptr, font.regular, size, 0, 0, title, ink);
  rimmed_line(image, font.regular, size, image.width - 22 * unit_px - title_width, top - 14 * unit_px, title,
              ink);
}

void draw_legend(Font& font, const std::vector<LegendEntry>& legend, double unit_px, Image& image) {
  const double size = 16 * unit_px, line = 25 * unit_px, swatch = 14 * unit_px, left = 22 * unit_px;
  double y = image.height - 22 * unit_px - line * static_cast<double>(legend.size() - 1);
  for (const LegendEntry& entry : legend) {
    const double middle = y - 0.36 * size;
    fill_rounded(image, left, middle - swatch / 2, left + swatch, middle + swatch / 2, 3 * unit_px,
                 entry.colour);
    rimmed_line(image, font.regular, size, left + swatch + 9 * unit_px, y, entry.text, ink);
    y += line;
  }
}

}  // namespace

void draw_texts(const PictureScene& scene, Image& image) {
  if (scene.title.empty() && scene.subtitle.empty() && scene.legend.empty() && !scene.colour_bar) return;
  Font font;
  const double unit_px = std::max(0.6, image.height / 720.0);
  if (!scene.title.empty()) {
    rimmed_line(image, font.bold, 24 * unit_px, 22 * unit_px, 40 * unit_px, scene.title, ink);
  }
  if (!scene.subtitle.empty()) {
    const double y = scene.title.empty() ? 34 : 66;
    rimmed_line(image, font.regular, 17 * unit_px, 22 * unit_px, y * unit_px, scene.subtitle, pale_ink);
  }
  if (!scene.legend.empty()) draw_legend(font, scene.legend, unit_px, image);
  if (scene.colour_bar) draw_colour_bar(font, *scene.colour_bar, unit_px, image);
}

}  // namespace sulcus::picture
