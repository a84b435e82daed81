// Semidefinite M in the iteration and in multigrid: least norms against enumeration, the criterion on the range of M,
// refusals.

#include "core/kernel/monotone_range.hpp"

#include "core/iteration/forecast.hpp"
#include "core/iteration/windows.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/kernel.hpp"
#include "tests/support/lcp_oracle.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {
namespace {

using reference::Random;

// A scene of a random singular M whose null space does not move the state; `seed` decides all. y is of size 1. N sees
// the null space or not.
Scene seen_by_its_range(std::uint32_t seed, double T = 1, bool by_N = false) {
  Random random(seed);
  const Index n = 2 + Index(seed % 3), m = 3;
  const oracle::Monotone p = oracle::random_monotone(random, n, seed % 2 == 0 ? 0 : 3);
  Scene s;
  s.M = p.M;
  // With factors p.M both vanish where M does; M is symmetric here.
  s.dynamics = DenseDynamics{random.matrix(m, m) - 2 * Matrix::Identity(m, m), random.matrix(m, n) * p.M / double(n),
                             by_N ? random.matrix(n, m) : Matrix(p.M * random.matrix(n, m) / double(n))};
  const Vector level = p.q, swing = p.M * random.vector(n);
  s.g = [level, swing](double t, Eigen::Ref<Vector> g) { g = level + std::sin(5 * t) * swing; };
  s.x0 = random.vector(m);
  s.T = T;
  s.lcp_class = LcpClass::PSD;
  return s;
}

Matrix root(const Matrix& S, double power) {
  const Eigen::SelfAdjointEigenSolver<Matrix> e(S);
  Vector d = e.eigenvalues();
  const double most = d.cwiseAbs().maxCoeff();
  for (double& value : d) value = value > 1e-9 * most ? std::pow(value, power) : 0;
  return e.eigenvectors() * d.asDiagonal() * e.eigenvectors().transpose();
}

// The inequality of the header, with least-norm solutions by enumeration. Integer entries: ranks are clear.
TEST(MonotoneRange, SolutionsAreLipschitzOnIt) {
  Random random(31);
  for (int instance = 0; instance < 400; ++instance) {
    const Index n = 2 + instance % 3;
    const oracle::Monotone p = oracle::random_monotone(random, n, instance % 4);
    const Matrix S = 0.5 * (p.M + p.M.transpose());
    const Vector move = root(S, 0.5) * random.vector(n);
    const auto a = oracle::selected_solution(p.M, p.q, LcpClass::PSD);
    const auto b = oracle::selected_solution(p.M, p.q + move, LcpClass::PSD);
    ASSERT_TRUE(a) << instance;
    ASSERT_TRUE(b) << instance << ": q + S p is feasible where q is";
    EXPECT_LE((root(S, 0.5) * (*a - *b)).norm(), (root(S, -0.5) * move).norm() + 1e-9) << instance;
  }
}

TEST(MonotoneRange, IsFoundOrTheReasonWhyNot) {
  const Matrix M{{1, 1}, {1, 1}};
  const auto range = [&](const Matrix& m, const Matrix& B, const Matrix& N) {
    return range_of_M(m, LcpClass::PSD, B.sparseView(), N.sparseView());
  };
  const RangeOfM found = range(M, Matrix{{1, 1}}, Matrix{{0.5}, {0.5}});
  ASSERT_TRUE(found.range) << found.why;
  EXPECT_EQ(found.range->basis.cols(), 1);
  // S = 2 e e^T with e = (1, 1)/sqrt(2): |S^+/2 W S^+/2| = |e^T W e| / 2.
  EXPECT_NEAR(found.range->contraction(Matrix{{1, 2}, {3, 4}}), 5.0 / 2, 1e-14);
  EXPECT_TRUE(found.range->holds_definite(M));
  EXPECT_FALSE(found.range->holds_definite(Matrix{{1, -1}, {-1, 1}}));
  EXPECT_EQ(range(M, Matrix{{1, 0}}, Matrix{{0.5}, {0.5}}).why, "a y with y^T M y = 0 moves the state");
  // All q have a solution, as M (1, 1) > 0: N need not stay in the range. S^1/2 (1, 0) = S^1/2 (0, 1) has length 1 = L,
  // and |W S^+/2| = |W e| / sqrt(2) = |(3, 7)| / 2.
  const RangeOfM by_N = range(M, Matrix{{1, 1}}, Matrix{{0.5}, {0.4}});
  ASSERT_TRUE(by_N.range) << by_N.why;
  EXPECT_FALSE(by_N.range->holds_outputs);
  EXPECT_NEAR(by_N.range->lipschitz, 1, 1e-14);
  EXPECT_NEAR(by_N.range->contraction(Matrix{{1, 2}, {3, 4}}), std::sqrt(58.0) / 2, 1e-14);
  // M (1, 1) = 0: q has a solution where q_1 + q_2 >= 0.
  const Matrix apart{{1, -1}, {-1, 1}};
  const RangeOfM leaves = range(apart, Matrix{{1, -1}}, Matrix{{0.5}, {-0.4}});
  EXPECT_EQ(leaves.why, "N x leaves the range of M + M^T");
  EXPECT_TRUE(leaves.moves_only_outputs);
  EXPECT_FALSE(range(Matrix{{0, 1}, {-1, 0}}, Matrix{{1, 1}}, Matrix{{1}, {1}}).range) << "a skew M has no range";
  EXPECT_TRUE(range_of_M(M, LcpClass::P, Matrix{{1, 1}}.sparseView(), Matrix{{1}, {1}}.sparseView()).why.empty());
}

// L of the case where N sees the null space: solutions by construction.
TEST(MonotoneRange, SolutionsAreLipschitzOnItForAllFeasibleProblems) {
  Random random(32);
  int held = 0;
  for (int instance = 0; instance < 600; ++instance) {
    const Index n = 2 + instance % 4;
    const oracle::Monotone p = oracle::random_monotone(random, n, instance % 2 == 0 ? 3 : instance % 4);
    const Matrix S = 0.5 * (p.M + p.M.transpose());
    const RangeOfM of =
        range_of_M(p.M, LcpClass::PSD, Matrix(random.matrix(2, n) * S).sparseView(), random.matrix(n, 2).sparseView());
    if (!of.range || of.range->holds_outputs) continue;
    ++held;
    for (int pair = 0; pair < 20; ++pair) {
      const auto solved = [&] {
        const Vector value = random.vector(n);
        return std::pair(Vector(value.cwiseMax(0)), Vector((-value).cwiseMax(0) - p.M * value.cwiseMax(0)));
      };
      const auto [y, q] = solved();
      const auto [z, r] = solved();
      EXPECT_LE((root(S, 0.5) * (y - z)).norm(),
                of.range->lipschitz * (of.range->inverse_scale.asDiagonal() * (q - r)).norm() * (1 + 1e-9) + 1e-9)
          << instance;
    }
  }
  EXPECT_GE(held, 60);
}

// y of every time point is the solution of least norm of LCP(M, N x_j + g_j), and x_j follows from y: the discrete
// problem, by enumeration and Eigen's exponential. Three methods find it.
TEST(MonotoneRange, IterationFindsLeastNorms) {
  int unique = 0, all = 0, by_N = 0;
  for (std::uint32_t seed = 0; seed < 120; ++seed) {
    const Scene scene = seen_by_its_range(seed % 60, seed < 60 ? 1 : 0.5, seed >= 60);
    const oracle::DenseScene dense = oracle::write_out(scene);
    if (seed >= 60) {
      const RangeOfM of = range_of_M(scene.M, LcpClass::PSD, dense.B.sparseView(), dense.N.sparseView());
      if (!of.range || of.range->holds_outputs) continue;
      ++by_N;
    }
    for (const Method method : {Method::contour, Method::contour_literal, Method::multigrid, Method::march}) {
      if (seed >= 60 && method == Method::march) continue;  // Radau IIA there
      const Result r = run(scene, method, 64);
      if (seed >= 60 && r.reason.rfind("M leaves y to the dynamics at this step", 0) == 0) continue;  // W_0 outweighs M
      if (method == Method::contour_literal && r.status == Status::unsupported) continue;  // A is not sectorial enough
      ASSERT_EQ(r.status, Status::solved) << seed << " " << to_string(method) << ": " << r.reason;
      EXPECT_TRUE(r.continuous);
      const RowMatrix x = oracle::states_of(dense, r.y);
      // The literal contours know K to a few digits: their y solves a problem that is that close.
      const double close = method == Method::contour_literal ? 1e-2 : 1e-9;
      for (Index j = 0; j <= 64; ++j) {
        const Vector q = dense.N * x.row(j).transpose() + oracle::value(dense.g, r.t[j], dense.M.rows());
        const auto y = oracle::selected_solution(dense.M, q, LcpClass::PSD);
        ASSERT_TRUE(y) << seed << " " << j;
        // y is discontinuous in q where its set of solutions grows: then M y, which is not, is compared.
        const bool same = (r.y.row(j).transpose() - *y).cwiseAbs().maxCoeff() <= close;
        EXPECT_LE((dense.M * (r.y.row(j).transpose() - *y)).cwiseAbs().maxCoeff(), 10 * close) << seed << " " << j;
        unique += same, ++all;
      }
    }
  }
  EXPECT_GE(unique, 0.95 * all) << all;
  EXPECT_GE(by_N, 15);
}

// Sweeps shrink |S^1/2 (y^{k+1} - y^k)| at least as the criterion says: their number stays below the forecast.
TEST(MonotoneRange, ForecastBoundsTheSweeps) {
  int known = 0;
  for (std::uint32_t seed = 100; seed < 160; ++seed) {
    const Scene scene = seen_by_its_range(seed, 0.5, seed >= 130);
    const auto backend = make_cpu_backend(1);
    const DiscreteProblem p = discretise(scene, *backend, 128);
    const std::optional<Forecast> f = iteration_forecast(p, 1e-12);
    ASSERT_TRUE(f);
    if (!std::isfinite(f->sweeps)) continue;
    ++known;
    EXPECT_FALSE(std::isfinite(f->lipschitz) && f->lipschitz < 1e6) << "only on the range";
    const Result r = run(scene, Method::contour, 128);
    ASSERT_EQ(r.status, Status::solved) << seed << ": " << r.reason;
    // The first sweep has no kernel, the last only confirms, and the changes begin with |S^1/2 y|, at most 100 here.
    EXPECT_LE(double(r.iterations), f->sweeps * (1 + std::log(100.0) / std::log(1e12)) + 2) << seed;
  }
  EXPECT_GE(known, 25);
}

// y_1 + y_2 = s of Remark 3.1's scene: x' = -x + s, 0 <= s ⊥ s + x/2 - cos 3t >= 0, a scene with M = 1.
TEST(MonotoneRange, DoubledConstraintsGiveTheSingleOne) {
  Scene single, twice;
  single.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0.5}}};
  single.M = Matrix{{1}};
  twice.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{0.5}, {0.5}}};
  twice.M = Matrix{{1, 1}, {1, 1}};
  for (Scene* s : {&single, &twice}) {
    s->g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(-std::cos(3 * t)); };
    s->x0 = Vector{{0}};
    s->T = 2;
  }
  for (const Method method : {Method::contour, Method::multigrid, Method::march}) {
    const RowMatrix one = solved_y(single, method, 1024), two = solved_y(twice, method, 1024);
    EXPECT_LE(distance(two.rowwise().sum(), one), same_problem) << to_string(method);
    EXPECT_LE(distance(two.col(0), two.col(1)), same_problem) << "the least norm takes both halves";
  }
  EXPECT_NE(run(twice, Method::multigrid, 1024).kernel.find("grids of 1024"), std::string::npos);
  // Second order, also without a unique y: x errs by C h^2 where C depends on where in a step y switches.
  Options options = options_for(Method::contour, 8192);
  options.states = StateSelection::all;
  const double truth = run(single, options).x(8192, 0);
  const auto error = [&](Index J) {
    options.steps = J;
    return std::abs(run(twice, options).x(J, 0) - truth);
  };
  EXPECT_GT(error(32) / error(512), 256 / 4.0);
}

// y_1 + y_2 = s with 0 <= s = max(0, cos 3t - x/2, cos 3t - 2x/5): x' = -x + s by Runge and Kutta's steps of 1/8192,
// which the kinks of s leave with an error of h^2 at most.
TEST(MonotoneRange, OutputsOutsideTheRange) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{0.5}, {0.4}}};
  s.M = Matrix{{1, 1}, {1, 1}};
  s.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(-std::cos(3 * t)); };
  s.x0 = Vector{{0.2}};
  s.T = 2;
  const auto rate = [](double t, double x) {
    return -x + std::max({0.0, std::cos(3 * t) - 0.5 * x, std::cos(3 * t) - 0.4 * x});
  };
  double x = 0.2;
  const double h = 2.0 / 16384;
  for (int j = 0; j < 16384; ++j) {
    const double t = h * j, a = rate(t, x), b = rate(t + h / 2, x + h / 2 * a), c = rate(t + h / 2, x + h / 2 * b),
                 d = rate(t + h, x + h * c);
    x += h / 6 * (a + 2 * b + 2 * c + d);
  }
  for (const Method method : {Method::contour, Method::multigrid, Method::march}) {
    const auto error = [&](Index J) {
      Options options = options_for(method, J);
      options.states = StateSelection::all;
      const Result r = run(s, options);
      EXPECT_EQ(r.status, Status::solved) << r.reason;
      EXPECT_EQ(r.continuous, method != Method::march) << to_string(method);
      return std::abs(r.x(J, 0) - x);
    };
    // Order 2: a factor of 256, up to where in a step y switches.
    EXPECT_GT(error(32) / error(512), 256 / 4.0) << to_string(method);
  }
}

TEST(MonotoneRange, RefusalsSayWhatIsTrue) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 0}}, Matrix{{0.5}, {0.5}}};
  s.M = Matrix{{1, 1}, {1, 1}};
  s.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(-std::cos(3 * t)); };
  s.x0 = Vector{{0}};
  s.T = 2;
  const Result by_B = run(s, Method::contour, 64);
  EXPECT_EQ(by_B.status, Status::unsupported);
  EXPECT_NE(by_B.reason.find("a y with y^T M y = 0 moves the state): piecewise-linear y would ring"), std::string::npos)
      << by_B.reason;
  s.M = Matrix{{1, -1}, {-1, 1}};
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, -1}}, Matrix{{0.5}, {-0.4}}};
  s.g = [](double t, Eigen::Ref<Vector> g) { g << -std::cos(3 * t), 2; };
  const Result by_N = run(s, Method::contour, 64);
  EXPECT_EQ(by_N.status, Status::unsupported);
  EXPECT_NE(by_N.reason.find("N x leaves the range of M + M^T): sweeps may meet problems without a solution"),
            std::string::npos)
      << by_N.reason;
  // v = (1, 1) proves that y_1 - y_2 + g_1 >= 0, y_2 - y_1 + g_2 >= 0 has no solution where g_1 + g_2 < 0, from t = 1
  // on; N x and K y do not change v^T q.
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, -1}}, Matrix{{0.5}, {-0.5}}};
  s.g = [](double t, Eigen::Ref<Vector> g) { g << 0.25 - t, 0.75; };
  for (const Method method : {Method::contour, Method::march}) {
    const Result r = run(s, method, 64);
    EXPECT_EQ(r.status, Status::infeasible) << to_string(method) << ": " << r.reason;
    EXPECT_NEAR(r.infeasible_at.value_or(0), 1 + 2.0 / 64, 1e-12) << to_string(method);
  }
}

}  // namespace
}  // namespace bromwich
