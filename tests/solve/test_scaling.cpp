// Units do not matter: a scene in other units ends with the same status and solution.

#include "core/solve/scaling.hpp"

#include "core/base/error.hpp"
#include "core/scene/natural_sizes.hpp"
#include "files/scene_file.hpp"
#include "tests/support/changed_units.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/random_scenes.hpp"
#include "tests/support/run.hpp"

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
/// are rounding errors. Infinite if different rows are valid.
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

/// The scene with other rounding: every entry changes by a few eps.
Scene rounded(Scene scene) {
  Index k = 0;
  const auto change = [&k](double& value) { value *= 1 + 4 * epsilon * std::cos(1.0 + 2.4 * double(k++)); };
  const auto all = [&](auto& matrix) {
    for (Index j = 0; j < matrix.cols(); ++j)
      for (Index i = 0; i < matrix.rows(); ++i) change(matrix(i, j));
  };
  if (auto* d = get_if<DenseDynamics>(&scene.dynamics)) all(d->A), all(d->B), all(d->N);
  if (auto* d = get_if<SparseDynamics>(&scene.dynamics))
    for (SparseMatrix* matrix : {&d->A, &d->B, &d->N})
      for (Index i = 0; i < matrix->nonZeros(); ++i) change(matrix->valuePtr()[i]);
  for (TimeFunction* function : {&scene.f, &scene.g})
    if (*function)
      *function = [given = *function](double t, Eigen::Ref<Vector> value) {
        given(t, value);
        for (Index i = 0; i < value.size(); ++i) value[i] *= 1 + 4 * epsilon * std::cos(1.0 + 2.4 * double(i));
      };
  for (double& value : scene.x0) change(value);
  return scene;
}

enum class Compared { same, rounding_decides };

/// Expects the same status, steps, y and x: to 1e-10, or to the effect of a few roundings of the data. If these alone
/// change the status, nothing is compared.
Compared expect_same(const Scene& scene, const UnitChange& units, Method method, Index steps) {
  const Ended a = end_of(scene, method, steps), b = end_of(in_other_units(scene, units), method, steps);
  const Ended c = end_of(rounded(scene), method, steps);
  const NaturalUnits natural = natural_units(scene);
  const std::vector<int> none_x(units.x.size(), 0), none_y(units.y.size(), 0);
  const double y = apart(a.result.y, c.result.y, none_y, natural.y);
  const double x = apart(a.result.x, c.result.x, none_x, natural.x);
  constexpr double ill_posed = 1e-6, larger = 100;
  if (a.status != c.status || (a.status == "solved" && !(std::max(x, y) <= ill_posed)))
    return Compared::rounding_decides;
  EXPECT_EQ(a.status, b.status) << a.result.reason << " | " << b.result.reason;
  EXPECT_EQ(a.result.steps, b.result.steps);
  if (a.status != "solved" || a.status != b.status) return Compared::same;
  // Behind an impulse at t = 0 the first row is that of a short part, whose length depends on the units.
  const Index rows = a.result.y.rows() - (a.result.starts_with_impulse ? 1 : 0);
  EXPECT_LE(apart(a.result.y.bottomRows(rows), b.result.y.bottomRows(rows), units.y, natural.y),
            std::max(1e-10, larger * y));
  EXPECT_LE(apart(a.result.x, b.result.x, units.x, natural.x), std::max(1e-10, larger * x));
  return Compared::same;
}

TEST(Scaling, RandomScenes) {
  Index compared = 0;
  for (std::uint32_t seed = 0; seed < 80; ++seed) {
    const oracle::RandomScene random = oracle::any_scene(seed);
    for (const Method method : {Method::automatic, Method::march, Method::contour, Method::euler}) {
      SCOPED_TRACE(std::to_string(seed) + ", " + to_string(method));
      const UnitChange units = any_units(random.scene, 1000 + seed, 6, 6);
      compared += expect_same(random.scene, units, method, random.steps) == Compared::same;
    }
  }
  EXPECT_GE(compared, 312);
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

// A bar of finite elements with its consistent mass matrix, divided out: all entries of A are there, and decay from
// node to node. The sizes of its states are those of a bar whose mass is lumped: its nodes are alike.
TEST(Scaling, StatesOfAnInvertedMassMatrixAreAlike) {
  for (const Index m : {30, 100})
    for (const Index n : {1, 12}) {
      Matrix K = Matrix::Zero(m, m), E = K;
      for (Index i = 0; i < m; ++i) {
        const double of_node = i + 1 < m ? 2 : 1;
        K(i, i) = of_node * double(m), E(i, i) = of_node / (3 * double(m));
        if (i > 0) K(i, i - 1) = K(i - 1, i) = -double(m), E(i, i - 1) = E(i - 1, i) = 1 / (6 * double(m));
      }
      Matrix N = Matrix::Zero(n, m);
      for (Index i = 0; i < n; ++i) N(i, m - n + i) = 1;
      Scene scene;
      scene.dynamics = DenseDynamics{-K, N.transpose(), N, E};
      scene.M = Matrix(Matrix::Zero(n, n));
      scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(0.02 - 0.05 * std::sin(3 * t)); };
      scene.x0 = Vector::Zero(m);
      Scene divided = scene;
      divided.dynamics = DenseDynamics{-E.inverse() * K, E.inverse() * N.transpose(), N};
      const Vector x = natural_sizes(divided).x;
      EXPECT_LE(x.maxCoeff(), 10 * x.minCoeff()) << m << ", " << n;
      const Result found = run(scene, options_for(Method::march, 100));
      EXPECT_EQ(found.status, Status::solved) << m << ", " << n << ": " << found.reason;
      EXPECT_GT(found.y.maxCoeff(), 0.01);
    }
}

TEST(Scaling, Examples) {
  if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  Index compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(BROMWICH_EXAMPLES)) {
    if (entry.path().extension() != ".toml") continue;
    const std::string name = entry.path().stem();
    SCOPED_TRACE(name);
    Scene scene = read_scene_file(entry.path()).scene;
    if (scene.constraints() == 0) continue;
    // A class of M stated in a file holds in its own units; here the solver must detect it in others.
    if (scene.lcp_class == LcpClass::PSD) scene.lcp_class = LcpClass::automatic;
    const Index steps = std::min<Index>(scene.steps(), 400);
    compared += expect_same(scene, any_units(scene, 7, 6, 6), Method::automatic, steps) == Compared::same;
  }
  EXPECT_GE(compared, 22);
}

/// The residual of a result, by definition.
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

// States whose sizes differ by 1e9 must not count as singular.
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

// All quantities at 1e-13: convergence is measured in natural units.
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
