// Fingerprints of builds: runs short scenes that use every part of the engine and writes what each stage of
// each step left, bit by bit; compares two such files. tools/fingerprints builds it with other compilers and
// flags.
//
//   fingerprint_probe write FILE [threads [steps [sse2|avx2|avx512]]]
//   fingerprint_probe compare FILE FILE      exit code 1 and the first difference, if there is one

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <type_traits>

#include "engine/numerics/elementary.h"
#include "engine/scene/system.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

// Before every array a line "scene step stage field type count".
struct Writer : StageObserver {
  std::ofstream& out;
  const char* scene;
  const Workspace& workspace;
  std::int64_t step = 0;

  Writer(std::ofstream& file, const char* name, const Workspace& memory)
      : out(file), scene(name), workspace(memory) {}

  template <class T>
  void array(const char* stage, std::string_view field, const T* values, std::size_t count) {
    using Type = std::remove_const_t<T>;
    const char* type = std::is_same_v<Type, double>  ? "f64"
                       : std::is_same_v<Type, float> ? "f32"
                       : sizeof(T) == 8              ? "i64"
                       : sizeof(T) == 4              ? "i32"
                                                     : "u8";
    out << scene << ' ' << step << ' ' << stage << ' ' << field << ' ' << type << ' ' << count << '\n';
    out.write(reinterpret_cast<const char*>(values), static_cast<std::streamsize>(count * sizeof(T)));
    out << '\n';
  }

  template <class Real>
  void matrix(const Numbers<Real>& numbers) {
    array("assembly", "matrix", numbers.system.values.data(), numbers.system.values.size());
    array("assembly", "diagonal", numbers.system.diagonal.data(), numbers.system.diagonal.size());
    array("assembly", "inverse", numbers.system.inverse.data(), numbers.system.inverse.size());
  }

  void stage_done(Stage stage) override {
    if (stage == Stage::contacts) {
      std::vector<double> numbers;
      for (const Contact& contact : workspace.contacts) {
        numbers.push_back(contact.tet);
        for (int d = 0; d < 3; ++d)
          numbers.insert(numbers.end(), {contact.gap[d], contact.normal[d], contact.arm[d]});
        for (double weight : contact.weights) numbers.push_back(weight);
      }
      array("contacts", "contacts", numbers.data(), numbers.size());
    } else if (stage == Stage::assembly) {
      array("assembly", "forces", workspace.forces.data(), workspace.forces.size());
      if (workspace.single) {
        matrix(*workspace.single);
      } else {
        matrix(*workspace.twice);
      }
    } else if (stage == Stage::solve) {
      array("solve", "increments", workspace.increments.data(), workspace.increments.size());
    }
  }

  void state(const State& s) {
    for_each_field(
        s, [&](std::string_view field, auto values) { array("state", field, values.data(), values.size()); });
  }
};

Tool ball(double radius_m) {
  Tool tool;
  tool.name = "ball";
  for (int i = 0; i < 200; ++i) {
    const double z = 1 - (2 * i + 1) / 200.0, r = std::sqrt(1 - z * z);
    tool.surface.vertices.emplace_back(radius_m * r * det_cos(2.4 * i), radius_m * r * det_sin(2.4 * i),
                                       radius_m * z);
  }
  return tool;
}

// Three tissues with a fissure between two, one plain linear with a damping of its own; a ball is pressed
// into it.
SceneDescription pressed(Precision precision) {
  SceneDescription d = block_description({14, 14, 14}, 0.005);
  for (int k = 0; k < 14; ++k) {
    for (int j = 0; j < 14; ++j) {
      for (int i = 0; i < 14; ++i) {
        d.map.labels[static_cast<std::size_t>((k * 14 + j) * 14 + i)] = k < 5 ? 3 : i < 7 ? 1 : 2;
      }
    }
  }
  d.pairs.pairs.push_back({1, 2});
  d.embedding.size_m = 0.01;
  d.material.youngs_modulus_Pa = 800;
  d.materials[2] = d.material;
  d.materials[2].law = Law::linear;
  d.materials[2].damping = RayleighDamping{0.5, 0.02};
  d.gravity = {0, 0.5, -1};
  for (std::int32_t node : nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; }))
    d.fixed_nodes.push_back(node);
  for (std::int32_t node : nodes_where(d, [](const Vec3& x) { return x[2] > 1e-9 && x[0] < 1e-9; }))
    d.springs.push_back({node, 0.5, 0.01});
  d.tools.push_back(ball(0.015));
  d.contact.stiffness_N_m = 30;
  d.solver.precision = precision;
  d.solver.tolerance = 1e-4;
  d.solver.first_guess = FirstGuess::past;
  return d;
}

// A bar that is pulled apart at a weak layer.
SceneDescription torn() {
  SceneDescription d = block_description({4, 4, 10}, 0.01);
  for (std::size_t i = 0; i < d.map.labels.size(); ++i) d.map.labels[i] = i / 16 == 5 ? 2 : 1;
  d.materials[2] = d.material;
  d.materials[2].fracture_threshold_Pa = 120;
  d.fracture = FractureSettings{};
  d.solver.precision = Precision::single_precision;
  d.solver.tolerance = 1e-4;
  for (std::int32_t node : nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; }))
    d.fixed_nodes.push_back(node);
  d.motions.push_back(
      straight_motion(nodes_where(d, [](const Vec3& x) { return x[2] > 0.1 - 1e-9; }), {0.01, 0, 0.03}, 12));
  return d;
}

DeviceSample hand(std::int64_t step) {
  const double down = std::fmin(1.0, static_cast<double>(step) / 12);
  DeviceSample sample;
  sample.position = Vec3(0.033 + 0.0002 * static_cast<double>(step), 0.037, 0.09 - 0.025 * down);
  sample.linear_velocity_valid = true;
  return sample;
}

void run(std::ofstream& out, const char* name, SceneDescription description, int threads, int steps,
         Isa isa) {
  const Scene scene = build(std::move(description));
  const std::size_t tools = scene.settings.tools.size();
  DeviceSample sample = hand(0);
  State state = initial_state(scene, std::span(&sample, tools));
  std::uint64_t random = 1;
  if (tools > 0) {  // some elements start inverted, so that the rotations' fallback is used
    for (double& x : state.positions) {
      random = random * 6364136223846793005u + 1442695040888963407u;
      x += 0.004 * (static_cast<double>(random >> 11) * 0x1p-53 - 0.5);
    }
  }
  WorkspacePtr workspace = make_workspace(scene, threads, isa);
  StepReport report = make_report(scene);
  Writer writer(out, name, *workspace);
  for (writer.step = 0; writer.step < steps; ++writer.step) {
    sample = hand(writer.step + 1);
    step(scene, std::span(&sample, tools), state, report, *workspace, &writer);
    writer.state(state);
  }
}

int write(const char* path, int threads, int steps, Isa isa) {
  std::ofstream out(path, std::ios::binary);
  run(out, "pressed_single", pressed(Precision::single_precision), threads, steps, isa);
  run(out, "pressed_double", pressed(Precision::double_precision), threads, steps, isa);
  SceneDescription on_levels = pressed(Precision::single_precision);
  on_levels.solver.preconditioner = Preconditioner::multigrid;
  run(out, "pressed_multigrid", on_levels, threads, steps, isa);
  run(out, "torn", torn(), threads, steps, isa);
  out.close();
  if (out) return 0;
  std::cerr << path << ": cannot be written\n";
  return 3;
}

struct Array {
  std::string head, bytes;  // "scene step stage field type count"
  std::string scene, step, stage, field, type;
  std::size_t count = 0;

  std::size_t width() const { return type == "u8" ? 1 : type.substr(1) == "32" ? 4 : 8; }
};

bool read(std::ifstream& in, Array& array) {
  if (!std::getline(in, array.head)) return false;
  std::istringstream words(array.head);
  words >> array.scene >> array.step >> array.stage >> array.field >> array.type >> array.count;
  array.bytes.resize(array.count * array.width());
  in.read(array.bytes.data(), static_cast<std::streamsize>(array.bytes.size()));
  return in.get() == '\n';
}

std::string hexadecimal(const Array& array, std::size_t index) {
  std::string text = "0x";
  for (std::size_t byte = array.width(); byte-- > 0;) {
    char digits[3];
    std::snprintf(digits, sizeof digits, "%02x",
                  static_cast<unsigned char>(array.bytes[index * array.width() + byte]));
    text += digits;
  }
  return text;
}

int compare(const char* one, const char* other) {
  std::ifstream a(one, std::ios::binary), b(other, std::ios::binary);
  Array x, y;
  long arrays = 0;
  for (;; ++arrays) {
    const bool more = read(a, x);
    if (more != read(b, y) || (more && x.head != y.head)) {
      std::cerr << "scene " << x.scene << ", step " << x.step << ", stage " << x.stage << ": " << one
                << " has \"" << x.head << "\", " << other << " has \"" << y.head << "\"\n";
      return 1;
    }
    if (!more) break;
    if (x.bytes == y.bytes) continue;
    std::size_t index = 0, different = 0;
    for (std::size_t i = x.count; i-- > 0;) {
      if (std::memcmp(&x.bytes[i * x.width()], &y.bytes[i * x.width()], x.width()) == 0) continue;
      index = i;
      ++different;
    }
    std::cerr << "scene " << x.scene << ", step " << x.step << ", stage " << x.stage << ", field " << x.field
              << '[' << index << "] (" << x.type << "): " << hexadecimal(x, index) << " in " << one << ", "
              << hexadecimal(y, index) << " in " << other << "; " << different << " of " << x.count
              << " differ\n";
    return 1;
  }
  if (arrays > 0) return 0;
  std::cerr << one << ", " << other << ": nothing to compare\n";
  return 1;
}

}  // namespace
}  // namespace sulcus

int main(int argc, char** argv) {
  using namespace sulcus;
  const std::string command = argc > 1 ? argv[1] : "";
  if (command == "compare" && argc == 4) return compare(argv[2], argv[3]);
  if (command == "write" && argc >= 3 && argc <= 6) {
    Isa isa = widest_isa();
    for (Isa named : {Isa::sse2, Isa::avx2, Isa::avx512}) {
      if (argc > 5 && std::strcmp(argv[5], isa_name(named)) == 0) isa = named;
    }
    return write(argv[2], argc > 3 ? std::atoi(argv[3]) : 1, argc > 4 ? std::atoi(argv[4]) : 20, isa);
  }
  std::cerr << "fingerprint_probe write FILE [threads [steps [sse2|avx2|avx512]]]\n"
               "fingerprint_probe compare FILE FILE\n";
  return 2;
}
