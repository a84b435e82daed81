// Goal-oriented grids on a device: whole adaptive runs against the CPU.
//
// The same sums in another order: x differs by 1e-13 relative. A cell violates the balance by 1e-6 or more of the
// subtracted energies, so violations and indicators keep seven digits. Cells are marked in the same order, since no two
// indicators of these scenes agree to seven digits.

#include "catalogue/catalogue.hpp"
#include "core/goal/goal.hpp"
#include "tests/support/backends.hpp"

#include <cmath>

namespace bromwich {
namespace {

class GoalBackends : public BothBackends {
 protected:
  void expect_same(const Scene& scene, const GoalOptions& goal, Index steps, const std::string& name) {
    SCOPED_TRACE(name);
    Options options = options_for(Method::goal, steps);
    options.goal = std::make_shared<GoalOptions>(goal);
    options.states = StateSelection::all;
    const Result expected = solve(scene, *cpu, options), found = solve(scene, *cuda, options);
    EXPECT_EQ(found.backend, "cuda");
    EXPECT_EQ(found.status, expected.status);
    EXPECT_EQ(found.t, expected.t);
    ASSERT_EQ(found.x.rows(), expected.x.rows());
    EXPECT_LE((found.x - expected.x).cwiseAbs().maxCoeff(), 1e-12 * expected.x.cwiseAbs().maxCoeff());
    ASSERT_EQ(found.goal->history.size(), expected.goal->history.size());
    for (std::size_t k = 0; k < found.goal->history.size(); ++k) {
      const GoalCycle &a = found.goal->history[k], &b = expected.goal->history[k];
      EXPECT_EQ(a.cells, b.cells);
      EXPECT_EQ(a.sizes, b.sizes);
      EXPECT_NEAR(a.quantity, b.quantity, 1e-7 * b.quantity);
      EXPECT_NEAR(a.estimate, b.estimate, 1e-7 * b.absolute);
      EXPECT_NEAR(a.absolute, b.absolute, 1e-7 * b.absolute);
    }
  }
};

TEST_F(GoalBackends, AdaptTheSameGrids) {
  for (const char* name : {"ph-toy", "ladder"})
    for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint})
      for (const CellWeights weights : {CellWeights::local, CellWeights::global}) {
        GoalOptions goal;
        goal.scheme = scheme;
        goal.weights = weights;
        goal.adjoint.method = weights == CellWeights::local ? AdjointMethod::substitution : AdjointMethod::scan;
        expect_same(make_scene(name), goal, 150,
                    std::string(name) + " " + to_string(scheme) + " " + to_string(weights));
      }
}

TEST_F(GoalBackends, SparseScenesSayWhereTheyRan) {
  GoalOptions goal;
  expect_same(make_scene("ladder", {{"n", 40}}), goal, 60, "written out");
  expect_same(make_scene("ladder", {{"n", 150}}), goal, 40, "sparse");
  Options options = options_for(Method::goal, 20);
  const Result sparse = solve(make_scene("ladder", {{"n", 150}}), *cuda, options);
  EXPECT_NE(sparse.kernel.find("on the host"), std::string::npos) << sparse.kernel;
}

}  // namespace
}  // namespace bromwich
