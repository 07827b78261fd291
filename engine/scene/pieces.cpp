#include "engine/scene/pieces.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>

#include "engine/mesh/topology.h"
#include "engine/scene/system.h"

namespace sulcus {
namespace {

using Mat6 = Eigen::Matrix<double, 6, 6>;
using Vec6 = Eigen::Matrix<double, 6, 1>;

std::string in_mm(const Vec3& x) {
  std::string text = "(";
  for (int d = 0; d < 3; ++d)
    text += (d == 0 ? "" : ", ") + std::to_string(static_cast<long long>(std::floor(x[d] * 1e3 + 0.5)));
  return text + ") mm";
}

struct PieceOfNodes {
  std::vector<std::int32_t> nodes;
  std::int64_t cells = 0;
  Vec3 centre = Vec3::Zero();  // m, rest
};

struct AllPieces {
  std::vector<PieceOfNodes> pieces;
  std::vector<std::int32_t> of_node;  // -1: of no present element
};

AllPieces find_pieces(const Scene& scene, std::span<const std::uint8_t> alive) {
  const Pieces found = mesh_pieces(scene.mesh.tets, scene.node_count(), alive);
  AllPieces all{std::vector<PieceOfNodes>(found.item_count.size()),
                std::vector<std::int32_t>(static_cast<std::size_t>(scene.node_count()), -1)};
  std::int64_t last_cell = -1;
  for (std::size_t t = 0; t < scene.mesh.tets.size(); ++t) {
    if (found.piece[t] < 0) continue;
    PieceOfNodes& piece = all.pieces[static_cast<std::size_t>(found.piece[t])];
    const auto cell = static_cast<std::int64_t>(t) / scene.mesh.tets_per_cell;
    piece.cells += cell != last_cell;
    last_cell = cell;
    for (std::int32_t node : scene.mesh.tets[t]) all.of_node[static_cast<std::size_t>(node)] = found.piece[t];
  }
  for (std::size_t n = 0; n < all.of_node.size(); ++n) {
    if (all.of_node[n] < 0) continue;
    PieceOfNodes& piece = all.pieces[static_cast<std::size_t>(all.of_node[n])];
    piece.nodes.push_back(static_cast<std::int32_t>(n));
    piece.centre += scene.mesh.rest_positions[n];
  }
  for (PieceOfNodes& piece : all.pieces) piece.centre /= static_cast<double>(piece.nodes.size());
  return all;
}

std::string describe(const AllPieces& all, std::size_t number) {
  const PieceOfNodes& piece = all.pieces[number];
  return "piece " + std::to_string(number + 1) + " of " + std::to_string(all.pieces.size()) +
         " of the mesh (" + std::to_string(piece.cells) +
         (piece.cells == 1 ? " cell around " : " cells around ") + in_mm(piece.centre) + ")";
}

// How the supports of a piece resist its rigid motions (velocity of the centre, rotation times size): the sum
// over supported directions of their squared share in a motion.
Mat6 resistance(const Scene& scene, const PieceOfNodes& piece, double size,
                const std::vector<std::uint8_t>& sprung) {
  Mat6 sum = Mat6::Zero();
  for (std::int32_t node : piece.nodes) {
    const auto n = static_cast<std::size_t>(node);
    const bool held = !scene.free_node[n] || sprung[n];
    const Vec3 arm = (scene.mesh.rest_positions[n] - piece.centre) / size;
    for (int d = 0; d < 3; ++d) {
      if (!held && (scene.keeps.empty() || !scene.keeps[n][static_cast<std::size_t>(d)])) continue;
      Vec6 row;
      row << Vec3::Unit(d), arm.cross(Vec3::Unit(d));
      sum += row * row.transpose();
    }
  }
  return sum;
}

std::string axis_of(const Vec3& direction) {
  Vec3 unit = direction / direction.norm();
  int largest = 0;
  for (int d = 1; d < 3; ++d) {
    if (std::fabs(unit[d]) > std::fabs(unit[largest]) + 1e-6) largest = d;
  }
  if (unit[largest] < 0) unit = -unit;
  std::string text = "(";
  for (int d = 0; d < 3; ++d) {
    const auto tenths = static_cast<int>(std::floor(unit[d] * 10 + 0.5));
    const std::string sign = tenths < 0 ? "-" : "";
    text += (d == 0 ? "" : ", ") + sign + std::to_string(std::abs(tenths) / 10) +
            (tenths % 10 == 0 ? "" : "." + std::to_string(std::abs(tenths) % 10));
  }
  return text + ")";
}

}  // namespace

std::string describe_piece(const Scene& scene, std::span<const std::uint8_t> alive, std::int32_t node) {
  const AllPieces all = find_pieces(scene, alive);
  const std::int32_t piece = all.of_node[static_cast<std::size_t>(node)];
  if (piece < 0) {
    return "node " + std::to_string(node) + " at " +
           in_mm(scene.mesh.rest_positions[static_cast<std::size_t>(node)]) + ", which belongs to no element";
  }
  return describe(all, static_cast<std::size_t>(piece));
}

namespace {

constexpr const char* failure_remedy =
    "; give a shorter time step (/time/step_s), or slower motions, or softer contacts and couplings";

// The first node for which bad(n, d) holds for a direction d; -1: none.
template <class Bad>
std::int32_t first_node(const Scene& scene, Bad&& bad) {
  for (std::int32_t n = 0; n < scene.node_count(); ++n) {
    for (std::size_t d = 0; d < 3; ++d) {
      if (bad(static_cast<std::size_t>(n), d)) return n;
    }
  }
  return -1;
}

}  // namespace

std::string explain_failure(const Scene& scene, std::span<const DeviceSample> samples, const State& state) {
  const std::span<const std::uint8_t> alive = present(scene, state);
  const auto in_piece = [&](std::int32_t node) {
    return " in " + describe_piece(scene, alive, node) + failure_remedy;
  };
  std::int32_t node = first_node(scene, [&](std::size_t n, std::size_t d) {
    return !std::isfinite(state.positions[3 * n + d]) || !std::isfinite(state.velocities[3 * n + d]);
  });
  if (node >= 0) return "a position or velocity is not finite" + in_piece(node);
  for (std::size_t t = 0; t < samples.size(); ++t) {
    bool finite = samples[t].position.allFinite();
    for (std::size_t i = 0; i < 7; ++i) finite = finite && std::isfinite(state.tool_poses[7 * t + i]);
    for (std::size_t i = 0; i < 6; ++i) finite = finite && std::isfinite(state.tool_momenta[6 * t + i]);
    if (!finite) {
      return "the pose, momentum or sample of tool \"" + scene.settings.tools[t].name + "\" is not finite" +
             failure_remedy;
    }
  }
  // the tissue's system once more
  State copy = state;
  WorkspacePtr workspace = make_workspace(scene, 1);
  if (scene.fracture) update(scene, state.alive, workspace->view);
  const auto numbers = make_numbers<double>(scene, 1, widest_isa());
  assemble_and_solve(scene, samples, copy, *numbers, *workspace, nullptr, {1e-3, 0, 1000});
  const auto block = [&](std::size_t n, std::size_t i, std::size_t j) {
    const auto slot = static_cast<std::size_t>(scene.sparsity.slot_of_node[n]);
    return numbers->system.diagonal[slot / 16 * 144 + 16 * (3 * i + j) + slot % 16];
  };
  constexpr double most = 1e150;  // squares of more overflow
  node = first_node(scene, [&](std::size_t n, std::size_t d) {
    return !(std::fabs(numbers->solver.b[solver_entry(scene, static_cast<std::int32_t>(n), d)]) < most) ||
           !(std::fabs(block(n, d, d)) < most);
  });
  if (node >= 0) return "a force or a stiffness is not finite" + in_piece(node);
  node = first_node(scene, [&](std::size_t n, std::size_t d) {
    const std::size_t e = (d + 1) % 3;
    return scene.free_node[n] &&
           !(block(n, d, d) > 0 && block(n, d, d) * block(n, e, e) > block(n, d, e) * block(n, d, e));
  });
  if (node >= 0) return "the matrix is not positive definite" + in_piece(node);
  return std::string("the matrix was not positive definite, or a tool's part of it not finite") +
         failure_remedy;
}

std::vector<std::string> loose_pieces(const Scene& scene, std::span<const std::uint8_t> alive) {
  constexpr double least = 1e-9;  // of the largest resistance
  const AllPieces all = find_pieces(scene, alive);
  std::vector<std::uint8_t> sprung(static_cast<std::size_t>(scene.node_count()), 0);
  for (const NodeSpring& spring : scene.settings.springs)
    sprung[static_cast<std::size_t>(spring.node)] |= spring.stiffness_N_m > 0;
  std::vector<std::string> sentences;
  for (std::size_t p = 0; p < all.pieces.size(); ++p) {
    double size = 0;
    for (std::int32_t node : all.pieces[p].nodes) {
      size = std::fmax(
          size, (scene.mesh.rest_positions[static_cast<std::size_t>(node)] - all.pieces[p].centre).norm());
    }
    const Eigen::SelfAdjointEigenSolver<Mat6> motions(resistance(scene, all.pieces[p], size, sprung));
    if (motions.eigenvalues()[0] > least * std::fmax(motions.eigenvalues()[5], 1.0)) continue;
    const Vec6 free = motions.eigenvectors().col(0);
    const Vec3 shift = free.head<3>(), turn = free.tail<3>();
    std::string how;
    if (motions.eigenvalues()[5] < least) {
      how = "is held by nothing";
    } else if (turn.norm() < 1e-3) {
      how = "can slide freely along " + axis_of(shift);
    } else {
      how = "can turn freely about an axis along " + axis_of(turn);
    }
    sentences.push_back(describe(all, p) + " " + how +
                        "; hold it (/boundary/fixed, springs or planes), or leave out small pieces "
                        "(/mesh/min_island_cells)");
  }
  return sentences;
}

}  // namespace sulcus
