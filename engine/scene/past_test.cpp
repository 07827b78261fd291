#include "engine/scene/past.h"

#include <gtest/gtest.h>

#include <random>

#include "engine/numerics/error.h"
#include "engine/scene/test_scenes.h"

namespace sulcus {
namespace {

double uniform(std::mt19937_64& random) {
  return static_cast<double>(random() >> 11) * 0x1p-52 - 1;
}

// A block whose bottom is held, with the memory that a step solves in.
struct Block {
  Scene scene;
  State state;
  WorkspacePtr workspace;
  SolverWorkspace<double>* solver = nullptr;

  Block() {
    SceneDescription d = block_description({9, 6, 4}, 0.01);
    d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
    d.solver.first_guess = FirstGuess::past;
    scene = build(std::move(d));
    state = initial_state(scene, {});
    workspace = make_workspace(scene, 2);
    solver = &workspace->twice->solver;
  }

  // As if a step had solved A x = b with the diagonal matrix A of positive entries.
  void keep(std::mt19937_64& random, const std::vector<double>& a) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      const bool moves = scene.free_node[i / 3] != 0;
      workspace->increments[i] = moves ? uniform(random) : 0;
      solver->b[entry(i)] = a[i] * workspace->increments[i];
    }
    keep_for_guess(scene, *workspace, *solver, state);
    ++state.step;
  }
  std::size_t entry(std::size_t i) const {
    return solver_entry(scene, static_cast<std::int32_t>(i / 3), i % 3);
  }
};

std::vector<double> diagonal(std::mt19937_64& random, const Block& block) {
  std::vector<double> a(block.workspace->increments.size());
  for (double& entry : a) entry = 1.5 + uniform(random);
  return a;
}

TEST(Past, WithoutAnyThereIsNoGuess) {
  Block block;
  EXPECT_FALSE(guess_from_past(block.scene, block.state, *block.workspace, *block.solver));
}

TEST(Past, GuessOfWhatBothStepsTogetherExplainIsExact) {
  const std::uint64_t seed = 5;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Block block;
  const std::vector<double> a = diagonal(random, block);
  std::vector<std::vector<double>> steps;
  for (int n = 0; n < 3; ++n) {  // the first is forgotten
    block.keep(random, a);
    steps.push_back(block.workspace->increments);
  }
  const auto expected = [&](std::size_t i) { return 2 * steps[2][i] - 0.5 * steps[1][i]; };
  for (std::size_t i = 0; i < a.size(); ++i) block.solver->b[block.entry(i)] = a[i] * expected(i);
  ASSERT_TRUE(guess_from_past(block.scene, block.state, *block.workspace, *block.solver));
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_NEAR(block.solver->guess[block.entry(i)], expected(i), 0.005);
}

// No other combination leaves a smaller (x - x*) . A (x - x*).
TEST(Past, GuessOfAnythingElseIsTheBestCombination) {
  const std::uint64_t seed = 6;
  SCOPED_TRACE(seed);
  std::mt19937_64 random(seed);
  Block block;
  const std::vector<double> a = diagonal(random, block);
  block.keep(random, a);
  const std::vector<double> older = block.workspace->increments;
  block.keep(random, a);
  const std::vector<double> newer = block.workspace->increments;
  std::vector<double> solution(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    solution[i] = older[i] + 3 * newer[i] + (block.scene.free_node[i / 3] ? uniform(random) : 0);
    block.solver->b[block.entry(i)] = a[i] * solution[i];
  }
  ASSERT_TRUE(guess_from_past(block.scene, block.state, *block.workspace, *block.solver));
  const auto energy_error = [&](double n, double o) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      const double off = block.solver->guess[block.entry(i)] + n * newer[i] + o * older[i] - solution[i];
      sum += a[i] * off * off;
    }
    return sum;
  };
  const double best = energy_error(0, 0);
  for (const double n : {-0.03, 0.0, 0.03}) {
    for (const double o : {-0.03, 0.0, 0.03}) {
      if (n != 0 || o != 0) {
        EXPECT_GT(energy_error(n, o), best) << n << ' ' << o;
      }
    }
  }
}

TEST(Past, StepsThatAreTheSameAreNotDividedByNothing) {
  const std::uint64_t seed = 7;
  SCOPED_TRACE(seed);
  Block block;
  std::mt19937_64 random(seed);
  const std::vector<double> a = diagonal(random, block);
  for (int n = 0; n < 2; ++n) {
    std::mt19937_64 same(seed + 1);
    block.keep(same, a);
  }
  for (std::size_t i = 0; i < a.size(); ++i) block.solver->b[block.entry(i)] *= 4;
  ASSERT_TRUE(guess_from_past(block.scene, block.state, *block.workspace, *block.solver));
  for (std::size_t i = 0; i < a.size(); ++i)
    EXPECT_NEAR(block.solver->guess[block.entry(i)], 4 * block.workspace->increments[i], 0.01);
}

TEST(Past, IsRefusedWhereNodesAreLedAndCostsNothingElsewhere) {
  SceneDescription d = block_description({2, 2, 2}, 0.01);
  EXPECT_EQ(past_size(build(d)), 0u);
  EXPECT_TRUE(initial_state(build(d), {}).past_increments.empty());
  d.solver.first_guess = FirstGuess::past;
  d.motions.push_back(straight_motion({0}, Vec3(0.001, 0, 0), 4));
  EXPECT_THROW(build(std::move(d)), InputError);
}

}  // namespace
}  // namespace sulcus
