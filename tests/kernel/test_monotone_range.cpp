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

#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

// A scene of a random singular M whose null space neither B nor N sees; `seed` decides all. y is of size 1.
Scene seen_by_its_range(std::uint32_t seed, double T = 1) {
  Random random(seed);
  const Index n = 2 + Index(seed % 3), m = 3;
  const oracle::Monotone p = oracle::random_monotone(random, n, seed % 2 == 0 ? 0 : 3);
  Scene s;
  s.M = p.M;
  // With factors p.M both vanish where M does; M is symmetric here.
  s.dynamics = DenseDynamics{random.matrix(m, m) - 2 * Matrix::Identity(m, m), random.matrix(m, n) * p.M / double(n),
                             p.M * random.matrix(n, m) / double(n)};
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
  EXPECT_EQ(range(M, Matrix{{1, 1}}, Matrix{{0.5}, {0.4}}).why, "N x leaves the range of M + M^T");
  EXPECT_FALSE(range(Matrix{{0, 1}, {-1, 0}}, Matrix{{1, 1}}, Matrix{{1}, {1}}).range) << "a skew M has no range";
  EXPECT_TRUE(range_of_M(M, LcpClass::P, Matrix{{1, 1}}.sparseView(), Matrix{{1}, {1}}.sparseView()).why.empty());
}

// y of every time point is the solution of least norm of LCP(M, N x_j + g_j), and x_j follows from y: the discrete
// problem, by enumeration and Eigen's exponential. Three methods find it.
TEST(MonotoneRange, IterationFindsLeastNorms) {
  int unique = 0, all = 0;
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const Scene scene = seen_by_its_range(seed);
    const oracle::DenseScene dense = oracle::write_out(scene);
    for (const Method method : {Method::contour, Method::contour_literal, Method::multigrid, Method::march}) {
      const Result r = run(scene, method, 64);
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
}

// Sweeps shrink |S^1/2 (y^{k+1} - y^k)| at least as the criterion says: their number stays below the forecast.
TEST(MonotoneRange, ForecastBoundsTheSweeps) {
  int known = 0;
  for (std::uint32_t seed = 100; seed < 130; ++seed) {
    const Scene scene = seen_by_its_range(seed, 0.5);
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
  EXPECT_GE(known, 20);
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
  s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1, 1}}, Matrix{{0.5}, {0.4}}};
  const Result by_N = run(s, Method::contour, 64);
  EXPECT_EQ(by_N.status, Status::unsupported);
  EXPECT_NE(by_N.reason.find("N x leaves the range of M + M^T): sweeps may meet problems without a solution"),
            std::string::npos)
      << by_N.reason;
  // v = (1, 1) proves that y_1 - y_2 + g_1 >= 0, y_2 - y_1 + g_2 >= 0 has no solution where g_1 + g_2 < 0, from t = 1
  // on; N x and K y do not change v^T q.
  s.M = Matrix{{1, -1}, {-1, 1}};
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
