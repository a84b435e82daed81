// Batches of nonlinear complementarity problems, and the functional iteration that solves one a time point.

#include "nonlinear/ncp_batch.hpp"

#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "nonlinear/solve_nonlinear.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

using In = const Eigen::Ref<const Vector>&;
using reference::Random;

// Increasing terms of one variable and their derivatives: smooth, steep at 0, with a pole of the slope at 0.
double term(Index kind, double y) {
  return kind == 0 ? y * y * y : kind == 1 ? 0.026 * std::log1p(y / 1e-6) : std::expm1(std::min(y, 50.0));
}
double slope(Index kind, double y) {
  return kind == 0 ? 3 * y * y : kind == 1 ? 0.026 / (1e-6 + y) : std::exp(std::min(y, 50.0));
}

// F_k(y) = M y + q_k + term(y): M strictly dominant with entries of both signs.
struct Drawn {
  Matrix M;
  RowMatrix q;
  NcpBatch batch;
};
Drawn drawn(std::uint32_t seed, Index n, Index problems) {
  Random random(seed);
  Drawn d{random.matrix(n, n), RowMatrix(problems, n), {}};
  d.M.diagonal() = d.M.cwiseAbs().rowwise().sum() + Vector::Constant(n, 0.5);
  for (Index k = 0; k < problems; ++k) d.q.row(k) = 3 * random.vector(n).transpose();
  d.batch.problems = problems;
  return d;
}
void set_functions(Drawn& d, bool affine = false) {
  d.batch.F = [&d, affine](Index k, In y, Eigen::Ref<Vector> v) {
    v = d.M * y + d.q.row(k).transpose();
    for (Index i = 0; i < y.size() && !affine; ++i) v[i] += term((k + i) % 3, y[i]);
  };
  d.batch.F_and_jacobian = [&d, affine](Index k, In y, Eigen::Ref<Vector> v, Matrix& J) {
    d.batch.F(k, y, v);
    J = d.M;
    for (Index i = 0; i < y.size() && !affine; ++i) J(i, i) += slope((k + i) % 3, y[i]);
  };
}

// Gauss-Seidel with bisection: y_i is the root of an increasing function of itself, or 0. M is dominant by rows, so the
// sweeps contract.
Vector by_bisection(const Drawn& d, Index k) {
  const Index n = d.M.rows();
  Vector y = Vector::Zero(n);
  for (int sweep = 0; sweep < 400; ++sweep)
    for (Index i = 0; i < n; ++i) {
      const double rest = d.q(k, i) + d.M.row(i).dot(y) - d.M(i, i) * y[i];
      const auto at = [&](double z) { return rest + d.M(i, i) * z + term((k + i) % 3, z); };
      double low = 0, high = std::abs(rest) / d.M(i, i) + 1;
      if (at(0) >= 0) high = 0;
      for (int halving = 0; halving < 80 && high > 0; ++halving) {
        const double middle = 0.5 * (low + high);
        (at(middle) < 0 ? low : high) = middle;
      }
      y[i] = high;
    }
  return y;
}

TEST(NcpBatch, AgreesWithBisection) {
  for (const Index n : {1, 2, 3, 5})
    for (const int threads : {1, 2}) {
      Drawn d = drawn(std::uint32_t(70 + n), n, 67);
      set_functions(d);
      RowMatrix y = RowMatrix::Zero(67, n);
      const NcpReport report = solve_ncps(d.batch, *make_cpu_backend(threads), y);
      EXPECT_EQ(report.solved, 67);
      EXPECT_EQ(report.first_unsolved, -1);
      EXPECT_LE(report.newton, 67 * 25) << "Newton's iteration, not a slow one";
      for (Index k = 0; k < 67; ++k) {
        // Bisection ends at 2^-80 of at most 7; slopes at y = 0 up to 3e4 magnify nothing in y.
        EXPECT_LE((y.row(k).transpose() - by_bisection(d, k)).cwiseAbs().maxCoeff(), 1e-11) << n << " " << k;
        Vector w(n);
        d.batch.F(k, y.row(k).transpose(), w);
        EXPECT_GE(y.row(k).minCoeff(), 0);
        EXPECT_LE(y.row(k).transpose().cwiseMin(w).cwiseAbs().maxCoeff(), 1e-9);  // rounding times a slope of 3e4
      }
    }
}

TEST(NcpBatch, AffineProblemsTakeOneIterationAndItsConfirmation) {
  Drawn d = drawn(80, 3, 40);
  set_functions(d, true);
  RowMatrix y = RowMatrix::Zero(40, 3);
  EXPECT_LE(solve_ncps(d.batch, HostThreads(), y).newton, 2 * 40);
}

TEST(NcpBatch, SaysWhatIsNotSolved) {
  NcpBatch batch;
  batch.problems = 3;
  batch.F = [](Index k, In, Eigen::Ref<Vector> v) { v[0] = k == 1 ? -1 : 1; };  // F = -1 has no solution
  batch.F_and_jacobian = [&](Index k, In y, Eigen::Ref<Vector> v, Matrix& J) {
    batch.F(k, y, v);
    J(0, 0) = 0;
  };
  RowMatrix y = RowMatrix::Zero(3, 1);
  const NcpReport report = solve_ncps(batch, HostThreads(), y);
  EXPECT_EQ(report.solved, 2);
  EXPECT_EQ(report.first_unsolved, 1);
  batch.F = [](Index, In, Eigen::Ref<Vector> v) { v[0] = std::nan(""); };
  EXPECT_EQ(solve_ncps(batch, HostThreads(), y).solved, 0);
  batch.problems = 0;
  y.resize(0, 1);
  EXPECT_EQ(solve_ncps(batch, HostThreads(), y).first_unsolved, -1);
}

// A capacitor charged through a diode by Shockley's law, whose slope at y = 0 is 26000: frozen, gamma does not
// contract.
NonlinearScene shockley() {
  NonlinearScene s;
  s.linear.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{2}}, Matrix{{1}}};
  s.linear.M = Matrix{{0.5}};
  s.linear.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -5 * std::sin(2 * t); };
  s.linear.x0 = Vector{{0}};
  s.linear.T = 4;
  s.gamma = [](double, In, In y, Eigen::Ref<Vector> v) { v[0] = 0.026 * std::log1p(std::max(y[0], 0.0) / 1e-6); };
  return s;
}

TEST(PointwiseWindows, FindTheDiscreteSolution) {
  const auto backend = make_cpu_backend(2);
  NonlinearOptions options;
  options.steps = 200;
  options.method = NonlinearMethod::march;
  const NonlinearResult march = solve_nonlinear(shockley(), *backend, options);
  for (const bool concurrent : {false, true}) {
    options.method = NonlinearMethod::pointwise;
    options.concurrent = concurrent;
    const NonlinearResult r = solve_nonlinear(shockley(), *backend, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    // Both end with changes of 1e-12, which Newton's iteration and a contraction below 0.7 magnify little.
    EXPECT_LE((r.x - march.x).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LE((r.y - march.y).cwiseAbs().maxCoeff(), 1e-10);
    EXPECT_LE(r.residual, 1e-10);
    EXPECT_LE(r.defect, 1e-11);
    EXPECT_LE(r.windows, 40) << "few windows: the slope of gamma does not limit them";
  }
  options.method = NonlinearMethod::iteration;
  EXPECT_GE(solve_nonlinear(shockley(), *backend, options).windows, 60) << "where gamma is frozen it does";
}

}  // namespace
}  // namespace bromwich
