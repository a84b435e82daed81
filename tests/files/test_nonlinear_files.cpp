// Scene files with a section [nonlinear]: the examples against SciPy (bench/results/nonlinear-reference.json),
// derivatives of expressions against complex steps, and what is said of bad input.

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "files/nonlinear_file.hpp"
#include "files/slope.hpp"
#include "nonlinear/nonlinear_output.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <complex>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

const fs::path folder = fs::path(BROMWICH_EXAMPLES) / "nonlinear";

std::vector<std::string> nonlinear_examples() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ".toml") names.push_back(entry.path().stem());
  std::sort(names.begin(), names.end());
  return names;
}

NonlinearFile example(const std::string& name) { return read_nonlinear_file(folder / (name + ".toml")); }

NonlinearResult march(const NonlinearFile& file, Index steps) {
  const auto backend = make_cpu_backend();
  NonlinearOptions options;
  options.steps = steps;
  return solve_nonlinear(*file.system, *backend, options);
}

double apart(const Eigen::Ref<const RowMatrix>& row, const std::vector<double>& known) {
  double largest = 0;
  for (std::size_t i = 0; i < known.size(); ++i)
    if (!std::isnan(known[i])) largest = std::max(largest, std::abs(row(0, Index(i)) - known[i]));
  return largest;
}

/// Steps of equal length h, and their error.
struct StatedGrid {
  Index steps;
  double error;
};
const std::map<std::string, StatedGrid> stated_grids{
    // y is a line over h = 0.005, which errs by h^2/8 F_s v''/eps, about 60 h^2/8.
    {"belt", {4000, 3e-4}},
    // q^3 is a line over h = 0.0075, which errs by h^2/8 6 |q| v^2, about 100 h^2/8; y is 5 times the error of q.
    {"cubic-stop", {800, 4e-3}},
    // r u (1 - u) is a line over h = 0.008, which errs by h^2/8 2 r u'^2, with u' up to r/4, and by as much again for
    // y.
    {"harvest", {100, 2e-4}},
    // The product is a line over h = 0.005, which errs by h^2/8 times its second derivative, about 10; the step that
    // reaches the floor errs by h^2/2 times the jump of y.
    {"predator-prey", {2400, 1e-4}},
    // A step of Radau IIA errs by (h/sqrt(L C))^4/72 = 1e-11 of the values, 2000 steps by 3e-7 V.
    {"saturating-boost", {2000, 1e-5}},
    // k flux^3 is a line over h = 0.005, which errs by h^2/8 times its second derivative, about 100.
    {"saturating-rectifier", {2000, 3e-4}},
    // y is a line over h = 0.0025, which errs by h^2/8 |y''|, y'' = 4 E/r = 40.
    {"shockley", {1600, 5e-5}},
    // y is a line over h = 0.005, which errs by h^2/8 |y''|, about (2 pi)^2/2 h^2/8.
    {"surface-reaction", {250, 1e-4}},
};

class NonlinearExample : public testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  }
};

TEST_P(NonlinearExample, ReachesItsReferenceWithOrderTwo) {
  const NonlinearFile file = example(GetParam());
  ASSERT_TRUE(file.system && file.file.reference);
  const Reference& known = *file.file.reference;
  const auto [J, bound] = stated_grids.at(GetParam());
  double error[2];
  for (const int part : {0, 1}) {  // J/4 and J
    const NonlinearResult r = march(file, part == 0 ? J / 4 : J);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(r.residual, 1e-9);  // Newton ends at 1e-12 of the largest value, or at rounding
    // Large scenes have y alone.
    error[part] = r.x.size() > 0 ? apart(r.x.bottomRows(1), known.x) : apart(r.y.bottomRows(1), known.y);
    if (part == 1) {
      EXPECT_LE(apart(r.y.bottomRows(1), known.y), bound);
    }
  }
  EXPECT_LE(error[1], bound);
  // Switches fall into steps anywhere, which moves the order seen on two grids by up to 1/2: 1.5.
  EXPECT_GE(error[0] / error[1], 8) << error[0] << " " << error[1];
}

// As `bromwich solve FILE` does it.
TEST_P(NonlinearExample, ReachesItsReferenceByDefault) {
  const NonlinearFile file = example(GetParam());
  ASSERT_TRUE(file.system && file.file.reference && file.file.reference->tolerance);
  const Reference& known = *file.file.reference;
  const NonlinearResult r = march(file, 0);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.error_estimate);
  EXPECT_LE(*r.error_estimate, default_tolerance(file.file.scene));
  EXPECT_LE(apart(r.y.bottomRows(1), known.y), *known.tolerance);
  if (r.x.size() > 0) {
    EXPECT_LE(apart(r.x.bottomRows(1), known.x), *known.tolerance);
  }
}

INSTANTIATE_TEST_SUITE_P(Files, NonlinearExample, testing::ValuesIn(nonlinear_examples()), [](const auto& of) {
  std::string name = of.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

TEST(NonlinearFiles, HaveTheNumbersOfTheirReference) {
  if (!scene_files_available()) GTEST_SKIP();
  std::ifstream in(fs::path(BROMWICH_EXAMPLES) / "../bench/results/nonlinear-reference.json");
  const auto all = nlohmann::json::parse(in).at("scenes");
  for (const std::string& name : nonlinear_examples()) {
    const NonlinearFile file = example(name);
    const auto& found = all.at(name);
    ASSERT_EQ(found.at("y").size(), file.file.reference->y.size()) << name;
    for (std::size_t i = 0; i < file.file.reference->x.size(); ++i)
      EXPECT_NEAR(file.file.reference->x[i], found.at("x")[i].get<double>(), 1e-11) << name;  // 13 digits
    for (std::size_t i = 0; i < file.file.reference->y.size(); ++i)
      if (!found.at("y")[i].is_null()) {
        EXPECT_NEAR(file.file.reference->y[i], found.at("y")[i].get<double>(), 1e-11) << name;
      }
  }
}

// A linear scene with a phi that is 0, divided at kinks of f and g. tests/nonlinear has scenes without kinks, which
// agree to rounding.
TEST(NonlinearFiles, LinearScenesWithKinksStayTheSame) {
  if (!scene_files_available()) GTEST_SKIP();
  std::ifstream in(fs::path(BROMWICH_EXAMPLES) / "dlcp-small.toml");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  const NonlinearFile file = parse_nonlinear(text + "\n[nonlinear]\nphi = [\"0*x0\", 0, 0]\n", "zero.toml");
  const auto backend = make_cpu_backend();
  Options options;
  options.method = Method::march;
  options.steps = 400;
  options.states = StateSelection::all;
  const Result linear = solve(parse_scene(text, "linear.toml").scene, *backend, options);
  const NonlinearResult same = march(file, linear.steps);
  ASSERT_EQ(same.status, Status::solved) << same.reason;
  // On the parts of a divided step f is a line, and of second degree there: h^3/12 |f''| of each, f'' up to 2 (3 pi)^2,
  // and a gain of M of 3.
  const double h = 1.0 / double(linear.steps), apart = 3 * h * h * h / 12 * 180;
  EXPECT_LE((same.x - linear.x).cwiseAbs().maxCoeff(), apart);
  EXPECT_LE((same.y - linear.y).cwiseAbs().maxCoeff(), apart);
}

// Scenes of every kind of y, continuous or not, with a phi that is 0: the engine of linear scenes does all of it.
TEST(NonlinearFiles, LinearScenesAreSolvedAsTheirEngineDoes) {
  if (!scene_files_available()) GTEST_SKIP();
  for (const std::string name : {"rlcd", "diode-bridge", "nearly-singular", "resonant-converter", "stiff", "boost"}) {
    std::ifstream in(fs::path(BROMWICH_EXAMPLES) / (name + ".toml"));
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    const Scene scene = parse_scene(text, "linear.toml").scene;
    std::string phi = "\"0*x0\"";
    for (Index i = 1; i < scene.states(); ++i) phi += ", 0";
    const NonlinearFile file = parse_nonlinear(text + "\n[nonlinear]\nphi = [" + phi + "]\n", "zero.toml");
    const auto backend = make_cpu_backend();
    Options options;
    options.method = Method::march;
    options.states = StateSelection::all;
    options.steps = 200;
    const Result linear = solve(scene, *backend, options);
    const NonlinearResult same = march(file, 200);
    ASSERT_EQ(same.status, linear.status) << name << same.reason;
    EXPECT_EQ(same.continuous, linear.continuous) << name;
    EXPECT_LE((same.x - linear.x).cwiseAbs().maxCoeff(), 1e-12 * linear.x.cwiseAbs().maxCoeff()) << name;
    EXPECT_LE((same.y - linear.y).cwiseAbs().maxCoeff(), 1e-12 * linear.y.cwiseAbs().maxCoeff()) << name;
    EXPECT_LE(same.residual, 1e-8) << name;
  }
}

const std::string spring =
    "[dynamics]\nA = [[0, 1], [-1, -0.2]]\nB = [[0], [1]]\nx0 = [0.3, 0]\n[complementarity]\nN = [[1, 0]]\nM = "
    "[[0.2]]\n"
    "[time]\nT = 2\nsteps = 40\n";

NonlinearFile with(const std::string& nonlinear) { return parse_nonlinear(spring + nonlinear, "my.toml"); }

TEST(NonlinearFiles, DerivativesOfExpressionsAreExact) {
  if (!scene_files_available()) GTEST_SKIP();
  // The same functions of complex numbers: Im f(a + i h) / h is f' without cancellation (h = 1e-30).
  using C = std::complex<double>;
  const std::vector<std::pair<std::string, std::function<C(C, C)>>> functions{
      {"x0*y0 + x0/y0 - y0^3", [](C x, C y) { return x * y + x / y - y * y * y; }},
      {"sin(x0)*cos(y0) + tan(x0)", [](C x, C y) { return std::sin(x) * std::cos(y) + std::tan(x); }},
      {"exp(-x0*y0) + sinh(x0)*cosh(y0) - tanh(y0)",
       [](C x, C y) { return std::exp(-x * y) + std::sinh(x) * std::cosh(y) - std::tanh(y); }},
      {"log(x0) + log10(y0) + log2(x0*y0) + sqrt(x0 + y0)",
       [](C x, C y) { return std::log(x) + std::log10(y) + std::log(x * y) / std::log(2.0) + std::sqrt(x + y); }},
      {"asin(x0) + acos(y0) + atan(x0*y0)", [](C x, C y) { return std::asin(x) + std::acos(y) + std::atan(x * y); }},
      {"x0^y0 + pow(y0, x0) + expm1(x0)", [](C x, C y) { return std::pow(x, y) + std::pow(y, x) + std::exp(x) - 1.0; }},
      {"cbrt(x0) + atan2(y0, x0)", [](C x, C y) { return std::pow(x, 1.0 / 3) + std::atan(y / x); }},
      {"x0 < y0 ? x0^2 : y0^2", [](C x, C) { return x * x; }},
      {"max(x0, y0) + 2*min(x0, y0) + abs(x0 - y0)", [](C x, C y) { return y + 2.0 * x + y - x; }},
      {"mod(5*y0, x0) + floor(x0) + sign(y0)", [](C x, C y) { return 5.0 * y - 11.0 * x + 1.0; }}};
  const double x = 0.31, y = 0.73, h = 1e-30;
  for (const auto& [text, f] : functions) {
    const NonlinearFile file = with("[nonlinear]\ngamma = [\"" + text + "\"]\n");
    Vector value(1);
    Matrix by_x(1, 2), by_y(1, 1);
    const Vector at = Vector{{x, 2.0}}, at_y = Vector{{y}};
    file.system->gamma(0, at, at_y, value);
    file.system->dgamma(0, at, at_y, by_x, by_y);
    const double rounding = 1e-14 * 10;  // ten operations of values up to 10
    EXPECT_NEAR(value[0], f(x, y).real(), rounding) << text;
    EXPECT_NEAR(by_x(0, 0), f(C(x, h), y).imag() / h, rounding) << text;
    EXPECT_EQ(by_x(0, 1), 0) << text;
    EXPECT_NEAR(by_y(0, 0), f(x, C(y, h)).imag() / h, rounding) << text;
  }
  // Error functions: the slopes are those of the integral.
  EXPECT_NEAR(derivative(Operation::erf, 0.4), 2 / std::sqrt(M_PI) * std::exp(-0.16), 1e-15);
  EXPECT_NEAR(derivative(Operation::erfc, 0.4), -2 / std::sqrt(M_PI) * std::exp(-0.16), 1e-15);
}

TEST(NonlinearFiles, NamesParametersDefinitionsAndOneExpressionForAll) {
  if (!scene_files_available()) GTEST_SKIP();
  const auto value = [](const NonlinearFile& file, double t) {
    Vector v(2);
    file.system->phi(t, Vector{{2, 3}}, Vector{{5}}, v);
    return v;
  };
  const Vector named = value(with("[parameters]\nk = 7\n[definitions]\ns = \"k*t\"\n[names]\nx = [\"q\", \"v\"]\n"
                                  "y = [\"force\"]\n[nonlinear]\nphi = [\"s*q\", \"force - v + y0\"]\n"),
                             2);
  EXPECT_EQ(named, (Vector{{28, 7}}));
  const Vector own = value(with("[nonlinear]\nphi = \"x^2 + i\"\n"), 0);
  EXPECT_EQ(own, (Vector{{4, 10}}));
  const NonlinearFile trace = with("[nonlinear]\nof = \"trace\"\ngamma = \"v + y\"\n");
  EXPECT_TRUE(trace.system->of_trace);
  Vector w(1);
  trace.system->gamma(0, Vector{{2}}, Vector{{5}}, w);
  EXPECT_EQ(w[0], 7);
}

TEST(NonlinearFiles, SayWhatIsWrong) {
  if (!scene_files_available()) GTEST_SKIP();
  const std::vector<std::pair<std::string, std::string>> cases{
      {"[nonlinear]\n", "my.toml:11: nonlinear.phi: found neither phi nor gamma"},
      {"[nonlinear]\nphi = [\"x0\"]\n", "my.toml:12: nonlinear.phi: has 1 entries; give 2"},
      {"[nonlinear]\nphi = [\"x0\", \"x2\"]\n", "my.toml:12: nonlinear.phi: 'x2' uses 'x2', which is not defined"},
      {"[nonlinear]\nphi = [\"x0\", \"sine(x1)\"]\n", "my.toml:12: nonlinear.phi: 'sine(x1)' calls 'sine'"},
      {"[nonlinear]\ngamma = [\"x0 +\"]\n", "my.toml:12: nonlinear.gamma: the expression ends too early"},
      {"[nonlinear]\nphy = [\"x0\", 0]\n", "my.toml:12: nonlinear.phy: is no known key (did you mean 'phi'?)"},
      {"[nonlinear]\nof = \"trase\"\ngamma = \"v\"\n", "my.toml:12: nonlinear.of: found 'trase'"},
      {"[parameters]\nx0 = 2\n[nonlinear]\ngamma = [\"x0\"]\n",
       "my.toml:14: nonlinear.gamma: 'x0' uses 'x0', a component and a name of the file"},
      {"[free]\nrows = [0]\n[nonlinear]\ngamma = [\"x0\"]\n", "my.toml:12: free.rows: the linear part has free rows"}};
  for (const auto& [text, message] : cases) {
    const std::string found = refusal([&] { with(text); });
    EXPECT_TRUE(found.starts_with(message)) << found << "\nexpected: " << message;
    EXPECT_NE(found.find("; "), std::string::npos) << found;
  }
  // Where only linear scenes are read, half of the system is not solved in silence.
  const std::string half = refusal([&] { parse_scene(spring + "[nonlinear]\ngamma = [\"x0\"]\n", "my.toml"); });
  EXPECT_TRUE(half.starts_with("my.toml: nonlinear: the file states a nonlinear system")) << half;
}

}  // namespace
}  // namespace bromwich
