#include "verify/picture.h"

#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <numbers>

#include "engine/numerics/error.h"
#include "verify/picture_diff.h"

namespace sulcus {
namespace {

Colour pixel(const Image& image, int x, int y) {
  const std::size_t p =
      (static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x)) * 3;
  return {image.rgb[p], image.rgb[p + 1], image.rgb[p + 2]};
}

PictureScene small_scene() {
  PictureScene scene;
  scene.width = 160;
  scene.height = 120;
  scene.camera.eye = {0, 0, 1};
  return scene;
}

// A square around the axis of view at height z, facing the viewer.
PictureMesh square(double half, double z, const Colour& colour) {
  PictureMesh mesh;
  mesh.positions = {{-half, -half, z}, {half, -half, z}, {half, half, z}, {-half, half, z}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.colour = colour;
  mesh.finish = Finish::flat;
  return mesh;
}

// A closed ball with normals out, made of squares on a cube's faces pushed onto the sphere.
PictureMesh ball(double radius, int cuts) {
  PictureMesh mesh;
  for (int face = 0; face < 6; ++face) {
    const int axis = face / 2;
    const double side = face % 2 ? 1 : -1;
    const auto first = static_cast<std::int32_t>(mesh.positions.size());
    for (int j = 0; j <= cuts; ++j) {
      for (int i = 0; i <= cuts; ++i) {
        Vec3 p;
        p[axis] = side;
        p[(axis + 1) % 3] = side * (2.0 * i / cuts - 1);
        p[(axis + 2) % 3] = 2.0 * j / cuts - 1;
        mesh.positions.push_back(radius * p.normalized());
      }
    }
    for (std::int32_t j = 0; j < cuts; ++j) {
      for (std::int32_t i = 0; i < cuts; ++i) {
        const std::int32_t a = first + j * (cuts + 1) + i, b = a + 1, c = b + cuts + 1, d = c - 1;
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({a, c, d});
      }
    }
  }
  mesh.finish = Finish::tissue;
  return mesh;
}

PictureScene rich_scene() {
  PictureScene scene = small_scene();
  scene.meshes = {ball(0.15, 12)};
  scene.meshes[0].clipped = true;
  scene.meshes.push_back(square(0.05, 0.2, {200, 210, 220}));
  scene.meshes[1].finish = Finish::metal;
  scene.clip = ClipPlane{{-1, 0, -1}, -0.1};
  scene.arrows = {{{0, 0, 0.2}, {0.1, 0.1, 0.3}, 0.004, {250, 180, 0}}};
  scene.spheres = {{{-0.1, 0.1, 0.2}, 0.02, {250, 220, 0}}};
  scene.lines = {{{{-0.2, -0.2, 0.1}, {0.2, 0.2, 0.1}}, {{0, 1}}, {0, 0, 0}, 1, 0.5, false}};
  scene.title = "Title";
  scene.legend = {{{200, 0, 0}, "red"}};
  scene.colour_bar = ColourBar{"stress", "Pa", 0, 1234, ColourMap::ember};
  return scene;
}

TEST(Picture, TheSameSceneGivesTheSameBytes) {
  const PictureScene scene = rich_scene();
  const Image first = render_picture(scene);
  EXPECT_EQ(render_picture(scene).rgb, first.rgb);
  const int threads = omp_get_max_threads();
  for (const int n : {1, 3}) {
    omp_set_num_threads(n);
    EXPECT_EQ(render_picture(scene).rgb, first.rgb) << n << " threads";
  }
  omp_set_num_threads(threads);
}

TEST(Picture, ATriangleInFrontCoversTheMiddle) {
  PictureScene scene = small_scene();
  PictureMesh triangle;
  triangle.positions = {{-0.2, -0.2, 0}, {0.2, -0.2, 0}, {0, 0.2, 0}};
  triangle.triangles = {{0, 1, 2}};
  triangle.colour = {255, 0, 0};
  triangle.finish = Finish::flat;
  scene.meshes = {triangle};
  scene.occlusion = false;
  EXPECT_EQ(pixel(render_picture(scene), 80, 60), (Colour{255, 0, 0}));
}

TEST(Picture, ACameraThatLooksAwaySeesTheBackgroundAlone) {
  PictureScene scene = small_scene();
  const Image empty = render_picture(scene);
  scene.meshes = {ball(0.2, 8)};
  EXPECT_NE(render_picture(scene).rgb, empty.rgb);
  scene.camera.target = {0, 0, 2};
  EXPECT_EQ(render_picture(scene).rgb, empty.rgb);
}

TEST(Picture, NearThingsHideFarOnesInAnyOrder) {
  PictureScene scene = small_scene();
  scene.occlusion = false;
  const PictureMesh near_one = square(0.05, 0.2, {0, 255, 0}), far_one = square(0.3, -0.2, {0, 0, 255});
  for (const bool near_first : {true, false}) {
    scene.meshes = near_first ? std::vector{near_one, far_one} : std::vector{far_one, near_one};
    const Image image = render_picture(scene);
    EXPECT_EQ(pixel(image, 80, 60), (Colour{0, 255, 0}));
    EXPECT_EQ(pixel(image, 30, 60), (Colour{0, 0, 255}));
  }
}

TEST(Picture, UpIsUpAndRightIsRight) {
  PictureScene scene = small_scene();
  scene.occlusion = false;
  PictureMesh mark = square(0.03, 0, {255, 0, 0});
  for (Vec3& p : mark.positions) p += Vec3(0.15, 0.1, 0);
  scene.meshes = {mark};
  const Image image = render_picture(scene);
  // tan(15 deg) = 0.268 is half the height of 120 pixels at a distance of 1 m.
  EXPECT_EQ(pixel(image, 80 + 34, 60 - 22), (Colour{255, 0, 0}));
  EXPECT_NE(pixel(image, 80 - 34, 60 - 22), (Colour{255, 0, 0}));
  EXPECT_NE(pixel(image, 80 + 34, 60 + 22), (Colour{255, 0, 0}));
}

TEST(Picture, ABallCoversTheAreaOfItsOutline) {
  const double radius = 0.2;
  PictureScene scene = small_scene();
  scene.background_centre = scene.background_edge = {255, 255, 255};
  scene.meshes = {ball(radius, 40)};
  scene.meshes[0].finish = Finish::flat;
  scene.meshes[0].colour = {0, 0, 0};
  const Image image = render_picture(scene);
  double area = 0;
  for (std::size_t p = 0; p < image.rgb.size(); p += 3) area += (255 - image.rgb[p]) / 255.0;
  // From 1 m, the outline is a circle of half angle asin(radius).
  const double pixels =
      std::tan(std::asin(radius)) / std::tan(15 * std::numbers::pi / 180) * scene.height / 2;
  const double expected = std::numbers::pi * pixels * pixels;
  EXPECT_NEAR(area, expected, 0.01 * expected);
}

TEST(Picture, TheCutIsClosedByItsOwnColour) {
  PictureScene scene = small_scene();
  scene.occlusion = false;
  scene.meshes = {ball(0.2, 20)};
  scene.meshes[0].clipped = true;
  scene.meshes[0].cut_colour = {10, 20, 240};
  const Image whole = render_picture(scene);
  scene.clip = ClipPlane{{0, 0, -2}, 0};  // keeps the half away from the viewer
  const Image cut = render_picture(scene);
  EXPECT_NE(pixel(whole, 80, 60), (Colour{10, 20, 240}));
  EXPECT_EQ(pixel(cut, 80, 60), (Colour{10, 20, 240}));
  EXPECT_EQ(pixel(cut, 2, 2), pixel(whole, 2, 2));
  // From behind the ball is whole.
  scene.camera.eye = {0, 0, -1};
  const Image behind = render_picture(scene);
  EXPECT_NE(pixel(behind, 80, 60), (Colour{10, 20, 240}));
}

TEST(Picture, ThingsInsideTheCutAwayPartAreSeenBeforeTheCut) {
  PictureScene scene = small_scene();
  scene.occlusion = false;
  scene.meshes = {ball(0.2, 20), square(0.03, 0.1, {0, 255, 0}), square(0.3, -0.05, {255, 0, 0})};
  scene.meshes[0].clipped = true;
  scene.meshes[0].cut_colour = {10, 20, 240};
  scene.clip = ClipPlane{{0, 0, -1}, 0};
  const Image image = render_picture(scene);
  EXPECT_EQ(pixel(image, 80, 60), (Colour{0, 255, 0}));
  EXPECT_EQ(pixel(image, 80, 85), (Colour{10, 20, 240}));  // the cut hides the square behind it
}

TEST(Picture, HollowsAreDarkerThanPlanes) {
  PictureScene scene = small_scene();
  const Colour grey{180, 180, 180};
  // A square well in a plane, seen from above.
  scene.meshes = {square(0.3, -0.1, grey)};
  const Colour open = pixel(render_picture(scene), 80, 60);
  for (const Vec3& shift : {Vec3(0.345, 0, 0), Vec3(-0.345, 0, 0), Vec3(0, 0.345, 0), Vec3(0, -0.345, 0)}) {
    scene.meshes.push_back(square(0.33, 0, grey));
    for (Vec3& p : scene.meshes.back().positions) p += shift;
  }
  const Image well = render_picture(scene);
  EXPECT_EQ(open, grey);
  EXPECT_LT(pixel(well, 80, 60)[0], 160);
  EXPECT_GT(pixel(well, 30, 60)[0], 170);
}

TEST(Picture, TitlesStayInTheirCorner) {
  PictureScene scene = small_scene();
  const Image plain = render_picture(scene);
  scene.title = "H";
  const Image titled = render_picture(scene);
  int changed = 0, dark = 0;
  for (int y = 0; y < scene.height; ++y) {
    for (int x = 0; x < scene.width; ++x) {
      if (pixel(plain, x, y) == pixel(titled, x, y)) continue;
      ++changed;
      dark += pixel(titled, x, y)[0] < 100;
      EXPECT_LT(x, 40);
      EXPECT_LT(y, 40);
    }
  }
  EXPECT_GT(changed, 30);
  EXPECT_GT(dark, 10);
}

TEST(Picture, TrianglesThatAreNotFiniteAreLeftOut) {
  PictureScene scene = small_scene();
  const Image empty = render_picture(scene);
  scene.meshes = {square(0.1, 0, {255, 0, 0})};
  for (const double bad : {NAN, INFINITY}) {
    scene.meshes[0].positions[0].x() = bad;
    scene.meshes[0].positions[2].y() = bad;
    EXPECT_EQ(render_picture(scene).rgb, empty.rgb);
  }
}

TEST(Picture, ImpossibleScenesAreRefused) {
  const auto refused = [](auto&& change) {
    PictureScene scene = small_scene();
    scene.meshes = {square(0.1, 0, {255, 0, 0})};
    change(scene);
    EXPECT_THROW(render_picture(scene), InputError);
  };
  refused([](PictureScene& s) { s.width = 0; });
  refused([](PictureScene& s) { s.height = 1 << 20; });
  refused([](PictureScene& s) { s.supersampling = 9; });
  refused([](PictureScene& s) { s.camera.eye = s.camera.target; });
  refused([](PictureScene& s) { s.camera.up = {0, 0, 1}; });
  refused([](PictureScene& s) { s.camera.field_of_view_deg = 180; });
  refused([](PictureScene& s) { s.camera.eye.x() = NAN; });
  refused([](PictureScene& s) { s.meshes[0].triangles[0][1] = 4; });
  refused([](PictureScene& s) { s.meshes[0].triangles[0][1] = -1; });
  refused([](PictureScene& s) { s.meshes[0].vertex_colours.resize(3); });
  refused([](PictureScene& s) { s.meshes[0].triangle_colours.resize(3); });
  refused([](PictureScene& s) { s.clip = ClipPlane{Vec3::Zero(), 0}; });
  refused([](PictureScene& s) { s.lines = {{{Vec3::Zero()}, {{0, 1}}}}; });
}

TEST(Picture, FramedPointsAreAllInThePicture) {
  const std::vector<Vec3> points = {{3, 4, 5}, {3.1, 4, 5}, {3, 4.3, 5}, {3, 4, 5.2}};
  for (const double aspect : {0.5, 1.0, 2.0}) {
    const Camera camera = frame_points(points, {-1, 2, -0.5}, {0, 0, 1}, aspect);
    const Vec3 forward = (camera.target - camera.eye).normalized();
    const double half = std::tan(15 * std::numbers::pi / 180) * std::min(1.0, aspect);
    for (const Vec3& point : points) {
      const Vec3 seen = point - camera.eye;
      const double depth = seen.dot(forward);
      EXPECT_GT(depth, 0);
      EXPECT_LT((seen - depth * forward).norm() / depth, half);
    }
  }
}

TEST(ColourMaps, LightnessRisesInEvenSteps) {
  for (const ColourMap map : {ColourMap::sea, ColourMap::ember}) {
    double least = 1e9, most = 0;
    int before = -1;
    for (int i = 0; i < 16; ++i) {
      const Colour a = colour_of(map, i / 16.0), b = colour_of(map, (i + 1) / 16.0);
      const double step = colour_distance(a.data(), b.data());
      least = std::min(least, step);
      most = std::max(most, step);
      const int light = 54 * a[0] + 183 * a[1] + 19 * a[2];
      EXPECT_GT(light, before);
      before = light;
    }
    EXPECT_LT(most, 1.25 * least);  // the bytes' rounding and the gamut's corners take a little
  }
}

TEST(ColourMaps, ValuesOutsideAreTheEnds) {
  EXPECT_EQ(colour_of(ColourMap::sea, -3), colour_of(ColourMap::sea, 0));
  EXPECT_EQ(colour_of(ColourMap::sea, INFINITY), colour_of(ColourMap::sea, 1));
  EXPECT_EQ(colour_of(ColourMap::ember, NAN), (Colour{128, 128, 128}));
}

}  // namespace
}  // namespace sulcus
