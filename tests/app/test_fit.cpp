// Parameters from measured values: noise of many seeds, bounds, what the data do not determine, and bad files.

#include "app/fit.hpp"

#include "core/base/error.hpp"
#include "core/scene/relay.hpp"
#include "core/solve/dense_output.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <unistd.h>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <random>

namespace bromwich::app::fit_test {
namespace {

// A resonant circuit with a resistor and a diode: parameters (R, C).
Scene circuit(const Vector& p) {
  const double R = p[0], C = p[1], L = 0.3;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, -1 / C}, {1 / L, 0}}, Matrix{{-1 / C}, {0}}, Matrix{{-1, 0}}};
  scene.M = Matrix{{R}};
  scene.x0 = Vector{{1, 0}};
  scene.T = 4;
  return scene;
}

Options on_grid() {
  Options options;
  options.steps = 300;
  options.method = Method::march;
  return options;
}

// x0 and y0 at 40 times, with noise.
FitData measured(unsigned seed, double noise) {
  static const auto backend = make_cpu_backend(1);
  Options options = on_grid();
  options.states = StateSelection::all;
  static const Result exact = solve(circuit(Vector{{0.8, 1.3}}), *backend, options);
  FitData data;
  data.columns = {{ColumnKind::x, 0, "x0"}, {ColumnKind::y, 0, "y0"}};
  data.values.resize(40, 2);
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal(0, noise);
  for (Index k = 0; k < 40; ++k) {
    const Index row = 7 * (k + 1);
    data.t.push_back(exact.t[row]);
    data.values(k, 0) = exact.x(row, 0) + normal(generator);
    data.values(k, 1) = exact.y(row, 0) + normal(generator);
  }
  return data;
}

Fit fitted(const FitData& data, const std::vector<FreeParameter>& free) {
  return fit(circuit, free, data, *make_cpu_backend(1), on_grid());
}

TEST(Fit, FindsTheParametersFromThreeTimesAway) {
  for (const auto& [R, C] : {std::pair(2.4, 3.9), {0.27, 0.44}, {2.4, 0.44}}) {
    const Fit f = fitted(measured(1, 0), {{"R", R, 1e-3}, {"C", C, 1e-3}});
    EXPECT_TRUE(f.converged) << f.ended;
    EXPECT_NEAR(f.p[0], 0.8, 1e-6);
    EXPECT_NEAR(f.p[1], 1.3, 1e-6);
  }
}

// Units of the parameters that are 1e18 apart say nothing about each other.
TEST(Fit, ParametersMayHaveAnyUnits) {
  for (const auto& [of_R, of_C] : {std::pair(1e-9, 1e9), {1e9, 1e-9}}) {
    const auto in_units = [r = of_R, c = of_C](const Vector& p) { return circuit(Vector{{p[0] / r, p[1] / c}}); };
    const Fit f = fit(in_units, {{"R", 1.2 * of_R}, {"C", 1 * of_C}}, measured(1, 0), *make_cpu_backend(1), on_grid());
    EXPECT_TRUE(f.converged) << f.ended;
    EXPECT_NEAR(f.p[0] / of_R, 0.8, 1e-6);
    EXPECT_NEAR(f.p[1] / of_C, 1.3, 1e-6);
  }
}

// Of 200 intervals of 95 % about 190 contain the truth; the standard deviation of that number is 3.1. Four of them.
TEST(Fit, IntervalsContainTheTruthAsOftenAsTheySay) {
  int of_R = 0, of_C = 0;
  for (unsigned seed = 1000; seed < 1200; ++seed) {
    const Fit f = fitted(measured(seed, 0.02), {{"R", 0.7}, {"C", 1.4}});
    ASSERT_TRUE(f.converged) << seed << " " << f.ended;
    of_R += f.low[0] <= 0.8 && 0.8 <= f.high[0];
    of_C += f.low[1] <= 1.3 && 1.3 <= f.high[1];
  }
  for (const int inside : {of_R, of_C}) {
    EXPECT_GE(inside, 178);
    EXPECT_LT(inside, 200);
  }
}

// Between the time points, where N x takes the state.
TEST(Fit, TakesValuesOfWAlone) {
  FitData data;
  data.columns = {{ColumnKind::w, 0, "w0"}};
  const auto backend = make_cpu_backend(1);
  Options options = on_grid();
  options.states = StateSelection::all;
  options.trace = true;
  const Scene scene = circuit(Vector{{0.8, 1.3}});
  for (int k = 1; k < 20; ++k) data.t.push_back(0.2013 * k);
  const Result at = at_times(scene, *backend, solve(scene, *backend, options), data.t);
  data.values.resize(19, 1);
  for (Index k = 0; k < 19; ++k) data.values(k, 0) = value_of(scene, at, k, data.columns.front());
  ASSERT_TRUE(data.values.allFinite());
  ASSERT_GT(data.values.maxCoeff(), 0.1);
  const auto of_C = [](const Vector& p) { return circuit(Vector{{0.8, p[0]}}); };
  const Fit f = fit(of_C, {{"C", 1.5, 1e-3}}, data, *backend, on_grid());
  EXPECT_TRUE(f.converged) << f.ended;
  EXPECT_NEAR(f.p[0], 1.3, 1e-5);
}

// q'' = -k q - mu sgn q' + 1.2 cos 0.9 t: y jumps, and the Jacobian includes the switches.
Scene friction(const Vector& p) {
  Scene scene = relay_scene(
      Matrix{{0, 1}, {-p[1], 0}}, Matrix{{0}, {p[0]}}, Matrix{{0, 1}},
      [](double t, Eigen::Ref<Vector> v) { v << 0, 1.2 * std::cos(0.9 * t); }, Vector{{1, 0.3}});
  scene.T = 8;
  return scene;
}

TEST(Fit, FollowsSwitches) {
  Options options;
  options.steps = 800;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result exact = solve(friction(Vector{{0.5, 2}}), *backend, options);
  ASSERT_EQ(exact.status, Status::solved);
  FitData data;
  data.columns = {{ColumnKind::x, 0, "x0"}};
  data.values.resize(20, 1);
  for (Index k = 0; k < 20; ++k) {
    data.t.push_back(exact.t[40 * k + 20]);
    data.values(k, 0) = exact.x(40 * k + 20, 0);
  }
  const Fit f = fit(friction, {{"mu", 0.8, 1e-3}, {"k", 2.6, 1e-3}}, data, *backend, options);
  EXPECT_TRUE(f.converged) << f.ended;
  EXPECT_EQ(f.derivatives.find("derivative with located switches"), 0u) << f.derivatives;
  EXPECT_NEAR(f.p[0], 0.5, 1e-4);
  EXPECT_NEAR(f.p[1], 2, 1e-4);
}

TEST(Fit, StaysWithinBounds) {
  const Fit f = fitted(measured(1, 0), {{"R", 1.2, 1, 2}, {"C", 1.5, 1.2, 2}});
  EXPECT_NEAR(f.p[0], 1, 1e-4) << "the bound nearest to 0.8";
  EXPECT_GE(f.p[0], 1);
}

TEST(Fit, SaysWhatTheDataDoNotDetermine) {
  const Fit f = fitted(measured(1, 0.01), {{"R", 0.9}, {"C", 1.3}, {"unused", 2}});
  EXPECT_TRUE(std::isnan(f.deviation[2]));
  EXPECT_NEAR(f.p[0], 0.8, 0.1);
  EXPECT_EQ(f.p[2], 2);
}

TEST(Fit, RefusesMoreParametersThanData) {
  FitData data = measured(1, 0);
  data.values.setConstant(NAN);
  data.values(0, 0) = 1;
  try {
    fitted(data, {{"R", 0.9}, {"C", 1.3}});
    FAIL();
  } catch (const Error& e) {
    EXPECT_EQ(e.argument(), "--data");
  }
}

class File {
 public:
  explicit File(const std::string& text)
      : name_(std::filesystem::temp_directory_path() / ("bromwich_fit_" + std::to_string(::getpid()) + ".csv")) {
    std::ofstream(name_) << text;
  }
  ~File() { std::filesystem::remove(name_); }
  std::string name() const { return name_; }

 private:
  std::filesystem::path name_;
};

TEST(FitDataFile, HasColumnsByNameAndMissingValues) {
  const File file("# bench 3\nt, x0 ,y0\n0.5,1.25,\n1,nan,2e-1\r\n");
  const FitData data = read_fit_data("--data", file.name(), circuit(Vector{{1, 1}}));
  ASSERT_EQ(data.t.size(), 2u);
  EXPECT_EQ(data.columns[0].kind, ColumnKind::x);
  EXPECT_EQ(data.values(0, 0), 1.25);
  EXPECT_TRUE(std::isnan(data.values(0, 1)));
  EXPECT_TRUE(std::isnan(data.values(1, 0)));
  EXPECT_EQ(data.values(1, 1), 0.2);
}

TEST(FitDataFile, NamesTheLineAtFault) {
  for (const auto& [text, line] : {std::pair("x0,y0\n", "line 1"),
                                   {"t,v\n", ""},
                                   {"t,x\n", "line 1"},
                                   {"t,x0\n1,2,3\n", "line 2"},
                                   {"t,x0\n1,two\n", "line 2"},
                                   {"t,x0\n\n9,1\n", "line 3"}}) {
    const File file(text);
    try {
      read_fit_data("--data", file.name(), circuit(Vector{{1, 1}}));
      FAIL() << text;
    } catch (const Error& e) {
      EXPECT_NE(std::string(e.what()).find(line), std::string::npos) << e.what();
    }
  }
}

}  // namespace
}  // namespace bromwich::app::fit_test
