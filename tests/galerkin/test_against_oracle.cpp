// The dense Galerkin oracle against exact solutions, and the engine against the oracle: initial values, separated,
// coupled and periodic boundary conditions, inequalities and equations.

#include "catalogue/catalogue.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/oracle_galerkin.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

/// L2 norm over [0, T] of y_h - y, and x_h(T) - x(T); y_h is linear on each interval (rows: left and right values).
struct GalerkinError {
  double y = 0, x_at_T = 0;
};

GalerkinError galerkin_error(const Scene& scene, const RowMatrix& y, const RowMatrix& x) {
  const Index J = y.rows(), n = scene.constraints();
  Vector state(scene.states()), control(n);
  double sum = 0;
  constexpr int pieces = 200;  // midpoints: the error of the rule is 1e-5 of the integral
  for (Index k = 0; k < J; ++k)
    for (int a = 0; a < pieces; ++a) {
      const double s = (a + 0.5) / pieces;
      scene.exact(scene.T * (double(k) + s) / double(J), state, control);
      sum += ((1 - s) * y.row(k).head(n).transpose() + s * y.row(k).tail(n).transpose() - control).squaredNorm();
    }
  scene.exact(scene.T, state, control);
  return {std::sqrt(sum * scene.T / double(J * pieces)), (x.row(J).transpose() - state).norm()};
}

GalerkinError oracle_error(const Scene& scene, Index J) {
  const auto y = oracle::galerkin_solution(oracle::galerkin_system(scene, J), J);
  if (!y) return {NAN, NAN};
  return galerkin_error(scene, *y, oracle::galerkin_states(scene, *y));
}

TEST(GalerkinOracle, BridgeWithKinksOnNodes) {
  const Scene bridge = make_scene("bridge");
  const GalerkinError coarse = oracle_error(bridge, 24), fine = oracle_error(bridge, 48);
  EXPECT_NEAR(coarse.y, 1.8e-2, 5e-4);
  EXPECT_NEAR(fine.y, 4.6e-3, 1e-4);
  EXPECT_GE(std::log2(coarse.x_at_T / fine.x_at_T), 1.9);
}

TEST(GalerkinOracle, ScenesWithTwoEnds) {
  // The controls of the game are linear between 0.3 and 0.5: with both on nodes they belong to the space.
  EXPECT_LE(oracle_error(make_scene("nash-game"), 10).y, 1e-10);
  struct Grids {
    const char* name;
    Index few, many;
  };
  // Kinks off the nodes, at the same places in their intervals on both grids: a kink costs h^1.5 in L2.
  for (const auto& [name, few, many] : {Grids{"nash-game", 17, 57}, Grids{"lq-control", 4, 75}}) {
    const Scene scene = make_scene(name);
    const GalerkinError coarse = oracle_error(scene, few), fine = oracle_error(scene, many);
    EXPECT_GE(std::log(coarse.y / fine.y) / std::log(double(many) / double(few)), 1.4) << name << ' ' << fine.y;
    EXPECT_LE(fine.y, 0.02) << name;
    EXPECT_LE(fine.x_at_T, 1e-2) << name;
  }
}

TEST(GalerkinOracle, SmallestEigenvalueOfTheBridge) {
  // Known from another program to three digits; the estimates approach it from below.
  const Scene bridge = make_scene("bridge");
  const double eigenvalue = oracle::smallest_galerkin_eigenvalue(oracle::galerkin_system(bridge, 48), 48);
  EXPECT_NEAR(eigenvalue, -1.45, 0.02);
}

enum class Ends { initial, separated, coupled, periodic };

/// A random scene with a strongly monotone operator, hence a unique solution; sources quadratic in t, which the
/// engine's quadrature integrates exactly.
Scene two_point_scene(std::uint32_t seed, Index m, Index n, Ends ends, const std::vector<Index>& free) {
  Scene scene = oracle::random_scene(seed, m, n, oracle::SpectrumKind::sector, oracle::MatrixKind::positive_definite);
  auto& d = get<DenseDynamics>(scene.dynamics);
  d.N *= 0.3 / std::max(1., d.N.norm() * d.B.norm());
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::cos(double(i)) + t * (1 - t * double(i));
  };
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::sin(2. + 3 * double(i)) - 4 * t * (t - 0.3 * double(i + 1));
  };
  scene.free_rows = free;
  if (ends == Ends::initial) return scene;
  BoundaryCondition c{Matrix::Identity(m, m), Matrix::Zero(m, m), scene.x0};
  if (ends == Ends::separated) {
    c.E0(m - 1, m - 1) = 0;
    c.ET(m - 1, m - 1) = 1;
  } else if (ends == Ends::coupled) {
    for (Index i = 0; i < m; ++i)
      for (Index j = 0; j < m; ++j) c.ET(i, j) = 0.4 * std::sin(double(1 + i * m + 2 * j));
  } else {
    c.ET = -Matrix::Identity(m, m);
    c.b.setZero();
  }
  scene.boundary = c;
  scene.x0 = {};
  return scene;
}

/// Compares the engine's y on all intervals (left and right values) and x at the nodes with the oracle's.
void expect_agreement(const Scene& scene, Index J) {
  const oracle::GalerkinSystem system = oracle::galerkin_system(scene, J);
  const auto expected = oracle::galerkin_solution(system, J);
  ASSERT_TRUE(expected);
  Options options = options_for(Method::galerkin, J);
  options.states = StateSelection::all;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  RowMatrix y(J, 2 * scene.constraints());
  y << result.y_left, result.y.bottomRows(J);
  const double size = std::max(1., expected->cwiseAbs().maxCoeff());
  EXPECT_LE(distance(y, *expected), 1e-10 * size);
  EXPECT_LE(distance(result.x, oracle::galerkin_states(scene, *expected)), 1e-10 * size);
  EXPECT_LE(oracle::galerkin_residual(system, y), 1e-10 * size);
  EXPECT_EQ(result.y.row(0), result.y_left.row(0));
}

TEST(GalerkinOracle, EngineAgreesForAllBoundaryConditions) {
  std::uint32_t seed = 1;
  for (const Ends ends : {Ends::initial, Ends::separated, Ends::coupled, Ends::periodic})
    for (const std::vector<Index>& free : {std::vector<Index>{}, std::vector<Index>{1}}) {
      SCOPED_TRACE("conditions " + std::to_string(int(ends)) + ", free rows " + std::to_string(free.size()));
      expect_agreement(two_point_scene(++seed, 3, 2, ends, free), 16);
      expect_agreement(two_point_scene(++seed, 2, 3, ends, free), 5);
    }
}

TEST(GalerkinOracle, EngineAgreesOnAFineGrid) {
  for (const Ends ends : {Ends::initial, Ends::coupled}) expect_agreement(two_point_scene(40, 3, 2, ends, {}), 64);
}

/// Replaces the source on each interval by its parabola through three Gauss points, as the engine does.
TimeFunction by_parabolas(const TimeFunction& source, Index size, double T, Index J) {
  if (!source) return source;
  return [=, h = T / double(J)](double t, Eigen::Ref<Vector> value) {
    const double k = std::min(std::floor(t / h), double(J - 1)), s = t / h - k, d = std::sqrt(0.15);
    const double points[] = {0.5 - d, 0.5, 0.5 + d};
    value.setZero();
    Vector at(size);
    for (int i = 0; i < 3; ++i) {
      double weight = 1;
      for (int j = 0; j < 3; ++j)
        if (j != i) weight *= (s - points[j]) / (points[i] - points[j]);
      source((k + points[i]) * h, at);
      value += weight * at;
    }
  };
}

TEST(GalerkinOracle, EngineAgreesOnTheScenesOfThePaper) {
  for (const char* name : {"bridge", "lq-control", "nash-game", "periodic-rectifier"}) {
    SCOPED_TRACE(name);
    const Index J = 30;
    Scene scene = make_scene(name);
    scene.f = by_parabolas(scene.f, scene.sources(), scene.T, J);
    scene.g = by_parabolas(scene.g, scene.constraints(), scene.T, J);
    expect_agreement(scene, J);
  }
}

}  // namespace
}  // namespace bromwich
