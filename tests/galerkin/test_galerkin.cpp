// The exponential Galerkin method: discretisation against a dense assembly, orders, boundary conditions, refusals.

#include "core/galerkin/galerkin.hpp"

#include "catalogue/catalogue.hpp"
#include "core/galerkin/discretisation.hpp"
#include "core/galerkin/uniqueness.hpp"
#include "core/result/slack.hpp"
#include "core/solve/dense_output.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <array>
#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

/// Errors against Scene::exact: L2 in time with five Gauss points per interval (kinks off nodes cost digits of the
/// norm, not its order), and at T.
struct Errors {
  double y = 0, x = 0, y_end = 0, x_end = 0;
};

Errors errors_of(const Scene& scene, const Result& r) {
  const double a = std::sqrt(5 - 2 * std::sqrt(10. / 7)) / 3, b = std::sqrt(5 + 2 * std::sqrt(10. / 7)) / 3;
  const double wa = (322 + 13 * std::sqrt(70.)) / 1800, wb = (322 - 13 * std::sqrt(70.)) / 1800;
  const std::array<std::pair<double, double>, 5> rule{
      {{0.5, 64. / 225}, {(1 - a) / 2, wa}, {(1 + a) / 2, wa}, {(1 - b) / 2, wb}, {(1 + b) / 2, wb}}};
  Errors e;
  Vector x(scene.states()), y(scene.constraints());
  const double h = scene.T / double(r.steps);
  for (Index k = 0; k < r.steps; ++k) {
    for (const auto& [s, weight] : rule) {
      scene.exact((double(k) + s) * h, x, y);
      e.y += h * weight * ((1 - s) * r.y_left.row(k) + s * r.y.row(k + 1) - y.transpose()).squaredNorm();
    }
    scene.exact(double(k + 1) * h, x, y);
    e.x += h * (r.x.row(k + 1) - x.transpose()).squaredNorm();
  }
  scene.exact(scene.T * (1 - epsilon), x, y);  // the left limit
  e.y_end = (r.y.row(r.steps) - y.transpose()).norm();
  e.x_end = (r.x.row(r.steps) - x.transpose()).norm();
  e.y = std::sqrt(e.y);
  e.x = std::sqrt(e.x);
  return e;
}

Result run_galerkin(const Scene& scene, Index steps) {
  Options options = options_for(Method::galerkin, steps);
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << scene.name << ": " << r.reason;
  return r;
}

double order(double coarse, double fine) { return std::log2(coarse / fine); }

// The kinks of the solution lie on nodes if 6 divides N.
TEST(Galerkin, BridgeHasItsKnownErrors) {
  const Scene scene = make_scene("bridge", {});
  const std::vector<std::pair<Index, double>> known{{24, 1.8e-2}, {48, 4.6e-3}, {96, 1.15e-3}, {192, 2.9e-4}};
  std::vector<Errors> errors;
  for (const auto& [N, error] : known) {
    errors.push_back(errors_of(scene, run_galerkin(scene, N)));
    EXPECT_NEAR(errors.back().y / error, 1, 0.05) << N;  // printed with two digits
  }
  for (std::size_t i = 1; i < errors.size(); ++i) {
    EXPECT_GE(order(errors[i - 1].y, errors[i].y), 1.9);
    EXPECT_GE(order(errors[i - 1].x, errors[i].x), 1.9);
    EXPECT_GE(order(errors[i - 1].x_end, errors[i].x_end), 1.9);
  }
}

// Off the nodes a kink costs half an order, depending on its place in the interval: tested over a factor of 16.
TEST(Galerkin, BridgeWithKinksOffTheNodes) {
  const Scene scene = make_scene("bridge", {});
  const Errors coarse = errors_of(scene, run_galerkin(scene, 50)), fine = errors_of(scene, run_galerkin(scene, 800));
  EXPECT_GE(order(coarse.y, fine.y) / 4, 1.4);
  EXPECT_GE(order(coarse.x, fine.x) / 4, 1.4);
  EXPECT_GE(order(coarse.x_end, fine.x_end) / 4, 1.4);
}

// The paper's comparison at h = 1e-3: the error of x(T) at least 2000 times smaller than that of implicit Euler.
TEST(Galerkin, BridgeAgainstImplicitEuler) {
  const Scene scene = make_scene("bridge", {});
  const Index N = 9426;  // 6 * 1571
  Options euler = options_for(Method::euler, N);
  euler.states = StateSelection::all;
  const Result by_euler = run(scene, euler);
  ASSERT_EQ(by_euler.status, Status::solved) << by_euler.reason;
  Vector x(2), y(1);
  scene.exact(scene.T, x, y);
  const double apart = (by_euler.x.row(N) - x.transpose()).norm();
  EXPECT_GE(apart / errors_of(scene, run_galerkin(scene, N)).x_end, 2e3);
}

// The bridge as a boundary problem: x(0) and x(T) given instead of x(0) and x'(0).
TEST(Galerkin, BridgeBetweenTwoPositions) {
  Scene scene = make_scene("bridge", {{"T", 2.5}});
  Vector x0(2), xT(2), y(1);
  scene.exact(0, x0, y);
  scene.exact(scene.T, xT, y);
  scene.boundary = BoundaryCondition{Matrix{{1, 0}, {0, 0}}, Matrix{{0, 0}, {1, 0}}, Vector{{x0[0], xT[0]}}};
  scene.x0.resize(0);
  Result r = run_galerkin(scene, 200);
  EXPECT_LE(*r.boundary_residual, 1e-13);
  const Errors coarse = errors_of(scene, r), fine = errors_of(scene, run_galerkin(scene, 1600));
  EXPECT_GE(order(coarse.y, fine.y) / 3, 1.4);
  EXPECT_GE(order(coarse.x, fine.x) / 3, 1.4);
}

// Singular PSD M; the exact solution is known. With its kinks, at 0.3 and 0.5, on nodes y is in the space; only the
// quadrature error of f and g remains.
TEST(Galerkin, NashGame) {
  const Scene scene = make_scene("nash-game", {});
  const Result r = run_galerkin(scene, 20);
  EXPECT_LE(*r.boundary_residual, 1e-12);
  const Errors on_nodes = errors_of(scene, r), coarse = errors_of(scene, run_galerkin(scene, 16)),
               fine = errors_of(scene, run_galerkin(scene, 256));
  EXPECT_LE(on_nodes.y, 1e-6);
  EXPECT_LE(on_nodes.x, 1e-6);
  EXPECT_GE(order(coarse.y, fine.y) / 4, 1.4);
  EXPECT_GE(order(coarse.x, fine.x) / 4, 1.9);
}

TEST(Galerkin, BoundedControl) {
  const Scene scene = make_scene("lq-control", {});
  const Errors coarse = errors_of(scene, run_galerkin(scene, 64)), fine = errors_of(scene, run_galerkin(scene, 1024));
  EXPECT_GE(order(coarse.x, fine.x) / 4, 1.4);
  EXPECT_GE(order(coarse.x_end, fine.x_end) / 4, 1.4);
}

// The steady state is the limit of marching: after 60 periods the initial distance of 10 has decayed by
// e^{-60 * 0.02 / 0.1} = 6e-6; another 60 take the rest to 4e-11.
TEST(Galerkin, PeriodicSteadyStateIsTheLimitOfMarching) {
  const Scene scene = make_scene("periodic-rectifier", {});
  const Index N = 400, periods = 120;
  const Result steady = run_galerkin(scene, N);
  Scene start = scene;
  start.boundary.reset();
  start.x0 = Vector::Zero(1);
  start.T = scene.T * double(periods);
  const Result marched = run_galerkin(start, N * periods);
  // Work in intervals: each sweep passes N of them. The coarser grids of the start add up to N more.
  EXPECT_LE(2 * steady.iterations * N, marched.steps / 10);
  EXPECT_LE(distance(marched.x.bottomRows(N), steady.x.bottomRows(N)), 1e-6);
  EXPECT_LE(distance(marched.y.bottomRows(N), steady.y.bottomRows(N)), 1e-6);
}

TEST(Galerkin, OutputAtAnyTimeHasTheOrderOfTheMethod) {
  const Scene scene = make_scene("bridge", {});
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{0, 0.1234, 1.5, pi, 4.3, 7.77, scene.T};
  double before = 0;
  for (const Index N : {48, 96}) {
    Options options = options_for(Method::galerkin, N);
    options.states = StateSelection::all;
    const Result r = at_times(scene, *backend, solve(scene, *backend, options), times);
    double worst = 0;
    Vector x(2), y(1);
    for (std::size_t i = 0; i < times.size(); ++i) {
      scene.exact(times[i], x, y);
      worst = std::max(worst, (r.x.row(Index(i)) - x.transpose()).norm());
    }
    if (before > 0) {
      EXPECT_GE(order(before, worst), 1.9);
    }
    before = worst;
  }
}

TEST(Galerkin, SmallestEigenvalueOfTheBridge) {
  const Scene scene = make_scene("bridge", {});
  EXPECT_NEAR(smallest_symmetric_eigenvalue(scene, 64, 0), -1.45, 0.005);  // of the continuous operator, as printed
  EXPECT_NEAR(smallest_symmetric_eigenvalue(scene, 64, 1), 0.40, 0.005);
}

// Against a dense matrix: L by columns, the Gram matrix of the basis by definition.
TEST(Galerkin, SmallestEigenvalueOfABoundaryProblem) {
  const Scene scene = make_scene("nash-game", {});
  const Index N = 6, n = 5, size = 2 * n * N;
  const GalerkinProblem p = galerkin_problem(scene, N);
  Matrix L(size, size), gram = Matrix::Zero(size, size);
  for (Index i = 0; i < size; ++i) {
    const Vector unit = Vector::Unit(size, i);
    const RowMatrix w = apply_galerkin(p, Eigen::Map<const RowMatrix>(unit.data(), N, 2 * n));
    L.col(i) = Eigen::Map<const Vector>(w.data(), size);
    const bool left = i % (2 * n) < n;
    gram(i, i) = 2. / 3;
    gram(i, left ? i + n : i - n) = 1. / 3;
  }
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> eigen(0.5 * (L + L.transpose()), gram);
  EXPECT_NEAR(smallest_symmetric_eigenvalue(scene, N, 0), eigen.eigenvalues()[0], 1e-6 * eigen.eigenvalues()[size - 1]);
}

TEST(Galerkin, SaysWhereSeveralSolutionsAreNotExcluded) {
  EXPECT_EQ(run_galerkin(make_scene("periodic-rectifier", {}), 16).warning, "");
  EXPECT_NE(run_galerkin(make_scene("nash-game", {}), 16).warning.find("uniqueness is not assured"), std::string::npos);
}

// x' = y + f, w = x - 1 + y, x(0) = x(T): without y, x is undetermined.
Scene integrator(const BoundaryCondition& boundary) {
  Scene scene;
  scene.name = "integrator";
  scene.dynamics = DenseDynamics{Matrix::Zero(2, 2), Matrix{{1}, {0}}, Matrix{{1, 0}}};
  scene.M = Matrix{{1}};
  scene.boundary = boundary;
  return scene;
}

TEST(Galerkin, RefusesConditionsThatDetermineNothing) {
  const Matrix I = Matrix::Identity(2, 2), none = Matrix::Zero(2, 2);
  const auto refused = [](const BoundaryCondition& c) {
    return refusal([&] { run(integrator(c), Method::galerkin, 10); });
  };
  EXPECT_EQ(refused({I, -I, Vector::Zero(2)}).find("boundary: E0 + ET e^{TA} is singular (reciprocal condition"), 0u);
  EXPECT_EQ(refused({Matrix{{1, 0}, {2, 0}}, none, Vector{{1, 2}}}),
            "boundary: the rows of [E0 ET] have rank 1 of 2; give independent conditions, one per state");
  EXPECT_EQ(
      refused({Matrix{{1, 0}, {2, 0}}, none, Vector{{1, 3}}}),
      "boundary: the rows of [E0 ET] have rank 1 of 2 and b contradicts them; give independent conditions, one per "
      "state");
  EXPECT_EQ(refused({Matrix{{1, 0}, {0, 0}}, none, Vector{{1, 0}}}),
            "boundary: row 1 of E0 and ET is zero; give one condition per state");
}

// x' = -1e-9 x + y + f, periodic: without y, x has an error of 1e9 roundings.
TEST(Galerkin, SaysWhereTheBoundaryConditionIsDelicate) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1e-9}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << std::sin(2 * pi * t); };
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  const Result r = run(scene, Method::galerkin, 20);
  EXPECT_NE(r.warning.find("ill-conditioned"), std::string::npos) << r.warning;
}

TEST(Galerkin, InfeasibleConstraints) {
  Scene scene = integrator({Matrix::Identity(2, 2), Matrix::Zero(2, 2), Vector::Zero(2)});
  // Two free rows with the same left side and different right sides.
  scene.dynamics = DenseDynamics{Matrix::Zero(2, 2), Matrix{{1, 1}, {0, 0}}, Matrix{{1, 0}, {1, 0}}};
  scene.M = Matrix{{1, 1}, {1, 1}};
  scene.free_rows = {0, 1};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << 0, (t > 0.5 ? 1 : 0); };
  Result r = run(scene, Method::galerkin, 10);
  EXPECT_EQ(r.status, Status::infeasible);
  EXPECT_NEAR(r.infeasible_at.value_or(-1), 0.5, 1e-12);
  // Without the contradiction there are still two free unknowns for one equation.
  scene.g = {};
  r = run(scene, Method::galerkin, 10);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.warning.find("least norm"), std::string::npos);

  // w_2 = -y_1 - 1 cannot become nonnegative for any x; a boundary problem with many intervals.
  scene = integrator({Matrix{{1, 0}, {0, 0}}, Matrix{{0, 0}, {0, 1}}, Vector::Zero(2)});
  scene.dynamics = DenseDynamics{Matrix::Zero(2, 2), Matrix{{1, 0}, {0, 1}}, Matrix{{1, 0}, {0, 0}}};
  scene.M = Matrix{{1, 0}, {-1, 0}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, -1; };
  for (const Index N : {10, 300}) {
    r = run(scene, Method::galerkin, N);
    EXPECT_EQ(r.status, Status::infeasible) << r.reason;
  }
}

TEST(Galerkin, SourcesThatAreNotFiniteHaveAStatus) {
  Scene scene = make_scene("bridge", {});
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, 1 / std::max(0.0, 1 - t); };
  const Result r = run(scene, Method::galerkin, 100);
  EXPECT_EQ(r.status, Status::nonfinite);
}

// x'' = 10^4 x between two ends: e^{TA} = e^{1000} overflows, the boundary problem is harmless.
TEST(Galerkin, BoundaryLayersDoNotOverflow) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 100}, {100, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{1}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 1; };
  scene.boundary = BoundaryCondition{Matrix{{1, 0}, {0, 0}}, Matrix{{0, 0}, {1, 0}}, Vector{{1, 2}}};
  scene.T = 10;
  const Result r = run_galerkin(scene, 2000);
  EXPECT_LE(*r.boundary_residual, 1e-12);
  // y = 0, x = e^{-100 t} + 2 e^{-100 (10 - t)} up to e^{-1000}.
  EXPECT_EQ(r.y.cwiseAbs().maxCoeff(), 0);
  for (const Index k : {0, 2, 10, 1000, 1990, 1998, 2000}) {
    const double t = scene.T * double(k) / 2000;
    // The factor of a step has the error eps e^{0.5}; 2000 steps.
    EXPECT_NEAR(r.x(k, 0), std::exp(-100 * t) + 2 * std::exp(-100 * (10 - t)), 1e-11) << k;
  }
}

// w = y + g with g = -1 for 0.01 and 1 otherwise: y = 1 for 0.01. Intervals of 1/40 see the mean of g alone, which is
// above 0, and y = 0. With any number of states the march beside it shows that.
TEST(Galerkin, AContactInsideAnIntervalIsNamedWithAnyNumberOfStates) {
  for (const Index m : {2, 80}) {
    Scene scene;
    scene.name = "short contact";
    const Vector decay = -Vector::LinSpaced(m, 1, double(m));
    scene.dynamics = DenseDynamics{Matrix(decay.asDiagonal()), Matrix::Ones(m, 1), Matrix::Zero(1, m)};
    scene.M = Matrix{{1}};
    scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = t >= 0.505 && t < 0.515 ? -1 : 1; };
    scene.breakpoints = {0.505, 0.515};
    scene.x0 = Vector::Zero(m);
    scene.T = 1;
    Options options = options_for(Method::galerkin, 40);
    options.states = StateSelection::all;
    const Result r = run(scene, options);
    EXPECT_LT(integral_of_y(r).bottomRows(1)(0, 0), 0.005) << m;  // half of the true one
    const std::string said = r.warning + r.reason;
    EXPECT_NE(said.find("the result is off: "), std::string::npos) << m << ": " << said;
  }
}

TEST(Galerkin, ToleranceChoosesTheSteps) {
  const Scene scene = make_scene("bridge", {});
  Options options = options_for(Method::galerkin, 24);
  options.tolerance = 1e-3;
  const Result r = run(scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_GT(r.steps, 24);
  double worst = 0;
  Vector x(2), y(1);
  for (Index k = 1; k <= r.steps; ++k) {
    scene.exact(r.t[k] * (1 - epsilon), x, y);
    worst = std::max(worst, (r.y.row(k) - y.transpose()).norm());
  }
  EXPECT_LE(worst, 1e-3);
}

// x' = 80 x + y - 81, held at x >= 1 by a stop that gives way by M: y = (1 - x)/M. With a = 80 - 1/M < 0 x decays to
// (81 - 1/M)/a as e^{at}; rounding of y alone would grow to 1e-16 e^80 = 6e18.
TEST(Galerkin, StatesThatYHoldsDoNotGrowAway) {
  for (const double M : {1e-3, 5e-3})
    for (const Index steps : {100, 200, 300})
      for (const bool located : {false, true}) {
        Scene scene;
        scene.dynamics = DenseDynamics{Matrix{{80}}, Matrix{{1}}, Matrix{{1}}};
        scene.M = Matrix{{M}};
        scene.f = [](double, Eigen::Ref<Vector> v) { v[0] = -81; };
        scene.g = [](double, Eigen::Ref<Vector> v) { v[0] = -1; };
        scene.x0 = Vector::Ones(1);
        Options options = options_for(Method::galerkin, steps);
        options.states = StateSelection::all;
        options.event_location = located;
        const Result r = run(scene, options);
        ASSERT_EQ(r.status, Status::solved) << r.reason;
        // Of the layer e^{-60} is left; problems are solved to 1e-11, and y acts on x through 1/M.
        EXPECT_NEAR(r.x(steps, 0), (81 - 1 / M) / (80 - 1 / M), 1e-8) << M << ' ' << steps << ' ' << located;
      }
}

// x' = -x + y, w = x + y + g with g = -1 + 1.5 mod(t, 1/2), which jumps at rows and at T. y is of order 2: (1/50)^2.
TEST(Galerkin, RowsAtJumpsAreOnTheSideOfY) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -1 + 1.5 * std::fmod(t, 0.5); };
  scene.breakpoints = {0.5, 1, 1.5, 2};
  scene.x0 = Vector::Zero(1);
  scene.T = 2;
  Options options = options_for(Method::galerkin, 100);
  options.trace = true;
  const Result r = run(scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const RowMatrix w = slack(scene, r);
  for (const Index j : {25, 50, 75, 100}) EXPECT_LT(std::abs(std::min(r.y(j, 0), w(j, 0))), 1e-3) << j;
}

// Forces that come and go 64 times within ten intervals: what is off by more than all of it is no solution.
TEST(Galerkin, WhatIsOffByAllOfItIsNotSolved) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-0.1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = 9 - 20 * std::pow(std::sin(200 * t + 1), 16); };
  scene.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  Options options = options_for(Method::galerkin, 10);
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  options.method = Method::shooting, options.steps = 0, options.tolerance = 1e-6;
  const Result known = run(scene, options);
  ASSERT_EQ(known.status, Status::solved) << known.reason;
  EXPECT_GT(std::abs(r.x(0, 0) - known.x(0, 0)), 0.9 * known.x(0, 0));
  EXPECT_EQ(r.status, Status::tolerance_not_met);
  EXPECT_NE(r.reason.find("%"), std::string::npos) << r.reason;
}

}  // namespace
}  // namespace bromwich
