// The dense Galerkin oracle against exact solutions, and the engine against the oracle: initial values, conditions at
// separate ends, coupled ends and periodic ones, inequalities and equations.

#include "core/scenes/catalogue.hpp"
#include "tests/oracle.hpp"
#include "tests/oracle_galerkin.hpp"
#include "tests/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

/// L2 norm over [0, T] of y_h - y and x_h(T) - x(T), y_h linear on each of the intervals (rows: left and right values).
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
  for (const char* name : {"nash-game", "lq-control"}) {
    const Scene scene = make_scene(name);
    const GalerkinError coarse = oracle_error(scene, 10), fine = oracle_error(scene, 20);
    EXPECT_LE(fine.y, 0.02) << name;
    EXPECT_GE(std::log2(coarse.y / fine.y), 1) << name;
    EXPECT_GE(std::log2(coarse.x_at_T / fine.x_at_T), 1) << name;
  }
}

TEST(GalerkinOracle, SmallestEigenvalueOfTheBridge) {
  // Known from another program, three digits; from below as the grid is refined.
  const Scene bridge = make_scene("bridge");
  const double eigenvalue = oracle::smallest_galerkin_eigenvalue(oracle::galerkin_system(bridge, 48), 48);
  EXPECT_NEAR(eigenvalue, -1.45, 0.02);
}

}  // namespace
}  // namespace bromwich
