// Error control of the example files: y may jump, and there may be no solution.

#include "files/scene_file.hpp"
#include "tests/support/true_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>

namespace bromwich::tolerance_test {
namespace {

class ErrorControlOfExamples : public testing::Test {
 protected:
  void SetUp() override {
    if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  }
  static Scene read(const std::string& name) {
    return read_scene_file(std::filesystem::path(BROMWICH_EXAMPLES) / (name + ".toml")).scene;
  }
};

TEST_F(ErrorControlOfExamples, WithoutASolutionEndAsInfeasible) {
  const Result at_once = run(read("dlcp-small-printed"), options_to(1e-4));
  EXPECT_EQ(at_once.status, Status::infeasible);
  EXPECT_EQ(at_once.errors->grids.size(), 1u) << "at t = 0 no grid changes that";
  const Scene scene = read("fold");
  const Result later = run(scene, options_to(1e-4));
  EXPECT_EQ(later.status, Status::infeasible) << later.reason;
  EXPECT_GE(later.steps, scene.steps());
}

TEST_F(ErrorControlOfExamples, OfDiscontinuousYControlYWhereItConverges) {
  for (const char* name : {"diode-bridge", "singular"}) {
    const Scene scene = read(name);
    const Result result = run(scene, options_to(1e-5, Method::march));
    ASSERT_EQ(result.status, Status::solved) << name << ": " << result.reason;
    EXPECT_FALSE(result.continuous);
    EXPECT_FALSE(result.errors->of_integral);
    const double error = true_error(scene, result);
    EXPECT_LE(error, 1e-5) << name;
    // Scattered estimates are at least a third of the error (tests/accuracy/test_convergence.cpp,
    // OfScatteredErrors...).
    EXPECT_GE(*result.error_estimate, error / 3) << name;
  }
}

// Perturbations grow by 1e4 here: rounding alone causes errors of 1e-6 in y. The exact solution is known.
TEST_F(ErrorControlOfExamples, CountWhatRoundingDoesToY) {
  const Scene scene = read("dlcp-small-unstable");
  for (const double tolerance : {1e-5, 1e-6}) {
    const Result result = run(scene, options_to(tolerance));
    ASSERT_TRUE(result.error_estimate) << result.reason;
    const double error = true_error(scene, result);
    EXPECT_TRUE(result.status != Status::solved || error <= tolerance) << error;
    EXPECT_GE(*result.error_estimate, 0.3 * error) << tolerance << ' ' << result.steps;
    EXPECT_GT(result.errors->rounding, 10 * result.rounding) << "y is more sensitive than x";
  }
}

// Switches of this relay keep their place within the step for several halvings, so differences of grids vanish by
// chance.
TEST_F(ErrorControlOfExamples, AreNotSolvedByChance) {
  const Scene scene = read("relay-oscillator");
  for (const Index first : {0, 82}) {
    Options options = options_to(1e-3);
    options.steps = first;
    const Result result = run(scene, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_TRUE(result.errors->of_integral) << "y jumps";
    EXPECT_GE(result.steps, scene.steps()) << "a coarse grid does not show what jumps";
  }
}

TEST_F(ErrorControlOfExamples, OfJumpsControlTheMean) {
  for (const char* name : {"relay-sliding", "bridge-filter"}) {  // jumps; an impulse at t = 0
    const Scene scene = read(name);
    const double tolerance = 1e-3;
    const Result result = run(scene, options_to(tolerance, Method::march));
    ASSERT_EQ(result.status, Status::solved) << name << ": " << result.reason;
    EXPECT_TRUE(result.errors->of_integral) << name;
    Options fine;
    fine.method = Method::march;
    fine.steps = 8 * result.steps;
    const double error = relative(integral_of_y(result), integral_of_y(run(scene, fine)), 8);
    EXPECT_LE(error, tolerance) << name;
    EXPECT_GE(*result.error_estimate, least_effectivity * error) << name;
  }
}

}  // namespace
}  // namespace bromwich::tolerance_test
