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
  std::mt19937_64 random;
  std::vector<double> a;  // a diagonal matrix of positive entries

  explicit Block(std::uint64_t seed) : random(seed) {
    SceneDescription d = block_description({9, 6, 4}, 0.01);
    d.fixed_nodes = nodes_where(d, [](const Vec3& x) { return x[2] < 1e-9; });
    d.solver.first_guess = FirstGuess::past;
    scene = build(std::move(d));
    state = initial_state(scene, {});
    workspace = make_workspace(scene, 2);
    solver = &workspace->twice->solver;
    a.resize(workspace->increments.size());
    for (double& number : a) number = 1.5 + uniform(random);
  }

  bool moves(std::size_t i) const { return scene.free_node[i / 3] != 0; }
  // As if a step had solved a x = b; returns x.
  std::vector<double> keep() {
    for (std::size_t i = 0; i < a.size(); ++i) workspace->increments[i] = moves(i) ? uniform(random) : 0;
    ask(workspace->increments);
    keep_for_guess(scene, *workspace, *solver, state);
    ++state.step;
    return workspace->increments;
  }
  // Makes x the solution that is looked for.
  void ask(const std::vector<double>& x) {
    for (std::size_t i = 0; i < a.size(); ++i) solver->b[entry(i)] = a[i] * x[i];
  }
  bool guess() { return guess_from_past(scene, state, *workspace, *solver); }
  std::size_t entry(std::size_t i) const {
    return solver_entry(scene, static_cast<std::int32_t>(i / 3), i % 3);
  }
};

TEST(Past, WithoutAnyThereIsNoGuess) {
  Block block(4);
  EXPECT_FALSE(block.guess());
}

TEST(Past, GuessOfWhatBothStepsTogetherExplainIsExact) {
  const std::uint64_t seed = 5;
  SCOPED_TRACE(seed);
  Block block(seed);
  block.keep();  // forgotten
  const std::vector<double> older = block.keep(), newer = block.keep();
  std::vector<double> expected;
  for (std::size_t i = 0; i < newer.size(); ++i) expected.push_back(2 * newer[i] - 0.5 * older[i]);
  block.ask(expected);
  ASSERT_TRUE(block.guess());
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(block.solver->guess[block.entry(i)], expected[i], 0.005);
}

// No other combination leaves a smaller (x - x*) . A (x - x*).
TEST(Past, GuessOfAnythingElseIsTheBestCombination) {
  const std::uint64_t seed = 6;
  SCOPED_TRACE(seed);
  Block block(seed);
  const std::vector<double> older = block.keep(), newer = block.keep();
  std::vector<double> solution;
  for (std::size_t i = 0; i < newer.size(); ++i)
    solution.push_back(older[i] + 3 * newer[i] + (block.moves(i) ? uniform(block.random) : 0));
  block.ask(solution);
  ASSERT_TRUE(block.guess());
  const auto energy_error = [&](double n, double o) {
    double sum = 0;
    for (std::size_t i = 0; i < solution.size(); ++i) {
      const double off = block.solver->guess[block.entry(i)] + n * newer[i] + o * older[i] - solution[i];
      sum += block.a[i] * off * off;
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
  Block block(seed);
  const std::mt19937_64 same = block.random;
  block.keep();
  block.random = same;
  std::vector<double> expected = block.keep();
  for (double& number : expected) number *= 4;
  block.ask(expected);
  ASSERT_TRUE(block.guess());
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(block.solver->guess[block.entry(i)], expected[i], 0.01);
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
