// Sources that jump, have kinks, or vary faster than the grid.

#include "core/kernel/discretise.hpp"
#include "core/numerics/step_propagator.hpp"
#include "core/scene/source_steps.hpp"
#include "core/solve/engines.hpp"
#include "core/solve/methods.hpp"
#include "tests/support/dense_twin.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

// A square wave with edges at `times`: +1 before the first, -1 after it, +1 after the second, ...
struct Square {
  std::vector<double> times;
  double operator()(double t) const {
    return (std::upper_bound(times.begin(), times.end(), t) - times.begin()) % 2 == 0 ? 1 : -1;
  }
};

// y in SOL(M, q), one constraint.
double solve_one(double M, double q) { return std::max(0.0, -q / M); }

// x(T) for one constraint and M > 0, by classical Runge-Kutta steps of length at most `step` that end at the
// breakpoints. Sources are evaluated inside of pieces.
Vector oracle(const Scene& scene, double step) {
  const auto& d = get<DenseDynamics>(scene.dynamics);
  const double M = to_dense(scene.M)(0, 0);
  std::vector<double> ends = scene.breakpoints;
  ends.push_back(scene.T);
  Vector x = scene.x0;
  double from = 0;
  for (const double to : ends) {
    if (to <= from) continue;
    const auto slope = [&](double t, const Vector& at) {
      const double in = std::clamp(t, from + 1e-12 * (to - from), to - 1e-12 * (to - from));
      Vector f = Vector::Zero(x.size()), g = Vector::Zero(1);
      if (scene.f) scene.f(in, f);
      if (scene.g) scene.g(in, g);
      return Vector(d.A * at + d.B * solve_one(M, (d.N * at)[0] + g[0]) + f);
    };
    const auto count = Index(std::ceil((to - from) / step));
    const double h = (to - from) / double(count);
    for (Index i = 0; i < count; ++i) {
      const double t = from + double(i) * h;
      const Vector k1 = slope(t, x), k2 = slope(t + h / 2, x + h / 2 * k1), k3 = slope(t + h / 2, x + h / 2 * k2),
                   k4 = slope(t + h, x + h * k3);
      x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    from = to;
  }
  return x;
}

Options with_states(Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  return options;
}

Vector x_at_end(const Scene& scene, Method method, Index steps) {
  const Result result = run(scene, with_states(method, steps));
  EXPECT_EQ(result.status, Status::solved) << to_string(method) << ": " << result.reason;
  return result.x.row(result.x.rows() - 1).transpose();
}

// x' = -x/0.8 + f, f a pulse; the constraint is never active.
Scene pulse(double M) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1 / 0.8}}, Matrix{{1.0}}, Matrix{{1.0}}};
  scene.M = Matrix{{M}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f[0] = t > 0.2754 && t < 0.2902 ? 175.676 : 0; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
  scene.breakpoints = {0.2754, 0.2902};
  scene.x0 = Vector::Zero(1);
  scene.T = 1;
  return scene;
}

const double pulse_end = 175.676 * 0.8 * (std::exp(-(1 - 0.2902) / 0.8) - std::exp(-(1 - 0.2754) / 0.8));

// An oscillator on a soft stop, pushed by edges of f, of g, or of both.
Scene pushed(double force, double stop) {
  const Square edges{{0.1234567, 0.71828, 1.414213, 1.7320508}};
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-9, -0.3}}, Matrix{{0.0}, {1.0}}, Matrix{{1.0, 0.2}}};
  scene.M = Matrix{{0.4}};
  scene.f = [edges, force](double t, Eigen::Ref<Vector> f) { f << 0, std::cos(3 * t) + force * edges(t); };
  scene.g = [edges, stop](double t, Eigen::Ref<Vector> g) { g[0] = 0.1 + 0.1 * std::sin(2 * t) + stop * edges(t); };
  scene.breakpoints = edges.times;
  scene.x0 = Vector::Zero(2);
  scene.T = 2;
  return scene;
}

// Observed order: log2 of the ratio of errors at T, per halving, from J to the finest of J, 2J, ... steps.
double order(const Scene& scene, const Vector& exact, Method method, Index J, int halvings) {
  const double coarse = (x_at_end(scene, method, J) - exact).norm(),
               fine = (x_at_end(scene, method, J << halvings) - exact).norm();
  return std::log2(coarse / fine) / halvings;
}

TEST(StepPropagator, AgreesWithTheExponentialOfTheExtendedMatrixAtAnyLengthAndStiffness) {
  for (const double stiff : {1.0, 1e3, 1e8}) {
    const Matrix A{{-stiff, 1, 0}, {0, -2, 3}, {0.5, -3, -1}};
    const double h = 0.1;
    StepPropagator propagator(A, h);
    for (const double d : {h, 0.7 * h, h / 3, 1e-5 * h, 1e-9 * h}) {
      const QuadraticInput u{Vector{{1, -2, 0.5}}, Vector{{0, 1, 1}}, Vector{{3, 0, -1}}};
      Matrix X = Vector{{1, 2, -1}};
      // x, and 1, sigma, sigma^2/2 as further states.
      Matrix extended = Matrix::Zero(6, 6);
      extended.topLeftCorner(3, 3) = d * A;
      extended.block(0, 3, 3, 1) = d * u.c0;
      extended.block(0, 4, 3, 1) = d * u.c1;
      extended.block(0, 5, 3, 1) = 2 * d * u.c2;
      extended(4, 3) = extended(5, 4) = 1;
      Vector start = Vector::Zero(6);
      start.head(3) = X;
      start[3] = 1;
      const Vector expected = (oracle::exponential(extended) * start).head(3);
      propagator.advance(d, u, X);
      // Squaring costs eps |A| d, in the oracle too.
      EXPECT_LE((X - expected).cwiseAbs().maxCoeff(), 100 * epsilon * (1 + stiff * d) * expected.cwiseAbs().maxCoeff())
          << stiff << ", " << d;
    }
  }
}

TEST(Sources, APulseInsideAStepIsIntegratedExactly) {
  EXPECT_NEAR(pulse_end, 1.06080447, 5e-9);
  for (const Index J : {7, 100, 1000})
    for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
      if (method != Method::march && J < 100) continue;
      // Everything is exact up to rounding and, for multigrid, the tolerance of its cycles.
      EXPECT_NEAR(x_at_end(pulse(1), method, J)[0], pulse_end, 1e-10) << to_string(method) << ", " << J;
    }
}

TEST(Sources, APulseIsIntegratedInStagesToOrderThree) {
  EXPECT_NEAR(x_at_end(pulse(0), Method::march, 100)[0], pulse_end, 1e-5);
  EXPECT_GE(order(pulse(0), Vector{{pulse_end}}, Method::march, 20, 3), 2.7);
}

TEST(Sources, ImplicitEulerTakesTheMean) {
  EXPECT_NEAR(x_at_end(pulse(1), Method::euler, 1000)[0], pulse_end, 2e-3);
  EXPECT_GE(order(pulse(1), Vector{{pulse_end}}, Method::euler, 200, 3), 0.9);
}

TEST(Sources, StepsWithJumpsKeepTheOrderOfX) {
  for (const auto& [force, stop] : {std::pair(2.0, 0.0), {0.0, 0.3}, {1.5, 0.3}}) {
    const Scene scene = pushed(force, stop);
    const Vector exact = oracle(scene, 1e-5);
    EXPECT_GE(order(scene, exact, Method::march, 25, 4), 1.9) << force << ", " << stop;
  }
}

TEST(Sources, JumpsThatNobodyDeclaredAreFound) {
  Scene scene = pushed(1.5, 0.3);
  const Options options = with_states(Method::march, 50);
  const Result declared = run(scene, options);
  scene.breakpoints.clear();
  InnerOptions every_step{options};
  every_step.look_inside_every_step = true;
  const Result found = solve_valid(scene, *make_cpu_backend(1), every_step);
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  // The parts around a jump differ: both results have the error of a grid of 50 steps.
  EXPECT_LE((found.x - declared.x).cwiseAbs().maxCoeff(), 5e-3);
  // Parts beside a jump are at most half a step long; the curvature of g contributes 0.4 d^2/8 of 0.5.
  EXPECT_LE(found.unresolved_sources, 1e-4);
}

TEST(Sources, AStiffStateFollowsAJump) {
  const double rate = 1e8, at = 0.53;
  Scene scene = pulse(1);
  scene.dynamics = DenseDynamics{Matrix{{-rate}}, Matrix{{1.0}}, Matrix{{1.0}}};
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f[0] = t < at ? 0 : rate; };
  scene.breakpoints = {at};
  const Result result = run(scene, with_states(Method::march, 10));
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  for (Index j = 0; j <= 10; ++j) EXPECT_NEAR(result.x(j, 0), j < 6 ? 0 : 1, 1e-12) << j;
}

TEST(Sources, AnUnstableStateHeldByItsConstraintStaysBounded) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{20.0}}, Matrix{{-40.0}}, Matrix{{-1.0}}};
  scene.M = Matrix{{1.0}};
  const Square edges{{1.001, 2.003, 3.007}};
  scene.f = [edges](double t, Eigen::Ref<Vector> f) { f[0] = 3 + edges(t); };
  scene.breakpoints = edges.times;
  scene.x0 = Vector::Ones(1);
  scene.T = 4;
  const Vector x = x_at_end(scene, Method::march, 1000);
  // Held at the stop: x' = -20 x + f, at rest with f = 2 after the last edge.
  EXPECT_NEAR(x[0], 2.0 / 20, 1e-6);
}

TEST(Sources, TenThousandEdgesAreSummedUp) {
  Scene scene = pulse(1);
  Square edges;
  for (int i = 0; i < 10000; ++i) edges.times.push_back((double(i) + 0.3 + 0.5 * std::sin(i) * std::sin(i)) * 1e-4);
  scene.f = [edges](double t, Eigen::Ref<Vector> f) { f[0] = edges(t); };
  scene.breakpoints = edges.times;
  double exact = 0, from = 0, sign = 1;
  for (std::size_t i = 0; i <= edges.times.size(); ++i, sign = -sign) {
    const double to = i < edges.times.size() ? edges.times[i] : 1;
    exact += sign * 0.8 * (std::exp(-(1 - to) / 0.8) - std::exp(-(1 - from) / 0.8));
    from = to;
  }
  EXPECT_NEAR(x_at_end(scene, Method::march, 400)[0], exact, 1e-10);
}

// Heat on a rectangle, heated from the constrained side at irregular times.
Scene heated() {
  Scene scene;
  KroneckerDynamics d{{5, 1.0 / 6, 1}, {4, 0.2, 1}, Vector::Zero(4), Vector::Zero(4)};
  d.b << 30, 1, 0.5, 0.2;
  d.n << 1, 0.3, 0, 0;
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Constant(5, -1), Vector::Constant(5, 4), Vector::Constant(5, -1)};
  scene.f_entry = SourceEntry::through_B;
  const Square edges{{0.1111, 0.31415, 0.5, 0.77}};
  scene.f = [edges](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < f.size(); ++i) f[i] = -1 - std::cos(double(i) + t) * edges(t);
  };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(0.1 * std::sin(7 * t)); };
  scene.breakpoints = edges.times;
  scene.x0 = Vector::LinSpaced(20, 0, 1);
  scene.T = 1;
  return scene;
}

TEST(Sources, KroneckerSumsAgreeWithTheDenseSceneThatTheyStandFor) {
  const Scene scene = heated(), twin = dense_twin(scene);
  const Result expected = run(twin, with_states(Method::contour, 64));
  ASSERT_EQ(expected.status, Status::solved) << expected.reason;
  for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
    const Result result = run(scene, with_states(method, 64));
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    // The same discrete problem to the tolerance of iterations; pieces of f are fitted to 1e-6.
    EXPECT_LE(distance(result.y, expected.y), 1e-9) << to_string(method);
    EXPECT_LE(distance(result.x, expected.x), 1e-9) << to_string(method);
    if (method == Method::march) continue;
    const auto backend = make_cpu_backend(1);
    const Matrix at = states_at(scene, *backend, result, {30, 64});
    EXPECT_LE((at.col(0) - result.x.row(30).transpose()).cwiseAbs().maxCoeff(), 1e-9);
    EXPECT_LE((at.col(1) - result.x.row(64).transpose()).cwiseAbs().maxCoeff(), 1e-9);
  }
}

TEST(Sources, SparseScenesKeepTheOrderBehindAJump) {
  const Index m = 600;
  const double spacing = 1.0 / double(m + 1);
  Scene scene;
  std::vector<Eigen::Triplet<double>> A, F;
  for (Index i = 0; i < m; ++i) {
    A.emplace_back(i, i, -2 / spacing / spacing);
    if (i > 0) A.emplace_back(i, i - 1, 1 / spacing / spacing);
    if (i + 1 < m) A.emplace_back(i, i + 1, 1 / spacing / spacing);
    F.emplace_back(i, 0, std::sin(std::numbers::pi * double(i + 1) * spacing));
  }
  SparseDynamics d{SparseMatrix(m, m), SparseMatrix(m, 1), SparseMatrix(1, m)};
  d.A.setFromTriplets(A.begin(), A.end());
  d.B.insert(m / 2, 0) = 1;
  d.N.insert(0, m / 2) = 1;
  scene.dynamics = d;
  scene.M = Matrix{{1.0}};
  scene.F = SparseMatrix(m, 1);
  scene.F.setFromTriplets(F.begin(), F.end());
  scene.f_entry = SourceEntry::through_F;
  const Square edges{{0.0321, 0.0777}};
  scene.f = [edges](double t, Eigen::Ref<Vector> f) { f[0] = 2 - edges(t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
  scene.breakpoints = edges.times;
  scene.x0 = Vector::Zero(m);
  scene.T = 0.2;
  // One mode of the rod, with the inputs 1, 3 and 1 in turn.
  const double rate = 4 / spacing / spacing * std::pow(std::sin(std::numbers::pi * spacing / 2), 2),
               first = std::exp(-rate * (0.2 - 0.0321)), second = std::exp(-rate * (0.2 - 0.0777)),
               middle = std::sin(std::numbers::pi * double(m / 2 + 1) * spacing),
               exact = middle * (1 - std::exp(-rate * 0.2) + 2 * (second - first)) / rate;
  const auto error = [&](Index J) {
    Options options = options_for(Method::march, J);
    options.states = StateSelection::list;
    options.components = {m / 2};
    const Result result = run(scene, options);
    EXPECT_EQ(result.status, Status::solved) << result.reason;
    return std::abs(result.x(J, 0) - exact);
  };
  EXPECT_LE(error(20), 1e-3 * exact);
  EXPECT_LE(error(320), 1e-3 * exact / 200);  // order 2: 1/256
}

TEST(Sources, YAtAJumpOnTheGridIsThatOfTheValueThere) {
  Scene scene = pushed(0, 0);
  const Square edges{{0.5, 1}};
  scene.g = [edges](double t, Eigen::Ref<Vector> g) { g[0] = -0.5 + 0.4 * edges(t); };
  scene.breakpoints = edges.times;
  Options options = with_states(Method::march, 40);
  const Result result = run(scene, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  EXPECT_LE(result.residual, 1e-13);
  const auto& d = get<DenseDynamics>(scene.dynamics);
  for (const Index j : {9, 10, 11, 19, 20, 21}) {
    Vector g(1);
    scene.g(result.t[j], g);
    EXPECT_NEAR(result.y(j, 0), solve_one(0.4, (d.N * result.x.row(j).transpose())[0] + g[0]), 1e-12) << j;
  }
  EXPECT_LE((result.x.row(40).transpose() - oracle(scene, 1e-5)).norm(), 2e-3);
}

TEST(Sources, FasterThanTheGridIsSaidOrResolved) {
  Scene scene = pulse(1);
  scene.breakpoints.clear();
  const double omega = 2 * std::numbers::pi * 12800;
  scene.f = [omega](double t, Eigen::Ref<Vector> f) { f[0] = omega * std::sin(omega * t); };
  const Result resolved = run(scene, with_states(Method::march, 400));
  ASSERT_EQ(resolved.status, Status::solved) << resolved.reason;
  // x = (e^{-at} - cos(omega t) + a/omega sin(omega t)) / (1 + (a/omega)^2), at t = 1 nearly e^{-a} - 1.
  EXPECT_NEAR(resolved.x(400, 0), std::exp(-1 / 0.8) - 1, 1e-4);

  scene.f = {};
  scene.g = [omega](double t, Eigen::Ref<Vector> g) { g[0] = -10 * std::sin(omega * t); };
  const Result by_contour = run(scene, Method::contour, 400);
  EXPECT_GT(by_contour.unresolved_sources, 0.25);
  EXPECT_NE(by_contour.warning + by_contour.reason, "");
  const Result by_galerkin = run(scene, Method::galerkin, 399);
  EXPECT_GT(by_galerkin.unresolved_sources, 0.25);
  EXPECT_NE(by_galerkin.warning + by_galerkin.reason, "");
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = -10 * std::sin(20 * t); };
  EXPECT_EQ(run(scene, Method::galerkin, 400).warning, "");
}

// A pulse of area 1 into a pure integral: x(1) = 1. Pulses half as long as the distance of the looks may be missed.
TEST(Sources, ShortPulsesOfUnknownFunctionsAreSeenByFixedSteps) {
  const double length = 1.05 / double(looks_at_unknown_sources);
  for (int k = 0; k < 40; ++k) {
    const double from = 0.02 + 0.96 * std::fmod(double(k) * 0.7548776662466927, 1.0);
    Scene scene = pulse(1);
    scene.breakpoints.clear();
    scene.dynamics = DenseDynamics{Matrix{{0.0}}, Matrix{{1.0}}, Matrix{{1.0}}};
    scene.f = [from, length](double t, Eigen::Ref<Vector> f) { f[0] = t > from && t < from + length ? 1 / length : 0; };
    for (const Index J : {60, 400, 4096}) {
      const Result r = run(scene, with_states(Method::march, J));
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      // The edges are found to T 2^-36 J and less, beside a length of 8e-5 T.
      EXPECT_NEAR(r.x(J, 0), 1, 1e-6) << from << ", " << J;
    }
  }
}

TEST(Sources, SmoothSourcesAreLeftAlone) {
  Scene scene = pushed(0, 0);
  scene.breakpoints.clear();
  const auto backend = make_cpu_backend(1);
  EXPECT_EQ(discretise(scene, *backend, 16, true).sources, nullptr);
  EXPECT_EQ(discretise(scene, *backend, 400).sources, nullptr);
}

TEST(Sources, BreakpointsOutsideOfTimeOrOutOfOrderAreRefused) {
  for (const std::vector<double>& times :
       {std::vector<double>{-0.1}, {1.5}, {0.3, 0.2}, {0.3, 0.3}, {std::nan("")}, {INFINITY}}) {
    Scene scene = pulse(1);
    scene.breakpoints = times;
    EXPECT_THROW(scene.validate(), Error);
  }
}

}  // namespace
}  // namespace bromwich
