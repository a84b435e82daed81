// Boundary problems of the Galerkin method that are hard, infeasible or refused.

#include "catalogue/catalogue.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/result/switching.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;
using reference::Random;

/// Intervals that share D and C, without dynamics: x_k = x_{k-1}.
GalerkinProblem static_problem(const Matrix& D, const Matrix& C, const RowMatrix& q) {
  const Index m = C.cols(), n = D.rows(), N = q.rows();
  GalerkinProblem p;
  p.N = N;
  p.t = Vector::LinSpaced(N + 1, 0, 1);
  p.runs = {{0, N, {Matrix::Identity(m, m), Matrix::Zero(m, n), C, D, D}}};
  p.forcing = RowMatrix::Zero(N, m);
  p.q = q;
  p.boundary = {Matrix::Identity(m, m), Matrix::Zero(m, m), Vector::Zero(m)};
  return p;
}

Index first_infeasible(const GalerkinProblem& p) { return first_infeasible_interval(p, {}, RowMatrix(), RowMatrix()); }

// Feasible only far away: w_1 = x_1 - x_2 - 1 and w_2 = x_2 (1 + 1e-9) - x_1 - 1 need x_2 >= 2e9, where the residual of
// a least-squares problem is all rounding.
TEST(GalerkinFeasibility, DistantPointsAreNotDenied) {
  for (const double slope : {1e-5, 1e-9, 1e-12})
    for (const double unit : {1e-12, 1., 1e9}) {
      const Matrix C = unit * Matrix{{1, -1}, {-1, 1 + slope}};
      EXPECT_EQ(first_infeasible(static_problem(Matrix::Zero(2, 2), C, RowMatrix::Constant(1, 2, -unit))), -1) << slope;
    }
}

// q = w - D z - C x in units from 1e-9 to 1e9: feasible by construction.
TEST(GalerkinFeasibility, FeasibleIntervalsAreNotDenied) {
  Random random(21);
  for (int instance = 0; instance < 300; ++instance) {
    const Index n = 1 + instance % 7, m = 1 + instance % 3, N = 5;
    const auto units = [&](Index size) {
      return Vector(Vector::NullaryExpr(size, [&] { return std::pow(10, random.uniform(-9, 9)); }));
    };
    const Vector rows = units(n), columns = units(n), states = units(m);
    Matrix D = rows.asDiagonal() * random.matrix(n, n) * columns.asDiagonal();
    Matrix C = rows.asDiagonal() * random.matrix(n, m) * states.asDiagonal();
    if (instance % 3 == 0) D.col(n - 1).setZero();
    if (instance % 4 == 0) C.setZero();
    const RowMatrix z = random.matrix(N, n).cwiseMax(0.0) * columns.cwiseInverse().asDiagonal(),
                    x = random.matrix(N, m) * states.cwiseInverse().asDiagonal(),
                    w = random.matrix(N, n).cwiseMax(0.0) * rows.asDiagonal();
    EXPECT_EQ(first_infeasible(static_problem(D, C, w - z * D.transpose() - x * C.transpose())), -1) << instance;
  }
}

// Infeasible by construction: D^T u <= 0, C^T u = 0 and q^T u < 0 for some u >= 0 on one of several intervals, in any
// units of x and z.
TEST(GalerkinFeasibility, InfeasibleIntervalsAreFound) {
  Random random(22);
  int found = 0;
  for (int instance = 0; instance < 300; ++instance) {
    const Index n = 2 + instance % 6, m = 1 + instance % 2, N = 12, bad = instance % N;
    const Vector u = (random.vector(n).array() + 1.1).matrix();
    Matrix D = random.matrix(n, n), C = random.matrix(n, m);
    C -= u * (u.transpose() * C) / u.squaredNorm();
    const Vector along = D.transpose() * u;
    D -= u * (along.cwiseMax(0.0) / u.squaredNorm()).transpose();
    const double unit = std::pow(10, random.uniform(-9, 9));
    RowMatrix q = random.matrix(N, n).cwiseAbs();
    q.row(bad) = random.vector(n).transpose();
    q.row(bad) -= (q.row(bad).dot(u) + 0.5) / u.squaredNorm() * u.transpose();
    found += first_infeasible(static_problem(unit * D, C / unit, q)) == bad;
  }
  // The certificate u is computed to rounding; none is claimed if C^T u or D^T u are not zero to that accuracy.
  EXPECT_GE(found, 297);
}

// w_2 = g_2 - y_1, with g_2 negative in one interval of a thousand.
TEST(GalerkinFeasibility, OneIntervalOfAThousand) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(2, 2), Matrix::Identity(2, 2), Matrix{{1, 0}, {0, 0}}};
  scene.M = Matrix{{1, 0}, {-1, 0}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << 0, (t - 0.4151) * (t - 0.4159); };
  scene.boundary = BoundaryCondition{Matrix{{1, 0}, {0, 0}}, Matrix{{0, 0}, {0, 1}}, Vector::Zero(2)};
  const Result r = run(scene, Method::galerkin, 1000);
  ASSERT_EQ(r.status, Status::infeasible) << r.reason;
  EXPECT_NEAR(*r.infeasible_at, 0.415, 1e-12);
}

/// x' = -x + y + sin(2 pi t), 0 <= y ⊥ x - 0.1 >= 0, x(0) = x(T): an ideal stop.
Scene periodic_stop() {
  Scene scene;
  scene.name = "stop";
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << std::sin(2 * pi * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << -0.1; };
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  return scene;
}

// Active-set exchanges move the ends of the contact by one interval each; shooting takes as many marches for every N.
// On the stop, x = 0.1 and y = 0.1 - sin 2 pi t, which Radau IIA reproduces to its order; y does not alternate.
TEST(GalerkinShooting, ContactsWithoutCompliance) {
  for (const Index N : {160, 2560}) {
    const Result r = run(periodic_stop(), Method::galerkin, N);
    ASSERT_EQ(r.status, Status::solved) << N << ": " << r.reason;
    EXPECT_LE(*r.boundary_residual, 1e-13);
    EXPECT_LE(r.iterations, 40);
    Index on_stop = 0;
    for (Index k = 4; k < N; ++k) {
      if (!(r.y.middleRows(k - 3, 5).minCoeff() > 0))
        continue;  // the first intervals of a contact forget its beginning
      ++on_stop;
      // y of a stage has an error of second order, |y''| h^2 with |y''| <= 4 pi^2.
      EXPECT_NEAR(r.y(k, 0), 0.1 - std::sin(2 * pi * r.t[k]), 4 * pi * pi / double(N * N)) << N << ' ' << k;
    }
    EXPECT_GE(on_stop, N / 5);
  }
}

// Stages replace the moments there, and the result says so.
TEST(GalerkinBoundary, AnIdealStopIsWarnedAbout) {
  const Result r = run(periodic_stop(), Method::galerkin, 160);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.kernel.find("M is singular on what is active"), std::string::npos) << r.kernel;
  for (const char* name : {"nash-game", "lq-control", "bridge", "periodic-rectifier"})
    EXPECT_EQ(run(make_scene(name, {}), Method::galerkin, 60).kernel.find("M is singular"), std::string::npos) << name;
}

TEST(GalerkinShooting, GivesUpWhereMarchingOverflows) {
  Scene scene = make_scene("nash-game", {});
  GalerkinProblem p = galerkin_problem(scene, 8);
  p.runs.front().step.E *= 1e200;
  const auto backend = make_cpu_backend(1);
  const GalerkinSolution s = shoot(p, *backend, {}, Vector::Ones(p.states()));
  EXPECT_EQ(s.status, Status::tolerance_not_met);
  EXPECT_FALSE(s.reason.empty());
}

/// v = -p2 - y_0 + y_1 of lq-control is linear on each interval, and so is its square integrable exactly.
double control_cost(const Result& r) {
  double cost = 0;
  for (Index k = 0; k < r.steps; ++k) {
    const double h = r.t[k + 1] - r.t[k], a = -r.x(k, 3) - r.y_left(k, 0) + r.y_left(k, 1),
                 b = -r.x(k + 1, 3) - r.y(k + 1, 0) + r.y(k + 1, 1);
    cost += h * (a * a + a * b + b * b) / 6;
  }
  return cost;
}

// |v| <= 5: v = clip(k (1 - 2t), ±5) with k = 5 / sqrt(3 - 12/5), saturated up to a = (1 - 5/k)/2 = (1 - sqrt(0.6))/2,
// the first switch, and symmetrically at the end. The cost is 1/2 (2 * 25 a + k^2 (1 - 2a)^3 / 3).
TEST(GalerkinBoundary, BoundedControlHasItsSwitchesAndItsCost) {
  const double s = std::sqrt(0.6), a = (1 - s) / 2, k = 5 / s, cost = (50 * a + k * k * s * s * s / 3) / 2;
  const Scene scene = make_scene("lq-control", {});
  struct Grid {
    Index steps;
    bool located;
    double tolerance;
  };
  // On a uniform grid the projection of a kink of slope 2k has the L2 error c h^1.5, c <= 2k/sqrt(48), and the least
  // cost its square, c^2 h^3 < 1e-8; p and the switches have less than h^2. With located switches these are the
  // distances of the nodes from the switches, and the rest of the kinks enters squared, h^4.
  for (const auto& [steps, located, tolerance] : {Grid{1001, false, 1e-6}, Grid{50, true, std::pow(50, -4)}}) {
    Options options = options_for(Method::galerkin, steps);
    options.states = StateSelection::all;
    options.event_location = located;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NEAR(control_cost(r), cost, tolerance);
    const std::vector<Switch> found = switches(r);
    ASSERT_EQ(found.size(), 2u);
    EXPECT_NEAR(found[0].t, a, tolerance) << located;
    EXPECT_NEAR(found[1].t, 1 - a, tolerance) << located;
  }
}

TEST(GalerkinBoundary, RowsAtTimesWhereNothingWasFound) {
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{0, 0.3, 0.55, 1};
  Scene scene = periodic_stop();
  scene.dynamics = DenseDynamics{Matrix{{1e6}}, Matrix{{1}}, Matrix{{1}}};  // e^{hA} = e^{50000}
  Options options = options_for(Method::galerkin, 20);
  options.states = StateSelection::all;
  Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::nonfinite);
  EXPECT_EQ(r.reason, "e^{hA} overflows on an interval of length h = 0.05; take more steps");
  Result rows = at_times(scene, *backend, r, times);
  EXPECT_EQ(rows.y.rows(), 4);
  EXPECT_TRUE(rows.y.array().isNaN().all() && rows.x.array().isNaN().all());

  const Index m = 1025;  // no dense matrix of this size is formed
  SparseMatrix A(m, m), B(m, 1), N(1, m);
  A.setIdentity();
  A *= -1;
  B.insert(0, 0) = N.insert(0, 0) = 1;
  scene = Scene{};
  scene.dynamics = SparseDynamics{A, B, N};
  scene.M = Matrix{{1}};
  scene.x0 = Vector::Ones(m);
  r = run(scene, options);
  EXPECT_EQ(r.status, Status::unsupported);
  rows = at_times(scene, *backend, r, times);
  EXPECT_EQ(rows.x.cols(), m);
  EXPECT_TRUE(rows.y.array().isNaN().all() && rows.x.array().isNaN().all());
}

// x' = -x + y, x(0) = x(T), w = y + 1 - 500 on (a, a + d) with d far below an interval: y = 499 there and 0 elsewhere,
// so that x jumps by about 499 d once a period. The mean of w over an interval is positive, and no grid of few
// intervals sees the contact: the breakpoints tell, and intervals are divided there.
TEST(GalerkinBoundary, ContactsShorterThanIntervalsAreNotMissed) {
  constexpr double a = 0.4967, d = 1e-6;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t >= a && t < a + d ? -499 : 1; };
  scene.breakpoints = {a, a + d};
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector::Zero(1)};
  scene.T = 1;
  scene.default_steps = 200;
  const double after = 499 * (1 - std::exp(-d)) / (1 - std::exp(-1));
  for (const double tolerance : {0.0, 1e-3}) {
    Options options = options_for(Method::galerkin, tolerance > 0 ? 0 : 200);
    options.states = StateSelection::all;
    options.tolerance_x = tolerance;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    // y is constant between breakpoints, so that x is exact: up to rounding of d, 1e-16 of T = 1e-10 d.
    for (Index j = 0; j <= r.steps; ++j)
      EXPECT_NEAR(r.x(j, 0), after * std::exp(-(r.t[j] < a ? r.t[j] + 1 - a - d : r.t[j] - a - d)), 1e-8 * after);
  }
}

// Without the pulse in the way: a square wave, whose jumps lie inside intervals, and a mode that grows by e^20 over T,
// with conditions at both ends. The solution is that of the two modes by themselves: y = 1 while g = -1, w = y + g.
TEST(GalerkinBoundary, JumpsInsideIntervalsAreSolvedBesideGrowth) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-20, 0}, {0, 20}}, Matrix{{1}, {1}}, Matrix{{0, 0}}};
  scene.M = Matrix{{1}};
  constexpr double s = 0.3331;
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t < s ? -1 : 1; };
  scene.breakpoints = {s};
  scene.boundary = BoundaryCondition{Matrix{{1, 0}, {0, 0}}, Matrix{{0, 0}, {0, 1}}, Vector::Zero(2)};
  scene.T = 1;
  Options options = options_for(Method::galerkin);
  options.states = StateSelection::all;
  options.tolerance_x = 1e-3;
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  for (Index j = 0; j <= result.steps; ++j) {
    const double t = result.t[j];
    const double decays = t < s ? (1 - std::exp(-20 * t)) / 20 : (std::exp(-20 * (t - s)) - std::exp(-20 * t)) / 20;
    const double grows = t < s ? -(1 - std::exp(20 * (t - s))) / 20 : 0;
    EXPECT_NEAR(result.x(j, 0), decays, 1e-3 / 20) << t;
    EXPECT_NEAR(result.x(j, 1), grows, 1e-3 / 20) << t;
  }
}

// A periodic state that y pulls only while g is negative, for 1e-4 of T: x' = -x, and x' = 50 - 2x in the pulse. The
// intervals of all grids are far longer than the pulse. M = 1, and the stop M = 0, which lifts x to 50 at once.
TEST(GalerkinBoundary, PulsesShorterThanIntervalsAreSolved) {
  constexpr double begin = 0.30013, width = 1e-4, end = begin + width;
  for (const double M : {1.0, 0.0}) {
    Scene scene;
    scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
    scene.M = Matrix{{M}};
    scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = t > begin && t < end ? -50 : 10; };
    scene.breakpoints = {begin, end};
    scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector::Zero(1)};
    scene.T = 1;
    const double after = M > 0 ? 25 * (1 - std::exp(-2 * width)) / (1 - std::exp(-1 - width)) : 50;
    Options options = options_for(Method::automatic);
    options.states = StateSelection::all;
    options.tolerance_x = 1e-4;
    const Result result = run(scene, options);
    ASSERT_EQ(result.status, Status::solved) << M << ": " << result.reason;
    EXPECT_LE(result.steps, 1600);
    for (Index j = 0; j <= result.steps; ++j) {
      const double t = result.t[j], since = t < begin ? t + 1 - end : t - end;
      EXPECT_NEAR(result.x(j, 0), after * std::exp(-since), 1e-4 * after) << M << ", " << t;
    }
  }
}

}  // namespace
}  // namespace bromwich
