// The scene files of examples/: each against the reference in the file, and every named method on the small ones. The
// references come from closed forms and from integrations between located switches, not from this solver. Their
// tolerances are that of the solve times the largest value.

#include "core/base/error.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/lipschitz.hpp"
#include "files/scene_file.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace bromwich {
namespace {

constexpr double infinite = std::numeric_limits<double>::infinity();

std::vector<std::string> scene_files() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator(BROMWICH_EXAMPLES))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem());
  std::sort(names.begin(), names.end());
  return names;
}

SceneFile read(const std::string& name) {
  return read_scene_file(std::filesystem::path(BROMWICH_EXAMPLES) / (name + ".toml"));
}

std::string test_name(const testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return !std::isalnum(c); }, '_');
  return name;
}

Result run_with_states(const Scene& scene, Method method, Index steps = 0) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  return run(scene, options);
}

/// Largest error, and the number of compared values.
struct Deviation {
  double largest = 0;
  Index compared = 0;

  /// A missing value that should be known has an infinite error.
  void add(double found, double known) {
    if (std::isnan(known)) return;
    ++compared;
    const double error = std::abs(found - known);
    largest = std::max(largest, std::isnan(error) ? infinite : error);
  }
};

struct Errors {
  Deviation x, y;
};

/// Against the exact solution from T/16 on (y(0) need not be unique), up to the end of an infeasible result, and
/// against the values at the reference time.
Errors errors(const SceneFile& file, const Result& result) {
  const Scene& scene = file.scene;
  Errors e;
  const auto add_row = [&](Index row, const auto& x, const auto& y) {
    for (std::size_t i = 0; i < std::size_t(x.size()); ++i) e.x.add(result.x(row, Index(i)), x[i]);
    for (std::size_t i = 0; i < std::size_t(y.size()); ++i) e.y.add(result.y(row, Index(i)), y[i]);
  };
  const Index J = result.steps;
  if (scene.exact) {
    Vector x(scene.states()), y(scene.constraints());
    for (Index j = (J + 15) / 16; j <= J && !(result.infeasible_at && result.t[j] >= *result.infeasible_at); ++j) {
      scene.exact(result.t[j], x, y);
      add_row(j, x, y);
    }
  }
  if (file.reference && file.reference->t) {
    const double row = *file.reference->t / scene.T * double(J);
    EXPECT_NEAR(row, std::round(row), 1e-9 * double(J)) << "the time of the reference is no grid point";
    add_row(Index(std::lround(row)), file.reference->x, file.reference->y);
  }
  return e;
}

class Example : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  }
};

// As `bromwich solve FILE` does it.
TEST_P(Example, ReachesTheReferenceByDefault) {
  const SceneFile file = read(GetParam());
  ASSERT_TRUE(file.reference) << "a scene file of the project says what is known of its solution";
  const Reference& known = *file.reference;
  Options options;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result result = solve(file.scene, *backend, options);
  ASSERT_STREQ(to_string(result.status), known.status.c_str()) << result.reason;
  if (const double tolerance = default_tolerance(file.scene); tolerance > 0 && known.status == "solved") {
    ASSERT_TRUE(result.error_estimate);
    EXPECT_LE(*result.error_estimate, tolerance);
    EXPECT_EQ(result.warning.find('%'), std::string::npos) << "an error beside solved: " << result.warning;
  }
  if (known.infeasible_at) {
    ASSERT_TRUE(result.infeasible_at);
    // The first grid point without a solution, or the one before if rounding decides.
    EXPECT_NEAR(*result.infeasible_at, *known.infeasible_at, file.scene.T / double(result.steps));
  }
  const Errors e = errors(file, result);
  const bool nothing_to_compare = known.status != "solved" && !file.scene.exact && !known.t;
  EXPECT_EQ(e.x.compared + e.y.compared == 0, nothing_to_compare);
  if (e.x.compared + e.y.compared == 0) return;
  ASSERT_TRUE(known.tolerance);
  EXPECT_LE(e.x.largest, *known.tolerance) << "x, by " << to_string(result.method);
  if (result.errors && result.errors->of_integral) return;  // the mean of y is known, and not y at single times
  EXPECT_LE(e.y.largest, *known.tolerance) << "y, by " << to_string(result.method) << ", " << *result.error_estimate;
}

// A method may refuse a scene or stop, but a solved result must be close to the solution.

constexpr Index largest_small = 10;           ///< states
constexpr Index most_literal_steps = 400;     ///< it draws a contour per time point and sweep
constexpr double other_discretisation = 100;  ///< factor on the error of the method chosen by auto

/// Steps of equal length that follow the solution, and the error of a second-order method with them.
struct Grid {
  Index steps;
  double error;
};
const std::map<std::string, Grid> grids{
    {"boost", {2000, 5e-6}},
    {"bottlenecks", {1000, 2e-4}},
    {"bottlenecks-hard", {1000, 1e-4}},
    {"bridge", {600, 2e-3}},
    {"bridge-filter", {4000, 5e-3}},
    {"cuk", {2500, 5e-6}},
    {"diode-bridge", {4000, 2e-5}},
    {"dlcp-small", {400, 2e-4}},
    {"dlcp-small-printed", {400, 0}},
    {"dlcp-small-unstable", {4000, 2e-4}},
    {"flyback", {2000, 9e-3}},
    {"fold", {400, 1e-12}},
    {"grazing", {400, 2e-4}},
    {"lq-control", {400, 1e-2}},
    {"nash-game-mixed", {160, 1e-6}},
    {"nearly-singular", {400, 2e-4}},
    {"periodic-rectifier", {400, 1e-3}},
    {"rectifier-node", {1000, 5e-4}},
    {"relay-oscillator", {2000, 1e-2}},
    {"relay-sliding", {4000, 5e-4}},
    {"rlc-port", {400, 1e-11}},
    {"rlcd", {4000, 1e-3}},
    {"rlcd-degenerate", {4000, 1e-3}},
    {"singular", {400, 2e-4}},
    {"stiff", {400, 1e-4}},
    {"stiff-singular", {400, 2e-4}},
    {"template", {4000, 1e-3}},
    {"unstable", {1000, 5e-2}},
};

class SmallExample : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {  // not earlier: reading all files in each test would take longer than most tests
    if (file_.scene.states() > largest_small || !grids.contains(GetParam()))
      GTEST_SKIP() << "larger than what all methods are tried on";
    steps_ = grids.at(GetParam()).steps;
    bound_ = other_discretisation * grids.at(GetParam()).error;
  }
  SmallExample() : file_(read(GetParam())) {}

  bool infeasible() const { return file_.reference && file_.reference->status == "infeasible"; }

  const SceneFile file_;
  Index steps_ = 0;
  double bound_ = 0;
};

TEST_P(SmallExample, SecondOrderMethodsAreRightOrSayNo) {
  for (const Method method : {Method::march, Method::contour, Method::contour_literal}) {
    if (method == Method::contour_literal && steps_ > most_literal_steps) continue;
    const Result result = run_with_states(file_.scene, method, steps_);
    SCOPED_TRACE(to_string(method));
    EXPECT_EQ(result.method, method) << "a method that is named is never replaced";
    if (infeasible()) {
      EXPECT_EQ(result.status, Status::infeasible) << result.reason;
    }
    if (result.status != Status::solved) {
      EXPECT_FALSE(result.reason.empty());
      continue;
    }
    const Errors e = errors(file_, result);
    EXPECT_LE(e.x.largest, bound_);
    EXPECT_LE(e.y.largest, bound_);
  }
}

TEST_P(SmallExample, ImplicitEulerConvergesOrSaysNo) {
  const Scene& s = file_.scene;
  const Result coarse = run_with_states(s, Method::euler, steps_), fine = run_with_states(s, Method::euler, 4 * steps_);
  EXPECT_EQ(coarse.method, Method::euler);
  if (infeasible()) {
    EXPECT_EQ(coarse.status, Status::infeasible) << coarse.reason;
  }
  for (const Result* result : {&coarse, &fine}) EXPECT_EQ(result->reason.empty(), result->status == Status::solved);
  if (coarse.status != Status::solved || fine.status != Status::solved) return;
  const Errors far = errors(file_, coarse), near = errors(file_, fine);
  // First order: a quarter of the step gives a quarter of the error if it is small, half if it is not.
  EXPECT_LE(near.x.largest, std::max(far.x.largest / 2, bound_));
  if (s.constraints() == 0) return;
  // If M does not determine y, an error O(h) of x that a constraint removes within one step enters y divided by h.
  constexpr double well_conditioned = 1e3;  // of M as a map from w to y; scenes as above have 1e10 or infinity
  if (solution_lipschitz(s.M) * std::max(1., to_dense(s.M).cwiseAbs().maxCoeff()) > well_conditioned) return;
  EXPECT_LE(near.y.largest, std::max(far.y.largest / 2, bound_));
}

// Up to T = 1 an error grows by e^118: no step is small enough, and no method may call the result solved.
TEST(UnstableVariant, IsRightOrSaysNoUnderEveryMethod) {
  SceneFile file = read("dlcp-small-unstable");
  file.scene.T = 1;
  for (const Method method :
       {Method::automatic, Method::march, Method::contour, Method::contour_literal, Method::euler})
    for (const Index steps : {32, 200, 1000}) {
      if (method == Method::contour_literal && steps > 200) continue;  // takes seconds and adds nothing
      const Result result = run_with_states(file.scene, method, steps);
      EXPECT_TRUE(result.status != Status::infeasible) << to_string(method) << ' ' << steps;
      if (result.status != Status::solved) continue;
      EXPECT_LE(errors(file, result).x.largest, 0.01) << to_string(method) << ' ' << steps;
    }
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(SmallExample);  // without the TOML reader there are no cases
INSTANTIATE_TEST_SUITE_P(Files, SmallExample, testing::ValuesIn(scene_files()), test_name);
INSTANTIATE_TEST_SUITE_P(Files, Example, testing::ValuesIn(scene_files()), test_name);

}  // namespace
}  // namespace bromwich
