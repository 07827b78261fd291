// Rasterising with OSMesa. The light is computed in square-root space (a colour byte squared is near enough
// to linear light, and exact arithmetic); nothing here depends on the number of threads.
#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>
//
#include <GL/gl.h>
#include <GL/glext.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <string>

#include "engine/numerics/error.h"
#include "verify/picture_parts.h"

namespace sulcus::picture {
namespace {

constexpr const char* vertex_shader = R"(#version 130
in vec3 position; in vec3 normal; in vec3 colour;
out vec3 eye_position, eye_normal, base;
uniform vec4 projection;  // x scale, y scale, z scale, z offset
void main() {
  eye_position = position; eye_normal = normal; base = colour * colour;
  gl_Position = vec4(position.x * projection.x, position.y * projection.y,
                     position.z * projection.z + projection.w, -position.z);
}
)";

constexpr const char* fragment_shader = R"(#version 130
in vec3 eye_position, eye_normal, base;
out vec4 pixel;
uniform int finish;      // 0 tissue, 1 metal, 2 plain, 3 flat
uniform vec4 clip;       // all zero: keeps everything
uniform float opacity;

float square(float x) { return x * x; }

vec3 soft_light(vec3 n, vec3 v, float wrap, float gloss) {
  vec3 key = normalize(vec3(-0.45, 0.65, 0.8)), fill = normalize(vec3(0.8, 0.1, 0.55));
  float k = max(0.0, (dot(n, key) + wrap) / (1.0 + wrap)), f = max(0.0, (dot(n, fill) + wrap) / (1.0 + wrap));
  vec3 sky = mix(vec3(0.16, 0.14, 0.15), vec3(0.30, 0.31, 0.34), n.y * 0.5 + 0.5);
  vec3 light = base * (vec3(0.80, 0.78, 0.75) * k + vec3(0.17, 0.18, 0.21) * f + sky);
  float h = max(0.0, dot(n, normalize(key + v)));
  h = h * h; h = h * h; h = h * h; h = h * h; h = h * h;  // 32nd power
  return light + vec3(gloss * h);
}

vec3 steel(vec3 n, vec3 v) {
  vec3 r = reflect(-v, n);
  float sky = smoothstep(-0.5, 0.6, r.y), window = smoothstep(0.5, 0.95, dot(r, normalize(vec3(-0.5, 0.7, 0.6))));
  vec3 seen = mix(vec3(0.20, 0.21, 0.24), vec3(0.66, 0.68, 0.72), sky) + vec3(0.6) * window;
  float lit = max(0.0, dot(n, normalize(vec3(-0.45, 0.65, 0.8)))), edge = square(square(1.0 - max(0.0, dot(n, v))));
  return base * (0.75 * seen + 0.35 * lit + 0.08) + vec3(0.3 * edge);
}

void main() {
  if (dot(clip.xyz, eye_position) + clip.w < 0.0) discard;
  vec3 n = normalize(eye_normal), v = normalize(-eye_position);
  if (!gl_FrontFacing && finish != 3) n = -n;
  vec3 light;
  if (finish == 0) {
    light = soft_light(n, v, 0.35, 0.16);
    light += base * vec3(0.10, 0.03, 0.02) * square(1.0 - max(0.0, dot(n, v)));  // light that went through the rim
  } else if (finish == 1) light = steel(n, v);
  else if (finish == 2) light = soft_light(n, v, 0.15, 0.08);
  else light = base;
  pixel = vec4(sqrt(clamp(light, 0.0, 1.0)), opacity);
}
)";

[[noreturn]] void refuse(const std::string& what) {
  throw EnvironmentError("no picture can be drawn: " + what +
                         "; install OSMesa (Debian: libosmesa6) and unset GALLIUM_DRIVER");
}

// An OSMesa context with its pixels; gone with the object.
struct Context {
  OSMesaContext context = nullptr;
  std::vector<std::uint8_t> rgba;

  Context(int width, int height)
      : rgba(static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * 4) {
    const int wanted[] = {OSMESA_FORMAT,
                          OSMESA_RGBA,
                          OSMESA_DEPTH_BITS,
                          24,
                          OSMESA_STENCIL_BITS,
                          8,
                          OSMESA_PROFILE,
                          OSMESA_COMPAT_PROFILE,
                          0};
    context = OSMesaCreateContextAttribs(wanted, nullptr);
    if (!context) refuse("OSMesa gives no context");
    if (!OSMesaMakeCurrent(context, rgba.data(), GL_UNSIGNED_BYTE, width, height)) {
      OSMesaDestroyContext(context);
      refuse("OSMesa refuses an image of " + std::to_string(width) + " x " + std::to_string(height));
    }
    const auto* renderer = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
    if (!renderer || std::string(renderer).find("llvmpipe") == std::string::npos) {
      const std::string name = renderer ? renderer : "nothing";
      OSMesaDestroyContext(context);
      refuse("the rasteriser is '" + name + "' instead of llvmpipe, so the pixels would differ");
    }
  }
  ~Context() {
    OSMesaMakeCurrent(nullptr, nullptr, 0, 0, 0);
    OSMesaDestroyContext(context);
  }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
};

GLuint compile(GLenum kind, const char* text) {
  const GLuint shader = glCreateShader(kind);
  glShaderSource(shader, 1, &text, nullptr);
  glCompileShader(shader);
  GLint good = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
  if (!good) {
    char log[500] = "";
    glGetShaderInfoLog(shader, sizeof(log), nullptr, log);
    refuse(std::string("a shader is refused: ") + log);
  }
  return shader;
}

constexpr GLuint position_slot = 0, normal_slot = 1, colour_slot = 2;

struct Program {
  GLuint id = 0;
  GLint projection = 0, finish = 0, clip = 0, opacity = 0;
};

Program make_program() {
  Program program;
  program.id = glCreateProgram();
  glAttachShader(program.id, compile(GL_VERTEX_SHADER, vertex_shader));
  glAttachShader(program.id, compile(GL_FRAGMENT_SHADER, fragment_shader));
  glBindAttribLocation(program.id, position_slot, "position");
  glBindAttribLocation(program.id, normal_slot, "normal");
  glBindAttribLocation(program.id, colour_slot, "colour");
  glLinkProgram(program.id);
  GLint good = 0;
  glGetProgramiv(program.id, GL_LINK_STATUS, &good);
  if (!good) refuse("the shaders do not link");
  program.projection = glGetUniformLocation(program.id, "projection");
  program.finish = glGetUniformLocation(program.id, "finish");
  program.clip = glGetUniformLocation(program.id, "clip");
  program.opacity = glGetUniformLocation(program.id, "opacity");
  return program;
}

void set_clip(const Program& program, const RasterScene& scene, bool clipped) {
  if (clipped && scene.has_clip) {
    glUniform4fv(program.clip, 1, scene.clip.data());
  } else {
    glUniform4f(program.clip, 0, 0, 0, 0);
  }
}

void set_colour(const Colour& colour) {
  glDisableVertexAttribArray(colour_slot);
  glVertexAttrib3f(colour_slot, static_cast<float>(colour[0]) / 255, static_cast<float>(colour[1]) / 255,
                   static_cast<float>(colour[2]) / 255);
}

void draw_triangles(const EyeMesh& mesh) {
  glEnableVertexAttribArray(position_slot);
  glEnableVertexAttribArray(normal_slot);
  glEnableVertexAttribArray(colour_slot);
  glVertexAttribPointer(position_slot, 3, GL_FLOAT, GL_FALSE, 0, mesh.positions.data());
  glVertexAttribPointer(normal_slot, 3, GL_FLOAT, GL_FALSE, 0, mesh.normals.data());
  glVertexAttribPointer(colour_slot, 3, GL_UNSIGNED_BYTE, GL_TRUE, 0, mesh.colours.data());
  glDrawArrays(GL_TRIANGLES, 0, static_cast<GLsizei>(mesh.positions.size() / 3));
}

// Closes the cut of a clipped mesh: along a ray, as many walls are left behind as met, except where the plane
// goes through the inside; the stencil counts them, then a part of the plane is drawn where the count is not
// zero; then what is painted on it, if anything.
void draw_cut(const Program& program, const RasterScene& scene, const EyeMesh& mesh, const EyeMesh* painted) {
  glClear(GL_STENCIL_BUFFER_BIT);
  glEnable(GL_STENCIL_TEST);
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  glDepthMask(GL_FALSE);
  glDisable(GL_DEPTH_TEST);
  glStencilFunc(GL_ALWAYS, 0, 0xff);
  glStencilOpSeparate(GL_FRONT, GL_KEEP, GL_KEEP, GL_DECR_WRAP);
  glStencilOpSeparate(GL_BACK, GL_KEEP, GL_KEEP, GL_INCR_WRAP);
  set_clip(program, scene, true);
  draw_triangles(mesh);

  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_TRUE);
  glEnable(GL_DEPTH_TEST);
  glStencilFunc(GL_NOTEQUAL, 0, 0xff);
  glStencilOp(GL_KEEP, GL_KEEP, GL_KEEP);
  set_clip(program, scene, false);
  const Vec3 normal(scene.clip[0], scene.clip[1], scene.clip[2]);
  int least = 0;
  normal.cwiseAbs().minCoeff(&least);
  const Vec3 u = normal.cross(Vec3::Unit(least)).normalized() * 4.0 * scene.far_m;
  const Vec3 v = normal.cross(u);
  // The point of the plane nearest to the middle of the view.
  const Vec3 middle(0, 0, -0.5 * (scene.near_m + scene.far_m));
  const Vec3 foot = middle - (normal.dot(middle) + scene.clip[3]) * normal;
  const Vec3 corners[4] = {foot - u - v, foot + u - v, foot + u + v, foot - u + v};
  std::vector<float> positions;
  for (const int c : {0, 1, 2, 0, 2, 3}) {
    for (int d = 0; d < 3; ++d) positions.push_back(static_cast<float>(corners[c][d]));
  }
  glUniform1i(program.finish, static_cast<int>(Finish::flat));
  set_colour(mesh.cut_colour);
  glDisableVertexAttribArray(normal_slot);
  // The cut is seen from the side that was taken away.
  glVertexAttrib3f(normal_slot, -scene.clip[0], -scene.clip[1], -scene.clip[2]);
  glVertexAttribPointer(position_slot, 3, GL_FLOAT, GL_FALSE, 0, positions.data());
  glFrontFace(scene.clip[3] < 0 ? GL_CW : GL_CCW);
  glDrawArrays(GL_TRIANGLES, 0, 6);
  glFrontFace(GL_CCW);
  if (painted) {
    glUniform1i(program.finish, static_cast<int>(painted->finish));
    draw_triangles(*painted);
  }
  glDisable(GL_STENCIL_TEST);
}

// First what is hidden, paler; then what is seen.
void draw_marks(const Program& program, const RasterScene& scene) {
  set_clip(program, scene, false);
  glEnable(GL_CULL_FACE);
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
  for (const bool hidden : {true, false}) {
    glDepthFunc(hidden ? GL_GREATER : GL_LESS);
    glDepthMask(hidden ? GL_FALSE : GL_TRUE);
    glUniform1f(program.opacity, hidden ? 0.45f : 1.0f);
    for (const EyeMesh& mark : scene.marks) {
      glUniform1i(program.finish, static_cast<int>(mark.finish));
      draw_triangles(mark);
    }
  }
  glDisable(GL_BLEND);
  glDisable(GL_CULL_FACE);
  glUniform1f(program.opacity, 1);
}

void draw_lines(const Program& program, const RasterScene& scene) {
  glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ZERO, GL_ONE);
  glUniform1i(program.finish, static_cast<int>(Finish::flat));
  glDisableVertexAttribArray(normal_slot);
  glVertexAttrib3f(normal_slot, 0, 0, 1);
  for (const EyeLines& lines : scene.lines) {
    if (lines.positions.empty()) continue;
    set_clip(program, scene, lines.clipped);
    set_colour(lines.colour);
    glUniform1f(program.opacity, lines.opacity);
    glLineWidth(lines.width);
    glEnableVertexAttribArray(position_slot);
    glVertexAttribPointer(position_slot, 3, GL_FLOAT, GL_FALSE, 0, lines.positions.data());
    glDrawArrays(GL_LINES, 0, static_cast<GLsizei>(lines.positions.size() / 3));
  }
  glDisable(GL_BLEND);
}

// A soft light behind the scene, brightest in the middle.
void draw_background(const RasterScene& scene) {
  const auto columns = static_cast<std::size_t>(scene.width);
  std::vector<std::uint8_t> rgba(columns * static_cast<std::size_t>(scene.height) * 4, 255);
  const float cx = 0.5f * static_cast<float>(scene.width), cy = 0.55f * static_cast<float>(scene.height);
  const float reach = cx * cx + cy * cy;
#pragma omp parallel for schedule(static)
  for (int y = 0; y < scene.height; ++y) {
    for (int x = 0; x < scene.width; ++x) {
      const float dx = static_cast<float>(x) - cx, dy = static_cast<float>(y) - cy;
      const float share = std::min(1.0f, (dx * dx + dy * dy) / reach);
      // A fine pattern instead of rounding: the average of the sub-pixels takes in-between values, no bands.
      const float pattern = static_cast<float>((x % 4) * 4 + y % 4) / 16.0f;
      std::uint8_t* pixel = &rgba[(static_cast<std::size_t>(y) * columns + static_cast<std::size_t>(x)) * 4];
      for (std::size_t c = 0; c < 3; ++c) {
        const auto from = static_cast<float>(scene.background_centre[c]);
        const auto to = static_cast<float>(scene.background_edge[c]);
        pixel[c] = static_cast<std::uint8_t>(from + (to - from) * share + pattern);
      }
    }
  }
  glDepthMask(GL_FALSE);
  glDisable(GL_DEPTH_TEST);
  glRasterPos2f(-1, -1);
  glDrawPixels(scene.width, scene.height, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
  glEnable(GL_DEPTH_TEST);
  glDepthMask(GL_TRUE);
}

// Depth along the view axis from the depth buffer's share of [near, far]; 0 where nothing was drawn.
std::vector<float> read_depth(const RasterScene& scene) {
  std::vector<float> depth(static_cast<std::size_t>(scene.width) * static_cast<std::size_t>(scene.height));
  glReadPixels(0, 0, scene.width, scene.height, GL_DEPTH_COMPONENT, GL_FLOAT, depth.data());
  const float n = scene.near_m, f = scene.far_m;
#pragma omp parallel for schedule(static)
  for (std::size_t p = 0; p < depth.size(); ++p) {
    depth[p] = depth[p] < 1 ? n * f / (f - depth[p] * (f - n)) : 0;
  }
  return depth;
}

}  // namespace

Raster rasterise(const RasterScene& scene) {
  Context context(scene.width, scene.height);
  glViewport(0, 0, scene.width, scene.height);
  glClearColor(0, 0, 0, 0);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT | GL_STENCIL_BUFFER_BIT);
  glDisable(GL_DITHER);
  glPixelStorei(GL_PACK_ALIGNMENT, 1);
  draw_background(scene);

  const Program program = make_program();
  glUseProgram(program.id);
  const float n = scene.near_m, f = scene.far_m, across = 1 / scene.tan_half_view;
  glUniform4f(program.projection, across * static_cast<float>(scene.height) / static_cast<float>(scene.width),
              across, (f + n) / (n - f), 2 * f * n / (n - f));
  glUniform1f(program.opacity, 1);
  if (!scene.lines.empty()) {
    // Surfaces step back a little, so that lines on them are seen whole.
    glEnable(GL_POLYGON_OFFSET_FILL);
    glPolygonOffset(1, 1);
  }
  for (std::size_t m = 0; m < scene.meshes.size(); ++m) {
    const EyeMesh& mesh = scene.meshes[m];
    if (mesh.positions.empty() || mesh.on_cut) continue;
    const EyeMesh* next = m + 1 < scene.meshes.size() ? &scene.meshes[m + 1] : nullptr;
    set_clip(program, scene, mesh.clipped);
    glUniform1i(program.finish, static_cast<int>(mesh.finish));
    if (!mesh.section_only) draw_triangles(mesh);
    if (mesh.clipped && scene.has_clip) draw_cut(program, scene, mesh, next && next->on_cut ? next : nullptr);
  }
  Raster raster;
  raster.width = scene.width;
  raster.height = scene.height;
  raster.depth = read_depth(scene);  // before marks and lines: they cast no shadow
  draw_marks(program, scene);
  draw_lines(program, scene);
  glFinish();
  const GLenum error = glGetError();
  if (error != GL_NO_ERROR) refuse("OpenGL reports error " + std::to_string(error));
  raster.rgba = std::move(context.rgba);
  return raster;
}

}  // namespace sulcus::picture
