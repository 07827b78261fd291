// The same body, materials and load in CalculiX (C3D4, linear static): nodal displacements must agree.
// Skipped where CalculiX (Debian package calculix-ccx) is not installed.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <sstream>

#include "engine/fem/test_body.h"

namespace sulcus {
namespace {
namespace fs = std::filesystem;

// A ball of two tissues with a slit between them that the mesh keeps open, two voxels a cell.
struct Ball {
  LabelMap map = box_map(20, 20, 20, 0.005);
  EmbeddingMesh mesh;
  std::vector<Material> materials{{2000, 0.45, 1000}, {500, 0.3, 1000}};
  std::vector<std::int32_t> material_of_tet;

  Ball() {
    for (int k = 0; k < 20; ++k) {
      for (int j = 0; j < 20; ++j) {
        for (int i = 0; i < 20; ++i) {
          const double x = i - 9.5, y = j - 9.5, z = k - 9.5;
          std::int32_t label = x * x + y * y + z * z > 81 ? 0 : y < 0 ? 1 : 2;
          if (label == 2 && z < -3) label = 3;  // joins the two halves below
          map.labels[static_cast<std::size_t>((k * 20 + j) * 20 + i)] = label;
        }
      }
    }
    EmbeddingOptions options;
    options.size_m = 0.01;
    SeparationPairs pairs;
    pairs.pairs.push_back({1, 2});
    mesh = build_embedding(map, pairs, options);
    for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
      material_of_tet.push_back(mesh.cell_label[t / static_cast<std::size_t>(mesh.tets_per_cell)] == 2);
    }
  }
};

void write_input(const fs::path& path, const Ball& ball, const std::map<int, double>& held,
                 const Eigen::VectorXd& load) {
  std::ofstream out(path);
  // CalculiX takes at most 20 characters a number
  out << std::setprecision(13) << "*NODE, NSET=ALL\n";
  for (std::size_t n = 0; n < ball.mesh.rest_positions.size(); ++n) {
    const Vec3& x = ball.mesh.rest_positions[n];
    out << n + 1 << ", " << x[0] << ", " << x[1] << ", " << x[2] << '\n';
  }
  for (int m = 0; m < 2; ++m) {
    out << "*ELEMENT, TYPE=C3D4, ELSET=E" << m << '\n';
    for (std::size_t t = 0; t < ball.mesh.tets.size(); ++t) {
      if (ball.material_of_tet[t] != m) continue;
      out << t + 1;
      for (std::int32_t node : ball.mesh.tets[t]) out << ", " << node + 1;
      out << '\n';
    }
    const Material& material = ball.materials[static_cast<std::size_t>(m)];
    out << "*MATERIAL, NAME=M" << m << "\n*ELASTIC\n"
        << material.youngs_modulus_Pa << ", " << material.poisson_ratio << "\n*SOLID SECTION, ELSET=E" << m
        << ", MATERIAL=M" << m << '\n';
  }
  out << "*BOUNDARY\n";
  for (const auto& [i, value] : held)
    out << i / 3 + 1 << ", " << i % 3 + 1 << ", " << i % 3 + 1 << ", " << value << '\n';
  out << "*STEP\n*STATIC\n*CLOAD\n";
  for (int i = 0; i < load.size(); ++i) {
    if (load[i] != 0) out << i / 3 + 1 << ", " << i % 3 + 1 << ", " << load[i] << '\n';
  }
  out << "*NODE PRINT, NSET=ALL\nU\n*END STEP\n";
}

Eigen::VectorXd read_displacements(const fs::path& path, Eigen::Index size) {
  Eigen::VectorXd u = Eigen::VectorXd::Constant(size, NAN);
  std::ifstream in(path);
  for (std::string line; std::getline(in, line);) {
    std::istringstream numbers(line);
    Eigen::Index node = 0;
    Vec3 value;
    if (numbers >> node >> value[0] >> value[1] >> value[2] && node >= 1 && 3 * node <= size) {
      u.segment<3>(3 * (node - 1)) = value;
    }
  }
  return u;
}

TEST(CalculiX, GivesTheSameDisplacementsOnALabelMapMesh) {
  if (std::system("command -v ccx >/dev/null 2>&1") != 0) {
    GTEST_SKIP() << "CalculiX is not installed (Debian package calculix-ccx, by tools/setup)";
  }
  const Ball ball;
  Body body(ball.mesh, ball.materials, ball.material_of_tet);
  std::map<int, double> held;
  Eigen::VectorXd load = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(body.positions.size()));
  for (int n = 0; n < static_cast<int>(body.mesh.rest_positions.size()); ++n) {
    const Vec3& x = body.mesh.rest_positions[static_cast<std::size_t>(n)];
    if (x[2] < 0.015) {
      for (int d = 0; d < 3; ++d) held[3 * n + d] = 0;
    }
    if (x[2] > 0.075)
      load.segment<3>(3 * n) = 1e-9 * Vec3(1, x[1] < 0.05 ? -2 : 3, -0.5);  // N, so small that
  }                                                                         // rotations do not matter
  ASSERT_GT(held.size(), 10u);
  ASSERT_GT(load.norm(), 0);

  const fs::path folder = fs::temp_directory_path() / ("sulcus_calculix_" + std::to_string(getpid()));
  fs::create_directories(folder);
  write_input(folder / "ball.inp", ball, held, load);
  const std::string command = "cd '" + folder.string() + "' && OMP_NUM_THREADS=1 ccx ball >ccx.log 2>&1";
  ASSERT_EQ(std::system(command.c_str()), 0) << "see " << folder / "ccx.log";
  const Eigen::VectorXd theirs = read_displacements(folder / "ball.dat", load.size());
  fs::remove_all(folder);

  // equilibrium of the corotated law, two Newton steps from rest
  Eigen::VectorXd u = solve(body, held, load).u;
  for (Eigen::Index i = 0; i < u.size(); ++i) body.positions[static_cast<std::size_t>(i)] += u[i];
  const std::vector<double> force = body.force();
  const Eigen::VectorXd left = load - Eigen::Map<const Eigen::VectorXd>(force.data(), load.size());
  u += solve(body, held, left).u;

  const double largest = u.cwiseAbs().maxCoeff();
  EXPECT_GT(largest, 1e-9);  // m
  ASSERT_TRUE(theirs.allFinite());
  EXPECT_LT((u - theirs).cwiseAbs().maxCoeff(), 1e-6 * largest);
}

}  // namespace
}  // namespace sulcus
