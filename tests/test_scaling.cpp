// Units do not matter: a scene in other units ends with the same status and the same solution.

#include "core/scaling.hpp"

#include "core/error.hpp"
#include "core/natural_sizes.hpp"
#include "files/scene_file.hpp"
#include "tests/changed_units.hpp"
#include "tests/oracle.hpp"
#include "tests/random_scenes.hpp"
#include "tests/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string>

namespace bromwich {
namespace {

using oracle::any_units;
using oracle::in_other_units;
using oracle::UnitChange;

/// Largest difference of a column, relative to its largest value. Columns below `noise` of the largest in natural units
/// are rounding. Infinite where the same rows are not valid.
double apart(const RowMatrix& a, const RowMatrix& b, const std::vector<int>& units, const std::vector<int>& natural) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  constexpr double noise = 1e-12;
  const auto size = [&](Index i) {
    double largest = 0;
    for (Index j = 0; j < a.rows(); ++j)
      if (!std::isnan(a(j, i))) largest = std::max(largest, std::abs(a(j, i)));
    return largest;
  };
  const auto unit = [&](Index i) { return natural.empty() ? 1 : oracle::power_of_ten(natural[std::size_t(i)]); };
  double kind = 0, worst = 0;
  for (Index i = 0; i < a.cols(); ++i) kind = std::max(kind, size(i) / unit(i));
  for (Index i = 0; i < a.cols(); ++i) {
    const double here = size(i), back = oracle::power_of_ten(units[std::size_t(i)]);
    for (Index j = 0; j < a.rows(); ++j) {
      if (std::isnan(a(j, i)) != std::isnan(b(j, i))) return INFINITY;
      if (std::isnan(a(j, i)) || here <= noise * kind * unit(i)) continue;
      worst = std::max(worst, std::abs(a(j, i) - back * b(j, i)) / here);
    }
  }
  return worst;
}

struct Ended {
  std::string status;
  Result result;
};

Ended end_of(const Scene& scene, Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  try {
    Ended ended;
    ended.result = run(scene, options);
    ended.status = to_string(ended.result.status);
    return ended;
  } catch (const Error&) {
    return {"refused", {}};
  }
}

/// Status, steps, y and x. `rounding`: what one rounding of the data makes of the solution, where that is more than
/// 1e-10.
void expect_same(const Scene& scene, const UnitChange& units, Method method, Index steps, double rounding = 1e-10) {
  const Ended a = end_of(scene, method, steps), b = end_of(in_other_units(scene, units), method, steps);
  ASSERT_EQ(a.status, b.status) << a.result.reason << " | " << b.result.reason;
  EXPECT_EQ(a.result.steps, b.result.steps);
  if (a.status != "solved") return;
  const NaturalUnits natural = natural_units(scene);
  EXPECT_LE(apart(a.result.y, b.result.y, units.y, natural.y), rounding);
  EXPECT_LE(apart(a.result.x, b.result.x, units.x, natural.x), rounding);
}

TEST(Scaling, RandomScenes) {
  Index compared = 0;
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    const oracle::RandomScene random = oracle::any_scene(seed);
    for (const Method method : {Method::automatic, Method::march, Method::contour, Method::euler}) {
      SCOPED_TRACE(std::to_string(seed) + ", " + to_string(method));
      expect_same(random.scene, any_units(random.scene, 1000 + seed, 6, 6), method, random.steps);
      ++compared;
    }
  }
  EXPECT_EQ(compared, 800);
}

TEST(Scaling, SizesFollowTheUnits) {
  for (std::uint32_t seed = 0; seed < 400; ++seed) {
    const Scene scene = oracle::any_scene(seed).scene;
    const UnitChange units = any_units(scene, seed, 9, 9);
    const NaturalSizes a = natural_sizes(scene), b = natural_sizes(in_other_units(scene, units));
    const auto differ = [](const Vector& u, const Vector& v, const std::vector<int>& k) {
      return ((v.cwiseProduct(oracle::factors(k)).cwiseQuotient(u)).array() - 1).abs().maxCoeff();
    };
    EXPECT_LE(differ(a.x, b.x, units.x), 1e-6) << seed;
    EXPECT_LE(differ(a.y, b.y, units.y), 1e-6) << seed;
    EXPECT_LE(differ(a.w, b.w, units.w), 1e-6) << seed;
  }
}

/// What one rounding of the data is magnified to, where the solution is worse than 1e-10: M = 1e-10 I, stiff sources
/// that cancel to 1e-8, an x0 that satisfies its constraints exactly.
double rounding_of(const std::string& name) {
  if (name == "nearly-singular") return 1e-4;
  if (name == "stiff-singular") return 1e-5;
  if (name == "precipitation" || name == "stiff") return 1e-6;
  return 1e-10;
}

TEST(Scaling, Examples) {
  Index compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(BROMWICH_EXAMPLES)) {
    if (entry.path().extension() != ".toml") continue;
    const std::string name = entry.path().stem();
    SCOPED_TRACE(name);
    Scene scene = read_scene_file(entry.path()).scene;
    if (scene.constraints() == 0) continue;
    // What a file says of M holds in its own units; here the solver has to see it in others.
    if (scene.lcp_class == LcpClass::PSD) scene.lcp_class = LcpClass::automatic;
    expect_same(scene, any_units(scene, 7, 6, 6), Method::automatic, std::min<Index>(scene.default_steps, 400),
                rounding_of(name));
    ++compared;
  }
  EXPECT_GE(compared, 25);
}

/// The residual of a result, written out from its definition.
double residual_of(const Scene& scene, const Result& result) {
  double worst = 0;
  Vector g = Vector::Zero(scene.constraints());
  for (Index j = 0; j < result.y.rows(); ++j) {
    if (scene.g) scene.g(result.t[j], g);
    const Vector y = result.y.row(j).transpose(), q = result.trace.row(j).transpose() + g;
    const Vector w = to_dense(scene.M) * y + q;
    worst = std::max(worst, y.cwiseMin(w).cwiseAbs().maxCoeff() / std::max(1.0, q.cwiseAbs().maxCoeff()));
  }
  return worst;
}

TEST(Scaling, TheResidualIsThatOfTheSceneAsStated) {
  Index compared = 0;
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const oracle::RandomScene random = oracle::any_scene(seed);
    const Scene scene = in_other_units(random.scene, any_units(random.scene, seed, 4, 3));
    Options options = options_for(Method::march, random.steps);
    options.trace = true;
    const Result result = run(scene, options);
    if (result.status != Status::solved || !result.y.allFinite() || natural_units(scene).trivial()) continue;
    if (result.kernel.find("the state jumps at t = 0") != std::string::npos) continue;
    EXPECT_NEAR(result.residual, residual_of(scene, result), 1e-15 + 1e-12 * result.residual) << seed;
    ++compared;
  }
  EXPECT_GE(compared, 20);
}

TEST(Scaling, NothingHappensNearOne) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Constant(1, 1, -1), Matrix::Constant(1, 1, 1), Matrix::Constant(1, 1, 1)};
  scene.M = Matrix(Matrix::Identity(1, 1));
  scene.x0 = Vector::Ones(1);
  EXPECT_TRUE(natural_units(scene).trivial());
}

// Components 1e9 apart were called singular.
TEST(Scaling, StatesFarApartAreNotSingular) {
  Scene scene;
  Matrix A(2, 2), B(2, 1), N(1, 2);
  A << -1, 1e12, 1e-12, -2;
  B << 1, 0;
  N << 1, 0;
  scene.dynamics = DenseDynamics{A, B, N};
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.x0 = Vector::Zero(2);
  scene.x0 << -1, 1e-12;
  for (const Method method : {Method::automatic, Method::euler})
    EXPECT_EQ(end_of(scene, method, 50).status, "solved") << to_string(method);
}

// All quantities at 1e-13: what counts as converged is meant in natural units.
TEST(Scaling, TinyQuantities) {
  const oracle::RandomScene random = oracle::any_scene(4);  // M-matrix
  Scene tiny = random.scene;
  UnitChange units = any_units(tiny, 1, 0, 0);
  for (auto* kind : {&units.x, &units.y, &units.w})
    for (int& k : *kind) k = 13;
  for (const Method method : {Method::contour, Method::march, Method::multigrid}) expect_same(tiny, units, method, 32);
}

}  // namespace
}  // namespace bromwich
