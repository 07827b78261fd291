// Speed against error of the linear solver: iterations and time to errors of the velocity increment, as a
// Markdown table.
//
//   build/release/tools/solver_table --bodies cubes_24x24x24,jhu189_10mm --dt 0.0333333,1e-3 --contact
//   0,1e3,1e4
//
// One row for each combination of bodies, physics, preconditioners and precisions. Error: |dv - dv*| / |dv*|
// against the solution of the same system in double precision (direct, or to 1e-12); residual: |r| / |b| in
// the norm of the diagonal blocks. All searches start from zero. `set-up`: what the preconditioner costs once
// a step. Times are milliseconds, medians over rounds in which the preconditioners take turns, so that a
// disturbance meets both; the time to a target includes the set-up. "-": not reached. An asterisk: what
// `auto` chooses; where both preconditioners were measured, the last line says what its choices cost.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <map>
#include <memory>
#include <numeric>

#include "engine/numerics/error.h"
#include "engine/solver/direct.h"
#include "tools/bench/bodies.h"

namespace sulcus {
namespace {

constexpr double errors[] = {1e-1, 1e-2, 1e-3, 1e-4};
constexpr int targets = 5;  // the errors, then a residual of 1e-6
constexpr double last_residual = 1e-6;
constexpr int cap = 5000;

struct Options {
  std::vector<std::string> bodies = {"cubes_10x10x11", "cubes_12x14x17", "cubes_24x24x24", "jhu189_10mm"};
  std::vector<std::string> preconditioners = {"block_jacobi"}, precisions = {"f32", "f64"};
  std::vector<double> steps = {1.0 / 30}, ratios = {0.45}, contacts = {1e3}, stiff = {1}, moduli = {1000},
                      betas = {0.1};
  int threads = 2, rounds = 5, contact_count = 80;
  bool processor_time = false, exponents = false;
};

// Milliseconds of the wall clock, or of the processor where a busy machine is measured with one thread.
double now_ms(bool processor_time) {
  timespec time{};
  clock_gettime(processor_time ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values.empty() ? 0 : values[values.size() / 2];
}

// One way to solve a system: made once, run often.
struct Method {
  std::string name;
  virtual ~Method() = default;
  virtual void set_up() = 0;  // what the preconditioner needs at each step
  virtual SolveResult solve(double tolerance, int most) = 0;
  virtual std::vector<double> solution() const = 0;
  virtual double bytes() const = 0;  // that a step needs: assembly, matrix, vectors
};

template <class Real>
struct KrylovMethod : Method {
  BodySystem<Real> system;
  Multigrid multigrid;

  KrylovMethod(const PressedBody& body, const std::string& preconditioner, int threads)
      : system(body, threads) {
    if (preconditioner != "block_jacobi" && preconditioner != "multigrid") {
      throw InputError("--preconditioners: found \"" + preconditioner +
                       "\", expected block_jacobi or multigrid");
    }
    if (preconditioner == "multigrid") {
      std::vector<double> weights = body.elements.node_mass;
      multigrid =
          build_multigrid(body.mesh, body.elements, body.sparsity, body.step, weights, body.free_node);
      use_multigrid(multigrid, body.sparsity.chunks, system.solver);
      set_up();
    }
    name = preconditioner + (sizeof(Real) == 4 ? " f32" : " f64");
  }
  void set_up() override {
    if (system.solver.multigrid == nullptr) return;
    clear_contacts(system.solver.levels);
    for (const Contact& contact : system.body.contacts) {
      add_contact<Real>(multigrid, system.body.mesh, contact.tet, contact.weights,
                        system.body.contact_weight() * contact.normal * contact.normal.transpose(),
                        system.solver.levels);
    }
    set_up_multigrid<Real>(multigrid, system.matrix(), system.rotations, {}, system.solver.kernels,
                           system.solver.threads, system.solver.levels);
  }
  SolveResult solve(double tolerance, int most) override {
    return conjugate_gradients(system.matrix(), system.borders, tolerance, 0.0, most, system.solver);
  }
  std::vector<double> solution() const override { return {system.solver.x.begin(), system.solver.x.end()}; }
  double bytes() const override {
    const auto& matrix = system.system;
    const auto& solver = system.solver;
    std::size_t numbers = 0;
    for (const auto* part :
         {&matrix.node_fields, &matrix.ahead, &matrix.node_terms, &matrix.values, &matrix.diagonal,
          &matrix.inverse, &solver.b, &solver.x, &solver.r, &solver.z, &solver.p, &solver.q, &solver.packed})
      numbers += part->size();
    for (const auto& rings : matrix.rings)
      numbers += rings.records.size() + rings.forces.size() + rings.blocks.size();
    const ElementData& elements = system.body.elements;
    const Sparsity& sparsity = system.body.sparsity;
    const std::size_t rest =
        sizeof(Real) == 4 ? 4 * elements.rest_single.size() : 8 * elements.rest_double.size();
    const AssemblyPlan& plan = matrix.plan;
    const std::size_t lists = sparsity.edge_items.size() + sparsity.lane_items.size() +
                              sparsity.column.size() + sparsity.block.size() +
                              sparsity.place_of_block.size() + elements.nodes.size() +
                              elements.incident.size() + plan.lane_corners.size() + plan.lane_edges.size() +
                              plan.block.size() + plan.incident.size();
    return static_cast<double>(numbers * sizeof(Real) + rest + 4 * lists + 8 * system.rotations.size());
  }
};

struct Row {
  std::unique_ptr<Method> method;
  int iterations[targets] = {};  // -1: not reached
  std::vector<double> set_up_ms, solve_ms[targets];
};

// Fewest iterations after which the error is small enough; the error shrinks with every iteration.
int iterations_to(double error, int most, Method& method, const std::vector<double>& exact) {
  const auto reached = [&](int iterations) {
    method.solve(0, iterations);
    return relative_difference(method.solution(), exact) <= error;
  };
  if (!reached(most)) return -1;
  return fewest_iterations(most, reached);
}

void count_iterations(Row& row, const std::vector<double>& exact) {
  Method& method = *row.method;
  method.set_up();
  const SolveResult end = method.solve(last_residual, cap);
  row.iterations[targets - 1] = end.converged ? end.iterations : -1;
  int most = method.solve(1e-8, std::min(cap, 4 * end.iterations + 20)).iterations;
  for (int t = targets - 2; t >= 0; --t) {
    row.iterations[t] = iterations_to(errors[t], most, method, exact);
    if (row.iterations[t] > 0) most = row.iterations[t];
  }
}

void take_times(Row& row, bool processor_time) {
  double start = now_ms(processor_time);
  row.method->set_up();
  row.set_up_ms.push_back(now_ms(processor_time) - start);
  for (int t = 0; t < targets; ++t) {
    if (row.iterations[t] < 0) continue;
    start = now_ms(processor_time);
    row.method->solve(0, row.iterations[t]);
    row.solve_ms[t].push_back(now_ms(processor_time) - start);
  }
}

// By factorisation where its memory is small, else by conjugate gradients.
std::vector<double> exact_solution(const PressedBody& body, int threads) {
  constexpr std::int64_t most_nodes_to_factor = 40000;
  BodySystem<double> system(body, threads);
  SolveResult result;
  if (body.sparsity.nodes <= most_nodes_to_factor) {
    DirectSolver direct(body.sparsity);
    if (direct.factor(system.matrix()) >= 0)
      throw InputError(body.name + ": the matrix is not positive definite");
    result = direct.solve(system.matrix(), system.borders, system.solver);
  } else {
    result = conjugate_gradients(system.matrix(), system.borders, 1e-12, 0.0, 20 * cap, system.solver);
  }
  if (!result.converged)
    std::fprintf(stderr, "%s: the reference stopped at %g\n", body.name.c_str(), result.residual);
  return {system.solver.x.begin(), system.solver.x.end()};
}

std::string machine() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

void print_header(const Options& options) {
  std::printf("%s, %s, %d threads, medians of %d%s\n\n", machine().c_str(), isa_name(widest_isa()),
              options.threads, options.rounds, options.processor_time ? ", processor time" : "");
  std::printf(
      "| body | tets | nodes | dt ms | E Pa | stiff | nu | beta s | k N/m | contacts | method | iterations "
      "to 1e-1 | 1e-2 | "
      "1e-3 | 1e-4 | res 1e-6 | set-up ms | ms to 1e-1 | 1e-2 | 1e-3 | 1e-4 | res 1e-6 |\n|");
  for (int i = 0; i < 22; ++i) std::printf(" --- |");
  std::printf("\n");
}

void print_row(const PressedBody& body, const BodySettings& settings, const Row& row, bool chosen) {
  std::printf("| %s | %zu | %zu | %.3g | %.3g | %.3g | %.3g | %.3g | %.3g | %zu | %s%s |", body.name.c_str(),
              body.mesh.tets.size(), body.mesh.rest_positions.size(), 1e3 * settings.step_s,
              settings.youngs_modulus_Pa, settings.stiff_factor, settings.poisson_ratio, settings.beta_s,
              body.law.stiffness_N_m, body.contacts.size(), row.method->name.c_str(), chosen ? " *" : "");
  for (int iterations : row.iterations) {
    iterations < 0 ? std::printf(" - |") : std::printf(" %d |", iterations);
  }
  const double set_up = median(row.set_up_ms);
  std::printf(" %.3f |", set_up);
  for (const auto& times : row.solve_ms) {
    times.empty() ? std::printf(" - |") : std::printf(" %.2f |", set_up + median(times));
  }
  std::printf("\n");
  std::fflush(stdout);
}

constexpr std::size_t thousandth = 2;  // of the targets: an error of 1e-3

// What a method needs for an error of 1e-3, of all bodies.
struct Cost {
  double tets = 0, iterations = 0, ms = 0, bytes = 0;
};

// Of all bodies, steps and materials.
struct Results {
  std::map<std::string, std::vector<Cost>> costs;  // by method
  std::vector<double> over;                        // time of what `auto` chooses over that of the better one
};

// The exponent a of y = c x^a, by least squares of the logarithms.
double exponent(const std::vector<Cost>& costs, double Cost::*y) {
  double sx = 0, sy = 0, sxx = 0, sxy = 0;
  const double n = static_cast<double>(costs.size());
  for (const Cost& cost : costs) {
    const double u = std::log(cost.tets), v = std::log(cost.*y);
    sx += u;
    sy += v;
    sxx += u * u;
    sxy += u * v;
  }
  return (n * sxy - sx * sy) / (n * sxx - sx * sx);
}

void print_exponents(const Results& results) {
  std::printf(
      "\n| method | bodies | iterations to 1e-3 | time to 1e-3 | memory | bytes a tetrahedron, largest body "
      "|\n"
      "| --- | --- | --- | --- | --- | --- |\n");
  for (const auto& [method, list] : results.costs) {
    if (list.size() < 2) continue;
    std::printf("| %s | %zu | tets^%.2f | tets^%.2f | tets^%.2f | %.0f |\n", method.c_str(), list.size(),
                exponent(list, &Cost::iterations), exponent(list, &Cost::ms), exponent(list, &Cost::bytes),
                list.back().bytes / list.back().tets);
  }
}

void print_choices(const std::vector<double>& over) {
  if (over.empty()) return;
  const double mean = std::accumulate(over.begin(), over.end(), 0.0) / static_cast<double>(over.size());
  std::printf(
      "\nTo an error of 1e-3 the choices of `auto` (*) take %.2f times as long as the better of the two on "
      "average, %.2f times at most (%zu choices).\n",
      mean, *std::max_element(over.begin(), over.end()), over.size());
}

bool is_multigrid(const Row& row) {
  return row.method->name.starts_with("multigrid");
}

double ms_to_a_thousandth(const Row& row) {
  return median(row.set_up_ms) + median(row.solve_ms[thousandth]);
}

void add_results(const PressedBody& body, const std::vector<Row>& rows, bool multigrid, Results& results) {
  if (std::any_of(rows.begin(), rows.end(), [](const Row& row) { return row.iterations[thousandth] < 0; }))
    return;
  double chosen = 0, best = ms_to_a_thousandth(rows.front());
  for (const Row& row : rows) {
    const double ms = ms_to_a_thousandth(row);
    best = std::min(best, ms);
    if (is_multigrid(row) == multigrid) chosen = ms;
    results.costs[row.method->name].push_back({static_cast<double>(body.mesh.tets.size()),
                                               static_cast<double>(row.iterations[thousandth]), ms,
                                               row.method->bytes()});
  }
  if (rows.size() == 2) results.over.push_back(chosen / best);
}

void measure(const Options& options, const BenchMesh& mesh, const BodySettings& settings, double contact_N_m,
             Results& results) {
  PressedBody body = make_body(mesh.name, mesh.mesh, settings);
  if (contact_N_m > 0) {
    press(body, mesh.place.point, mesh.place.push, static_cast<std::size_t>(options.contact_count),
          contact_N_m);
  }
  const std::vector<double> exact = exact_solution(body, options.threads);
  const bool multigrid = takes_multigrid(body);
  for (const std::string& precision : options.precisions) {
    std::vector<Row> rows;
    for (const std::string& preconditioner : options.preconditioners) {
      Row& row = rows.emplace_back();
      if (precision == "f32") {
        row.method = std::make_unique<KrylovMethod<float>>(body, preconditioner, options.threads);
      } else {
        row.method = std::make_unique<KrylovMethod<double>>(body, preconditioner, options.threads);
      }
      count_iterations(row, exact);
    }
    for (int round = 0; round < options.rounds; ++round) {
      for (Row& row : rows) take_times(row, options.processor_time);
    }
    for (const Row& row : rows) print_row(body, settings, row, is_multigrid(row) == multigrid);
    add_results(body, rows, multigrid, results);
  }
}

void measure_all(const Options& options) {
  print_header(options);
  Results results;
  for (const std::string& name : options.bodies) {
    const auto mesh = bench_mesh(name);
    if (!mesh) {
      std::fprintf(stderr, "without %s: its image is absent\n", name.c_str());
      continue;
    }
    for (double step : options.steps) {
      for (double modulus : options.moduli) {
        for (double stiff : options.stiff) {
          for (double ratio : options.ratios) {
            for (double beta : options.betas) {
              for (double contact : options.contacts) {
                measure(options, *mesh, {modulus, stiff, ratio, step, beta}, contact, results);
              }
            }
          }
        }
      }
    }
  }
  if (options.exponents) print_exponents(results);
  print_choices(results.over);
}

}  // namespace
}  // namespace sulcus

int main(int argc, char** argv) {
  sulcus::Options options;
  CLI::App app{"Iterations and time of the linear solver to given errors, as a Markdown table"};
  app.add_option("--bodies", options.bodies, "cubes_NXxNYxNZ, jhu189_Hmm, spl_Hmm")->delimiter(',');
  app.add_option("--preconditioners", options.preconditioners)->delimiter(',');
  app.add_option("--precisions", options.precisions)->delimiter(',')->check(CLI::IsMember({"f32", "f64"}));
  app.add_option("--dt", options.steps, "s")->delimiter(',');
  app.add_option("--nu", options.ratios, "Poisson's ratio")->delimiter(',');
  app.add_option("--E", options.moduli, "Pa")->delimiter(',');
  app.add_option("--stiff", options.stiff, "E of every other block of 4x4x4 cells, times")->delimiter(',');
  app.add_option("--beta", options.betas, "s, stiffness damping")->delimiter(',');
  app.add_option("--contact", options.contacts, "N/m a contact; 0: no tool")->delimiter(',');
  app.add_option("--contacts", options.contact_count, "number of contacts");
  app.add_option("--threads", options.threads);
  app.add_option("--rounds", options.rounds);
  app.add_flag("--exponents", options.exponents, "fits cost against size over all rows of a method");
  app.add_flag("--processor-time", options.processor_time, "instead of the wall clock's; one thread only");
  CLI11_PARSE(app, argc, argv);
  try {
    if (options.processor_time && options.threads != 1)
      throw sulcus::InputError("--processor-time: of one thread only; give --threads 1");
    sulcus::measure_all(options);
  } catch (const sulcus::InputError& error) {
    std::fprintf(stderr, "solver_table: %s\n", error.what());
    return 2;
  }
}
