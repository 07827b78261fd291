#include "engine/fem/assembly.h"

#include <omp.h>

#include <algorithm>
#include <cassert>

#include "engine/numerics/float_environment.h"
#include "engine/numerics/team.h"

namespace sulcus {

template <class Real>
SystemMatrix<Real> make_system_matrix(const ElementData& elements, const Sparsity& sparsity, Isa isa,
                                      int threads, bool energies) {
  SystemMatrix<Real> system;
  const auto nodes = static_cast<std::size_t>(sparsity.nodes);
  const auto chunks = static_cast<std::size_t>(sparsity.chunks);
  system.node_fields.assign(8 * nodes, Real(0));
  system.ahead.assign(elements.beta_s.size(), Real(1));
  system.node_terms.assign(16 * nodes, Real(0));
  system.values.assign(9 * sparsity.block.size(), Real(0));
  system.diagonal.assign(9 * 16 * chunks, Real(0));
  system.inverse.assign(9 * 16 * chunks, Real(0));
  system.node_forces.assign(3 * nodes, 0.0);
  if (energies) {
    system.energies.assign(
        static_cast<std::size_t>((elements.count + ElementData::lanes - 1) / ElementData::lanes), 0.0);
  }
  system.plan = plan_assembly(elements, sparsity, threads);
  system.rings.resize(static_cast<std::size_t>(threads));
  for (std::size_t t = 0; t < system.rings.size(); ++t) {
    auto& rings = system.rings[t];
    const auto places = static_cast<std::size_t>(system.plan.elements());
    rings.records.assign(16 * places + 16, Real(0));
    rings.forces.assign(12 * places + 4, Real(0));
    rings.blocks.assign(12 * static_cast<std::size_t>(system.plan.edges()) + 24, Real(0));
    const AssemblyPlan::Part& part = system.plan.parts[t];
    rings.rotations.assign(
        static_cast<std::size_t>(4 * AssemblyPlan::tile_elements * (part.last_tile - part.next)), 0.0);
  }
  system.kernels = fem_kernels<Real>(isa);
  system.threads = threads;
  return system;
}

namespace {

template <class Real>
const Real* rest_data(const ElementData& elements);
template <>
const float* rest_data<float>(const ElementData& elements) {
  return elements.rest_single.data();
}
template <>
const double* rest_data<double>(const ElementData& elements) {
  return elements.rest_double.data();
}

// Displacements and masses of some nodes, as the kernels take them.
template <class Real>
void load_nodes(const ElementData& elements, const StepCoefficients& coefficients, std::span<const Vec3> rest,
                std::span<const double> positions, std::span<const double> velocities, Range nodes,
                SystemMatrix<Real>& system) {
  const double h = coefficients.step_s;
  const double ahead = h + coefficients.damping.beta_s;
  const double mass_scale = 1 + coefficients.damping.alpha_1_s * h;
  for (std::int64_t i = nodes.first; i < nodes.last; ++i) {
    const auto n = static_cast<std::size_t>(i);
    for (std::size_t d = 0; d < 3; ++d) {
      const double displacement = positions[3 * n + d] - rest[n][static_cast<Eigen::Index>(d)];
      system.node_fields[8 * n + d] = static_cast<Real>(displacement);
      system.node_fields[8 * n + 4 + d] = static_cast<Real>(displacement + ahead * velocities[3 * n + d]);
    }
    Real* terms = &system.node_terms[16 * n];
    const Real mass =
        static_cast<Real>(elements.drag_kg_s.empty() ? mass_scale * elements.node_mass[n]
                                                     : elements.node_mass[n] + h * elements.drag_kg_s[n]);
    for (int k = 0; k < 9; ++k) terms[k] = k % 4 == 0 ? mass : Real(0);
  }
}

template <class Real>
RowPass<Real> row_pass(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                       SystemMatrix<Real>& system) {
  RowPass<Real> pass;
  pass.node_of_slot = sparsity.node_of_slot.data();
  pass.chunk_start = sparsity.chunk_start.data();
  pass.block = system.plan.block.data();
  pass.transposed = system.plan.transposed.data();
  pass.node_terms = system.node_terms.data();
  pass.free_node = free_node.data();
  pass.values = system.values.data();
  pass.diagonal = system.diagonal.data();
  pass.inverse = system.inverse.data();
  return pass;
}

// The passes of a thread.
template <class Real>
struct Passes {
  ElementPass<Real> elements;
  EdgePass<Real> edges;
  RowPass<Real> rows;
  ForcePass<Real> forces;
};

// Tile by tile, and behind each the edges and rows that waited for it.
template <class Real>
void make_part(const Sparsity& sparsity, const AssemblyPlan& plan, const AssemblyPlan::Part& part,
               const FemKernels<Real>& kernels, Passes<Real> passes, std::span<double> other_rotations) {
  constexpr std::int64_t tile_elements = AssemblyPlan::tile_elements;
  const std::int64_t chunks = sparsity.window_rows / Sparsity::chunk_rows;
  constexpr std::int64_t groups = Sparsity::window_edges / Sparsity::chunk_rows;
  const std::int64_t blocks = (passes.elements.count + ElementData::lanes - 1) / ElementData::lanes;
  std::int64_t edges_done = part.first_edges, rows_done = part.first_rows;
  for (std::int64_t tile = part.first_tile; tile < part.last_tile; ++tile) {
    const std::int64_t first = tile * tile_elements / ElementData::lanes;
    passes.elements.records_from = (tile - tile % plan.ring_tiles) * tile_elements;
    if (tile == part.next) {
      passes.elements.rotations = other_rotations.data();
      passes.elements.rotations_from = tile * tile_elements;
      passes.elements.energies = nullptr;
    }
    kernels.element_pass(passes.elements, first,
                         std::min(first + tile_elements / ElementData::lanes, blocks));
    const auto done = static_cast<std::size_t>(tile) + 1;
    if (const std::int64_t ready = plan.ready_edges[done]; ready > edges_done) {
      kernels.edge_pass(passes.edges, edges_done * groups, ready * groups);
      edges_done = ready;
    }
    if (const std::int64_t ready = std::min(plan.ready_rows[done], part.last_rows); ready > rows_done) {
      kernels.force_pass(passes.forces, rows_done * sparsity.window_rows,
                         std::min(ready * sparsity.window_rows, sparsity.nodes));
      kernels.row_pass(passes.rows, rows_done * chunks, std::min(ready * chunks, sparsity.chunks));
      rows_done = ready;
    }
  }
}

}  // namespace

template <class Real>
void assemble_elements(const ElementData& elements, const Sparsity& sparsity,
                       const StepCoefficients& coefficients, std::span<const Vec3> rest,
                       std::span<const double> positions, std::span<const double> velocities,
                       std::span<const std::uint8_t> alive, std::span<const std::uint8_t> free_node,
                       std::span<double> rotations, SystemMatrix<Real>& system) {
  const double h = coefficients.step_s;
  Passes<Real> all;
  all.elements.count = elements.count;
  all.elements.nodes = elements.nodes.data();
  all.elements.rest = rest_data<Real>(elements);
  all.elements.node_fields = system.node_fields.data();
  all.elements.alive = alive.empty() ? nullptr : alive.data();
  all.elements.linear = elements.linear.empty() ? nullptr : elements.linear.data();
  all.elements.ahead = elements.beta_s.empty() ? nullptr : system.ahead.data();
  all.elements.rotations = rotations.data();
  all.elements.energies = system.energies.empty() ? nullptr : system.energies.data();
  all.edges.lane_edges = system.plan.lane_edges.data();
  all.edges.lane_start = sparsity.lane_start.data();
  all.edges.lane_corners = system.plan.lane_corners.data();
  all.edges.scale = static_cast<Real>(coefficients.damping.beta_s * h + h * h);
  all.rows = row_pass(sparsity, free_node, system);
  all.forces.incident_start = elements.incident_start.data();
  all.forces.incident = system.plan.incident.data();
  all.forces.node_forces = system.node_forces.data();

  SpinBarrier barrier(system.threads);
#pragma omp parallel num_threads(system.threads)
  {
    assert(default_float_environment());  // each thread has its own
    const int thread = omp_get_thread_num();
    load_nodes(elements, coefficients, rest, positions, velocities,
               share(sparsity.nodes, thread, system.threads), system);
    const Range own_damping =
        share(static_cast<std::int64_t>(elements.beta_s.size()), thread, system.threads);
    for (std::int64_t i = own_damping.first; i < own_damping.last; ++i) {
      const auto e = static_cast<std::size_t>(i);
      system.ahead[e] = static_cast<Real>((h + elements.beta_s[e]) / (h + coefficients.damping.beta_s));
    }
    auto& rings = system.rings[static_cast<std::size_t>(thread)];
    const AssemblyPlan::Part& part = system.plan.parts[static_cast<std::size_t>(thread)];
    const auto others = static_cast<std::size_t>(4 * AssemblyPlan::tile_elements * part.next);
    if (part.last_tile > part.next) {
      std::copy_n(rotations.begin() + static_cast<std::ptrdiff_t>(others),
                  std::min(rings.rotations.size(), rotations.size() - others), rings.rotations.begin());
    }
    Passes<Real> own = all;
    own.elements.records = rings.records.data();
    own.elements.forces = rings.forces.data();
    own.edges.records = rings.records.data();
    own.edges.blocks = rings.blocks.data();
    own.rows.blocks = rings.blocks.data();
    own.forces.forces = rings.forces.data();
    barrier.wait();  // all have the nodes, and the others' rotations as they were
    make_part<Real>(sparsity, system.plan, part, system.kernels, own, rings.rotations);
  }
}

template <class Real>
void add_edge_block(const Sparsity& sparsity, std::int32_t edge, const Mat3& block,
                    SystemMatrix<Real>& system) {
  for (std::size_t turned = 0; turned < 2; ++turned) {
    const auto place =
        static_cast<std::size_t>(sparsity.place_of_block[2 * static_cast<std::size_t>(edge) + turned]);
    Real* to = &system.values[place / 16 * 144 + place % 16];
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j)
        to[16 * (3 * i + j)] += static_cast<Real>(turned ? block(j, i) : block(i, j));
    }
  }
}

namespace {
constexpr std::int64_t enough_for_threads = 16;  // chunks of rows: fewer cost less than a team's start
}

template <class Real>
void close_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                SystemMatrix<Real>& system) {
  const RowPass<Real> pass = row_pass(sparsity, free_node, system);
#pragma omp parallel num_threads(system.threads)
  {
    const Range own = share(sparsity.chunks, omp_get_thread_num(), system.threads);
    system.kernels.close_rows(pass, own.first, own.last);
  }
}

template <class Real>
void close_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                std::span<const std::int32_t> chunks, SystemMatrix<Real>& system) {
  const RowPass<Real> pass = row_pass(sparsity, free_node, system);
  const auto count = static_cast<std::int64_t>(chunks.size());
#pragma omp parallel for num_threads(system.threads) schedule(static) if (count >= enough_for_threads)
  for (std::int64_t n = 0; n < count; ++n) {
    const std::int32_t chunk = chunks[static_cast<std::size_t>(n)];
    system.kernels.close_rows(pass, chunk, chunk + 1);
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                             \
  template SystemMatrix<Real> make_system_matrix<Real>(const ElementData&, const Sparsity&, Isa, int, bool); \
  template void assemble_elements<Real>(                                                                     \
      const ElementData&, const Sparsity&, const StepCoefficients&, std::span<const Vec3>,                   \
      std::span<const double>, std::span<const double>, std::span<const std::uint8_t>,                       \
      std::span<const std::uint8_t>, std::span<double>, SystemMatrix<Real>&);                                \
  template void add_edge_block<Real>(const Sparsity&, std::int32_t, const Mat3&, SystemMatrix<Real>&);       \
  template void close_rows<Real>(const Sparsity&, std::span<const std::uint8_t>, SystemMatrix<Real>&);       \
  template void close_rows<Real>(const Sparsity&, std::span<const std::uint8_t>,                             \
                                 std::span<const std::int32_t>, SystemMatrix<Real>&);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
