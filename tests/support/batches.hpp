#pragma once
// Batches of small random scenes, and their comparison with single solves of the same scenes.

#include "batch/batch.hpp"
#include "core/result/slack.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <string>

namespace bromwich::batch_test {

// Both take the same steps in another order of operations: J roundings of a stable recurrence, times the condition of
// M_SS, stay below.
inline constexpr double same = 1e-12;

/// x0 with normal changes of size `part`.
inline RowMatrix around(const Vector& x0, Index scenes, double part, unsigned seed = 1) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  RowMatrix x(scenes, x0.size());
  for (Index k = 0; k < scenes; ++k)
    for (Index i = 0; i < x0.size(); ++i) x(k, i) = x0[i] + part * normal(generator);
  return x;
}

/// A stable and coupled, M diagonally dominant: class P.
inline Scene random_scene(Index m, Index n, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](Index rows, Index cols) {
    return Matrix(Matrix::NullaryExpr(rows, cols, [&] { return normal(generator); }));
  };
  Scene scene;
  DenseDynamics d{draw(m, m) / std::sqrt(double(m)), draw(m, n), draw(n, m)};
  d.A.diagonal().array() -= 2;
  d.B *= 0.3, d.N *= 0.3;
  scene.dynamics = std::move(d);
  Matrix M = draw(n, n) / double(n);
  M.diagonal().array() += 2 + M.cwiseAbs().rowwise().sum().maxCoeff();
  scene.M = M;
  scene.x0 = draw(m, 1);
  scene.T = 2;
  const Vector a = draw(n, 1), b = draw(m, 1);
  scene.g = [a](double t, Eigen::Ref<Vector> g) { g = a * std::sin(4 * t + 0.3); };
  scene.f = [b](double t, Eigen::Ref<Vector> f) { f = b * std::cos(3 * t); };
  return scene;
}

/// Four ideal diodes between a resonator and a resistor: M is positive semidefinite, and steps are those of Radau IIA.
inline Scene diode_bridge() {
  const double C = 1e-6, L = 1e-2, R = 1e3;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, -1 / C}, {1 / L, 0}}, Matrix{{0, 0, -1 / C, 1 / C}, {0, 0, 0, 0}},
                                 Matrix{{0, 0}, {0, 0}, {-1, 0}, {1, 0}}};
  scene.M = Matrix{{1 / R, 1 / R, -1, 0}, {1 / R, 1 / R, 0, -1}, {1, 0, 0, 0}, {0, 1, 0, 0}};
  scene.lcp_class = LcpClass::PSD;
  scene.x0 = Vector{{10, 0}};
  scene.T = 2e-3;
  return scene;
}

/// Relative to the largest entry of b; infinite if the shapes or the places of NaN differ.
inline double apart(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  double worst = 0;
  const double size = std::max(1e-300, b.array().isFinite().select(b.array().abs(), 0).maxCoeff());
  for (Index j = 0; j < a.rows(); ++j)
    for (Index i = 0; i < a.cols(); ++i)
      if (std::isnan(a(j, i)) != std::isnan(b(j, i)))
        return INFINITY;
      else if (!std::isnan(a(j, i)))
        worst = std::max(worst, std::abs(a(j, i) - b(j, i)) / size);
  return worst;
}

/// The result of the batch, compared with each scene alone.
inline BatchResult expect_as_single(const Batch& batch, const Options& options, const std::string& what) {
  const auto backend = make_cpu_backend(2);
  const BatchResult found = solve_batch(batch, *backend, options);
  for (Index k = 0; k < batch.scenes; ++k) {
    const Scene scene = scene_of(batch, k);
    const Result one = solve(scene, *backend, options);
    const std::string where = what + ", scene " + std::to_string(k);
    const Status status = found.status[std::size_t(k)];
    const std::string &reason = found.reason[std::size_t(k)], &warning = found.warning[std::size_t(k)];
    // Scenes side by side are not compared with other steps (docs/batches.md).
    const auto is_estimate = [](const std::string& words) {
      return words.starts_with("with these steps the result is off") || words.starts_with("y jumps inside steps");
    };
    const bool unestimated = (is_estimate(one.warning) || is_estimate(one.reason)) && status == Status::solved &&
                             reason.empty() && warning.empty();
    EXPECT_TRUE(unestimated || (status == one.status && reason == one.reason && warning == one.warning))
        << where << ": " << to_string(status) << " '" << reason << "', '" << warning << "'; alone "
        << to_string(one.status) << " '" << one.reason << "', '" << one.warning << "'";
    EXPECT_EQ(found.method[std::size_t(k)], one.method) << where;
    EXPECT_LE(apart(found.of(found.y, k), one.y), same) << where;
    EXPECT_LE(apart(found.of(found.x, k), one.x), same) << where;
    EXPECT_LE(apart(found.of(found.w, k), slack(scene, one)), same) << where;
    if (std::isnan(one.residual)) {
      EXPECT_TRUE(std::isnan(found.residual[k])) << where;
    } else
      EXPECT_NEAR(found.residual[k], one.residual, same) << where;
  }
  return found;
}

}  // namespace bromwich::batch_test
