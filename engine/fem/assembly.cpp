#include "engine/fem/assembly.h"

#include <omp.h>

#include <algorithm>
#include <cassert>

#include "engine/numerics/float_environment.h"
#include "engine/numerics/team.h"

namespace sulcus {

ElementTiles find_tiles(const Sparsity& sparsity, std::int64_t elements) {
  const std::int64_t tiles = (elements + ElementTiles::elements - 1) / ElementTiles::elements;
  const auto edges = static_cast<std::int64_t>(sparsity.edges.size());
  const auto tile_of = [&](std::int32_t place) {
    return sparsity.edge_items[static_cast<std::size_t>(place)] / 16 / ElementTiles::elements;
  };
  ElementTiles result;
  result.ready.assign(static_cast<std::size_t>(tiles + 1), edges);
  result.begin.assign(static_cast<std::size_t>(tiles + 1), 0);
  std::int64_t next = 0;  // the tiles below are needed by an edge so far
  for (std::int64_t e = 0; e < edges; ++e) {
    const std::int64_t last = tile_of(sparsity.edge_start[static_cast<std::size_t>(e) + 1] - 1);
    while (next <= last) result.ready[static_cast<std::size_t>(next++)] = e;
  }
  next = tiles;  // the tiles above have an edge behind that needs one before them
  for (std::int64_t e = edges; e-- > 0;) {
    const std::int64_t first = tile_of(sparsity.edge_start[static_cast<std::size_t>(e)]);
    while (next > first) result.begin[static_cast<std::size_t>(next--)] = e + 1;
  }
  constexpr std::int64_t window = Sparsity::window_edges;
  for (std::int64_t& e : result.ready) e = e == edges ? sparsity.edge_windows() : e / window;
  for (std::int64_t& e : result.begin) e = (e + window - 1) / window;
  return result;
}

template <class Real>
SystemMatrix<Real> make_system_matrix(const ElementData& elements, const Sparsity& sparsity, Isa isa,
                                      int threads) {
  SystemMatrix<Real> system;
  const std::size_t padded = elements.nodes.size() / 4;
  const auto nodes = static_cast<std::size_t>(sparsity.nodes);
  const auto chunks = static_cast<std::size_t>(sparsity.chunks);
  system.node_fields.assign(8 * nodes, Real(0));
  system.records.assign(16 * padded + 16, Real(0));
  system.forces.assign(12 * padded + 4, Real(0));
  system.ahead.assign(elements.beta_s.size(), Real(1));
  system.blocks.assign(12 * sparsity.edges.size() + 12, Real(0));
  system.node_terms.assign(16 * nodes, Real(0));
  system.values.assign(9 * sparsity.block.size(), Real(0));
  system.diagonal.assign(9 * 16 * chunks, Real(0));
  system.inverse.assign(9 * 16 * chunks, Real(0));
  system.tiles = find_tiles(sparsity, elements.count);
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

}  // namespace

template <class Real>
void assemble_elements(const ElementData& elements, const Sparsity& sparsity,
                       const StepCoefficients& coefficients, std::span<const Vec3> rest,
                       std::span<const double> positions, std::span<const double> velocities,
                       std::span<const std::uint8_t> alive, std::span<double> rotations,
                       SystemMatrix<Real>& system) {
  const double h = coefficients.step_s;
  const double ahead = h + coefficients.damping.beta_s;
  const double mass_scale = 1 + coefficients.damping.alpha_1_s * h;

  ElementPass<Real> element_pass;
  element_pass.count = elements.count;
  element_pass.nodes = elements.nodes.data();
  element_pass.rest = rest_data<Real>(elements);
  element_pass.node_fields = system.node_fields.data();
  element_pass.alive = alive.empty() ? nullptr : alive.data();
  element_pass.linear = elements.linear.empty() ? nullptr : elements.linear.data();
  element_pass.ahead = elements.beta_s.empty() ? nullptr : system.ahead.data();
  element_pass.rotations = rotations.data();
  element_pass.records = system.records.data();
  element_pass.forces = system.forces.data();

  EdgePass<Real> edge_pass;
  edge_pass.lane_edges = sparsity.lane_edges.data();
  edge_pass.lane_start = sparsity.lane_start.data();
  edge_pass.lane_items = sparsity.lane_items.data();
  edge_pass.records = system.records.data();
  edge_pass.scale = static_cast<Real>(coefficients.damping.beta_s * h + h * h);
  edge_pass.blocks = system.blocks.data();

  const std::int64_t blocks = static_cast<std::int64_t>(elements.nodes.size()) / (4 * ElementData::lanes);
  constexpr std::int64_t blocks_a_tile = ElementTiles::elements / ElementData::lanes;
  const std::int64_t tiles = static_cast<std::int64_t>(system.tiles.ready.size()) - 1;
  const auto ready = [&](std::int64_t tile) { return system.tiles.ready[static_cast<std::size_t>(tile)]; };
  const auto begin = [&](std::int64_t tile) { return system.tiles.begin[static_cast<std::size_t>(tile)]; };
  SpinBarrier barrier(system.threads);
#pragma omp parallel num_threads(system.threads)
  {
    assert(default_float_environment());  // each thread has its own
    const int thread = omp_get_thread_num();
    const Range nodes = share(sparsity.nodes, thread, system.threads);
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
    const Range own_damping =
        share(static_cast<std::int64_t>(elements.beta_s.size()), thread, system.threads);
    for (std::int64_t i = own_damping.first; i < own_damping.last; ++i) {
      const auto e = static_cast<std::size_t>(i);
      system.ahead[e] = static_cast<Real>((h + elements.beta_s[e]) / ahead);
    }
    barrier.wait();
    // tile by tile, and behind them the edges that need no other thread's elements
    const Range own = share(tiles, thread, system.threads);
    std::int64_t next = begin(own.first);
    for (std::int64_t tile = own.first; tile < own.last; ++tile) {
      system.kernels.element_pass(element_pass, tile * blocks_a_tile,
                                  std::min((tile + 1) * blocks_a_tile, blocks));
      if (ready(tile + 1) <= next) continue;
      system.kernels.edge_pass(edge_pass, next, ready(tile + 1));
      next = ready(tile + 1);
    }
    barrier.wait();
    for (int border = 1; border < system.threads; ++border) {  // the edges between two threads' elements
      const std::int64_t tile = share(tiles, border, system.threads).first;
      const std::int64_t before = share(tiles, border - 1, system.threads).first;
      const std::int64_t first = std::max(ready(tile), begin(before));
      const Range part = share(std::max<std::int64_t>(0, begin(tile) - first), thread, system.threads);
      system.kernels.edge_pass(edge_pass, first + part.first, first + part.last);
    }
  }
}

template <class Real>
void add_edge_block(SystemMatrix<Real>& system, std::int32_t edge, const Mat3& block) {
  Real* to = &system.blocks[12 * static_cast<std::size_t>(edge)];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) to[4 * i + j] += static_cast<Real>(block(i, j));
  }
}

template <class Real>
void finish_rows(const Sparsity& sparsity, std::span<const std::uint8_t> free_node,
                 SystemMatrix<Real>& system) {
  RowPass<Real> pass;
  pass.node_of_slot = sparsity.node_of_slot.data();
  pass.chunk_start = sparsity.chunk_start.data();
  pass.block = sparsity.block.data();
  pass.blocks = system.blocks.data();
  pass.node_terms = system.node_terms.data();
  pass.free_node = free_node.data();
  pass.values = system.values.data();
  pass.diagonal = system.diagonal.data();
  pass.inverse = system.inverse.data();
#pragma omp parallel num_threads(system.threads)
  {
    const Range own = share(sparsity.chunks, omp_get_thread_num(), system.threads);
    system.kernels.row_pass(pass, own.first, own.last);
  }
}

template <class Real>
void elastic_forces(const ElementData& elements, const SystemMatrix<Real>& system, std::span<double> forces) {
  ForcePass<Real> pass;
  pass.incident_start = elements.incident_start.data();
  pass.incident = elements.incident.data();
  pass.forces = system.forces.data();
  pass.node_forces = forces.data();
  const auto nodes = static_cast<std::int64_t>(elements.node_mass.size());
#pragma omp parallel num_threads(system.threads)
  {
    const Range own = share(nodes, omp_get_thread_num(), system.threads);
    system.kernels.force_pass(pass, own.first, own.last);
  }
}

#define SULCUS_INSTANTIATE(Real)                                                                        \
  template SystemMatrix<Real> make_system_matrix<Real>(const ElementData&, const Sparsity&, Isa, int);  \
  template void assemble_elements<Real>(const ElementData&, const Sparsity&, const StepCoefficients&,   \
                                        std::span<const Vec3>, std::span<const double>,                 \
                                        std::span<const double>, std::span<const std::uint8_t>,         \
                                        std::span<double>, SystemMatrix<Real>&);                        \
  template void add_edge_block<Real>(SystemMatrix<Real>&, std::int32_t, const Mat3&);                   \
  template void finish_rows<Real>(const Sparsity&, std::span<const std::uint8_t>, SystemMatrix<Real>&); \
  template void elastic_forces<Real>(const ElementData&, const SystemMatrix<Real>&, std::span<double>);
SULCUS_INSTANTIATE(float)
SULCUS_INSTANTIATE(double)
#undef SULCUS_INSTANTIATE

}  // namespace sulcus
