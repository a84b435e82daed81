// Properties of any solver: causality, symmetry, scaling, states, and a correct status.

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "tests/support/friction.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

namespace bromwich {
namespace {

constexpr Index J = 64;

Scene some_scene(std::uint32_t seed = 7) {
  return oracle::random_scene(seed, 5, 4, oracle::SpectrumKind::sector, oracle::MatrixKind::dominant);
}

const DenseDynamics& dynamics(const Scene& scene) { return get<DenseDynamics>(scene.dynamics); }
const Matrix& matrix(const Scene& scene) { return std::get<Matrix>(scene.M); }

class EveryMethod : public testing::TestWithParam<Method> {};

TEST_P(EveryMethod, TheFutureDoesNotChangeThePast) {
  const double change_at = 0.5;
  const Scene before = some_scene();
  Scene after = before;
  after.g = [g = before.g, change_at](double t, Eigen::Ref<Vector> v) {
    g(t, v);
    if (t > change_at) v.array() -= 3;
  };
  const RowMatrix y = solved_y(before, GetParam(), J), changed = solved_y(after, GetParam(), J);
  // Marching does not use the future. With a jump ahead, other operators make the same steps up to rounding of values
  // of size 1. Methods over all times differ in the last iterate within the iteration tolerance, and an FFT along time
  // spreads rounding over all rows.
  const double tolerance =
      GetParam() == Method::contour || GetParam() == Method::multigrid ? same_problem : 16 * epsilon;
  EXPECT_LE(distance(y.topRows(J / 2 + 1), changed.topRows(J / 2 + 1)), tolerance);
  EXPECT_GT(distance(y.bottomRows(J / 2), changed.bottomRows(J / 2)), 0.1);
}

TEST_P(EveryMethod, PermutedConstraintsPermuteTheSolution) {
  const Scene scene = some_scene();
  const std::vector<Index> order{2, 0, 3, 1};
  Scene permuted = scene;
  const DenseDynamics& d = dynamics(scene);
  permuted.dynamics = DenseDynamics{d.A, d.B(Eigen::all, order), d.N(order, Eigen::all)};
  permuted.M = Matrix(matrix(scene)(order, order));
  permuted.g = [g = scene.g, order](double t, Eigen::Ref<Vector> v) {
    Vector all(v.size());
    g(t, all);
    v = all(order);
  };
  const RowMatrix y = solved_y(scene, GetParam(), J);
  EXPECT_LE(distance(solved_y(permuted, GetParam(), J), y(Eigen::all, order)), same_problem);
}

// The states in another order, some of them with another sign: x -> D P x.
Scene mirrored(const Scene& scene, const std::vector<Index>& order, const Vector& sign) {
  const DenseDynamics& d = dynamics(scene);
  const auto D = sign.asDiagonal();
  Scene mirror = scene;
  mirror.dynamics = DenseDynamics{D * d.A(order, order) * D, D * d.B(order, Eigen::all), d.N(Eigen::all, order) * D};
  mirror.f = [f = scene.f, order, sign](double t, Eigen::Ref<Vector> v) {
    Vector all(v.size());
    f(t, all);
    v = sign.cwiseProduct(all(order));
  };
  mirror.x0 = sign.cwiseProduct(scene.x0(order));
  return mirror;
}

class Mirrors : public testing::TestWithParam<Method> {};

TEST_P(Mirrors, OfTheStateGiveMirrorImages) {
  const std::vector<Index> order{3, 0, 4, 1, 2};
  const Vector sign{{-1, 1, -1, -1, 1}};
  // Located events have other steps: a hundred times the tolerance of their coefficients, 1e-10.
  const double same = GetParam() == Method::events ? 1e-8 : same_problem;
  for (const std::uint32_t seed : {7u, 8u, 9u}) {
    const Scene scene = some_scene(seed);
    Options options = options_for(GetParam(), J);
    options.states = StateSelection::all;
    const Result r = run(scene, options), mirror = run(mirrored(scene, order, sign), options);
    ASSERT_EQ(mirror.status, r.status) << mirror.reason;
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_LE(distance(mirror.y, r.y), same) << seed;
    EXPECT_LE(distance(mirror.x, r.x(Eigen::all, order) * sign.asDiagonal()), same) << seed;
  }
}

TEST_P(EveryMethod, PositivelyHomogeneousInTheData) {
  const Scene scene = some_scene();
  const double factor = 10;
  const auto scaled_source = [factor](const TimeFunction& source) -> TimeFunction {
    return [source, factor](double t, Eigen::Ref<Vector> v) {
      source(t, v);
      v *= factor;
    };
  };
  Scene scaled = scene;
  scaled.f = scaled_source(scene.f);
  scaled.g = scaled_source(scene.g);
  scaled.x0 *= factor;
  EXPECT_LE(distance(solved_y(scaled, GetParam(), J), factor * solved_y(scene, GetParam(), J)), factor * same_problem);
}

TEST_P(EveryMethod, ScaledConstraintsKeepTheSolution) {
  const Scene scene = some_scene();
  const Vector scale{{0.5, 3, 1, 20}};
  Scene scaled = scene;
  const DenseDynamics& d = dynamics(scene);
  scaled.dynamics = DenseDynamics{d.A, d.B, scale.asDiagonal() * d.N};
  scaled.M = Matrix(scale.asDiagonal() * matrix(scene));
  scaled.g = [g = scene.g, scale](double t, Eigen::Ref<Vector> v) {
    g(t, v);
    v.array() *= scale.array();
  };
  EXPECT_LE(distance(solved_y(scaled, GetParam(), J), solved_y(scene, GetParam(), J)), same_problem);
}

TEST_P(EveryMethod, UnitOfTimeDoesNotMatter) {
  const Scene scene = some_scene();
  const double unit = 1e-3;  // t = 1 becomes t = 1e-3
  Scene scaled = scene;
  const DenseDynamics& d = dynamics(scene);
  scaled.dynamics = DenseDynamics{d.A / unit, d.B / unit, d.N};
  scaled.f = [f = scene.f, unit](double t, Eigen::Ref<Vector> v) {
    f(t / unit, v);
    v /= unit;
  };
  scaled.g = [g = scene.g, unit](double t, Eigen::Ref<Vector> v) { g(t / unit, v); };
  scaled.T = scene.T * unit;
  EXPECT_LE(distance(solved_y(scaled, GetParam(), J), solved_y(scene, GetParam(), J)), same_problem);
}

INSTANTIATE_TEST_SUITE_P(Properties, EveryMethod,
                         testing::Values(Method::multigrid, Method::contour, Method::march, Method::euler),
                         [](const auto& method) { return std::string(to_string(method.param)); });
INSTANTIATE_TEST_SUITE_P(Properties, Mirrors,
                         testing::Values(Method::multigrid, Method::contour, Method::march, Method::euler,
                                         Method::galerkin, Method::events),
                         [](const auto& method) { return std::string(to_string(method.param)); });

// The same contacts with friction seen in a mirror: another problem of each step, with the mirrored state.
TEST(Mirrors, OfContactsWithFrictionGiveMirrorImages) {
  oracle::Contacts c;
  c.mass = Matrix{{2, -1}, {-1, 2}};
  c.stiffness = Matrix{{2, -0.6}, {-0.6, 1.5}};
  c.damping = 0.02 * c.stiffness;
  c.Hn = Matrix{{0, 1}};
  c.Ht = Matrix{{1, 0}};
  c.V = Vector{{0.2}};
  c.mu = Vector{{0.3}};
  c.x0 = Vector{{0, 0.1, -1, -1}};
  c.T = 3;
  c.f = [](double t) { return Vector{{0.3 * std::sin(2.1 * t), -1}}; };
  const Vector sign{{-1, 1, -1, 1}};
  for (const Method method : {Method::events, Method::march, Method::euler}) {
    Options options = options_for(method, 300);
    options.states = StateSelection::all;
    const Result r = run(oracle::friction_scene(c), options),
                 mirror = run(oracle::friction_scene(oracle::mirrored(c)), options);
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    ASSERT_EQ(mirror.status, Status::solved) << to_string(method) << ": " << mirror.reason;
    // Located events as above, and implicit Euler up to rounding. Radau IIA notices an impact by the y that it
    // releases, and these are others in the mirror: h^2.
    const double same = method == Method::march ? 1e-4 : 1e-8;
    EXPECT_LE(distance(mirror.x, r.x * sign.asDiagonal()), same) << to_string(method);
  }
}

// ---- states ----

void expect_states(const Scene& scene, Method method, Index steps) {
  const oracle::DenseScene dense = oracle::write_out(scene);
  const oracle::Trajectory expected =
      method == Method::euler ? oracle::euler(dense, steps) : oracle::march(dense, steps);
  Options options = options_for(method, steps);

  Result result = run(scene, options);
  EXPECT_EQ(result.x.cols(), 0);
  EXPECT_TRUE(result.x_components.empty());
  ASSERT_EQ(result.t.size(), steps + 1);
  EXPECT_LE((result.t - expected.t).cwiseAbs().maxCoeff(), 4 * epsilon * scene.T);

  options.states = StateSelection::all;
  result = run(scene, options);
  ASSERT_EQ(result.x.rows(), steps + 1);
  ASSERT_EQ(result.x.cols(), scene.states());
  // States are the convolution of y, accurate to same_problem, with kernels of norm below 10.
  EXPECT_LE(distance(result.x, expected.x), 10 * same_problem) << to_string(method);
  EXPECT_LE(distance(result.y, expected.y), same_problem) << to_string(method);

  options.states = StateSelection::list;
  options.components = {scene.states() - 1, 0};
  result = run(scene, options);
  ASSERT_EQ(result.x_components, options.components);
  ASSERT_EQ(result.x.cols(), 2);
  for (Index i = 0; i < 2; ++i)
    EXPECT_LE(distance(result.x.col(i), expected.x.col(result.x_components[std::size_t(i)])), 10 * same_problem);
}

TEST(States, OfDenseScenes) {
  for (const Method method : {Method::multigrid, Method::contour, Method::march, Method::euler})
    for (const auto spectrum :
         {oracle::SpectrumKind::real_negative, oracle::SpectrumKind::sector, oracle::SpectrumKind::imaginary})
      expect_states(oracle::random_scene(3, 5, 3, spectrum, oracle::MatrixKind::dominant), method, J);
}

TEST(States, OfSignorini) {
  for (const Method method : {Method::multigrid, Method::contour, Method::march, Method::euler})
    expect_states(make_scene("signorini", {{"Q", 7}}), method, 40);
}

// ---- status and bad input ----

/// M has the solutions (1, 0) and ((2x-1)/3, (x-2)/3), which merge at x = 2, t = ln(5/3), and disappear.
Scene fold() {
  Scene scene;
  scene.name = "fold";
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{0.5, 0}}, Matrix{{0}, {1}}};
  scene.M = Matrix{{1, -2}, {-2, 1}};
  scene.lcp_class = LcpClass::Z;
  scene.g = [](double, Eigen::Ref<Vector> g) { g << -1, 0; };
  scene.x0 = Vector::Constant(1, 3);
  scene.T = 1;
  return scene;
}

TEST(Status, InfeasibleWhereTheSolutionsMerge) {
  const Index steps = 100;
  const Result result = run(fold(), options_for(Method::march, steps));
  ASSERT_EQ(result.status, Status::infeasible) << result.reason;
  EXPECT_FALSE(result.reason.empty());
  ASSERT_TRUE(result.infeasible_at);
  // y is constant until then, so marching is exact, and the first step beyond the fold fails.
  EXPECT_LE(std::abs(*result.infeasible_at - std::log(5. / 3)), 1. / double(steps));
  ASSERT_EQ(result.y.rows(), steps + 1);
  for (Index j = 0; j <= steps; ++j) {
    if (double(j) / double(steps) < std::log(5. / 3)) {
      EXPECT_NEAR(result.y(j, 0), 1, 1e-14) << "row " << j;
      EXPECT_NEAR(result.y(j, 1), 0, 1e-14) << "row " << j;
    } else {
      EXPECT_TRUE(std::isnan(result.y(j, 0)) && std::isnan(result.y(j, 1))) << "row " << j;
    }
  }
}

TEST(Status, InfeasibleAtTheStart) {
  Scene scene = fold();
  scene.x0[0] = 1.5;
  const Result result = run(scene, options_for(Method::march, J));
  ASSERT_EQ(result.status, Status::infeasible) << result.reason;
  ASSERT_TRUE(result.infeasible_at);
  EXPECT_EQ(*result.infeasible_at, 0);
  EXPECT_TRUE(result.y.array().isNaN().all());
}

// w = -y - 1: M is of no class, and no y >= 0 has w >= 0.
TEST(Status, InfeasibleAtTheStartWithMOfNoClass) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{0}}};
  scene.M = Matrix{{-1}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = -1; };
  scene.x0 = Vector::Constant(1, 1);
  scene.T = 1;
  for (const Method method : {Method::automatic, Method::march, Method::euler}) {
    const Result result = run(scene, options_for(method, J));
    EXPECT_EQ(result.status, Status::infeasible) << to_string(method) << ": " << result.reason;
    EXPECT_EQ(result.infeasible_at.value_or(-1), 0) << to_string(method);
  }
}

// A body below a rigid floor: impulses move its velocity, not its place. On the floor and moving down it is stopped.
TEST(Status, InfeasibleWhereNoImpulseMovesTheState) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {-4, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{0}};
  scene.T = 1;
  for (const Method method : {Method::automatic, Method::march, Method::euler, Method::events, Method::galerkin}) {
    scene.x0 = Vector{{-1, 0}};
    const Result below = run(scene, options_for(method, J));
    EXPECT_EQ(below.status, Status::infeasible) << to_string(method) << ": " << below.reason;
    EXPECT_EQ(below.infeasible_at.value_or(-1), 0) << to_string(method);
    for (const double rounding : {0.0, -1.4e-17}) {
      scene.x0 = Vector{{rounding, -1}};
      const Result on_the_floor = run(scene, options_for(method, J));
      EXPECT_EQ(on_the_floor.status, Status::solved) << to_string(method) << ": " << on_the_floor.reason;
    }
  }
}

// x' = -x + y, 0 <= y ⊥ x >= 0 from x0 = -0.5: an impulse takes x to 0, where it stays. Row 0 of x is x0, and of y and
// w what is behind the impulse.
TEST(Status, BeginsBehindAnImpulse) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{0}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = t; };
  scene.x0 = Vector::Constant(1, -0.5);
  scene.T = 1;
  for (const Method method : {Method::automatic, Method::march, Method::euler, Method::events}) {
    Options options = options_for(method, J);
    options.trace = true;
    options.states = StateSelection::all;
    const Result r = run(scene, options);
    ASSERT_EQ(r.status, Status::solved) << to_string(method) << ": " << r.reason;
    EXPECT_EQ(r.x(0, 0), -0.5) << to_string(method);
    const RowMatrix w = slack(scene, r);
    EXPECT_GE(w.minCoeff(), -1e-12) << to_string(method);
    EXPECT_LE(r.y.cwiseProduct(w).maxCoeff(), 1e-9) << to_string(method);
  }
}

TEST(Status, SourcesThatStopBeingFinite) {
  for (const bool in_f : {true, false}) {
    Scene scene = some_scene();
    TimeFunction& source = in_f ? scene.f : scene.g;
    source = [inner = source](double t, Eigen::Ref<Vector> v) {
      inner(t, v);
      if (t > 0.5) v[0] = std::numeric_limits<double>::quiet_NaN();
    };
    for (const Method method : {Method::multigrid, Method::contour, Method::march, Method::euler}) {
      const Result result = run(scene, options_for(method, J));
      EXPECT_EQ(result.status, Status::nonfinite) << to_string(method) << (in_f ? " f" : " g");
      EXPECT_FALSE(result.reason.empty());
    }
  }
}

TEST(Status, IterationsThatRunOut) {
  Options options = options_for(Method::contour, J);
  options.max_iterations = 2;
  const Result result = run(some_scene(), options);
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_FALSE(result.reason.empty());
  EXPECT_LE(result.iterations, 2);
}

TEST(Solve, RejectsBadOptions) {
  const Scene scene = some_scene();
  const auto rejects = [&](const std::string& what, auto change) {
    Options options = options_for(Method::march, J);
    change(options);
    EXPECT_THROW(run(scene, options), Error) << what;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  rejects("steps", [](Options& o) { o.steps = -1; });
  rejects("iteration_tolerance", [](Options& o) { o.iteration_tolerance = 0; });
  rejects("iteration_tolerance", [nan](Options& o) { o.iteration_tolerance = nan; });
  rejects("max_iterations", [](Options& o) { o.max_iterations = 0; });
  rejects("components", [](Options& o) { o.states = StateSelection::list, o.components = {0, 5}; });
  rejects("components", [](Options& o) { o.states = StateSelection::list, o.components = {-1}; });

  Scene bad = scene;
  bad.T = -1;
  EXPECT_THROW(run(bad, {}), Error);
  EXPECT_THROW(make_cpu_backend(-1), Error);
  EXPECT_THROW(method_from_string("contours"), Error);
  for (const Method method :
       {Method::automatic, Method::multigrid, Method::contour, Method::contour_literal, Method::march, Method::euler})
    EXPECT_EQ(method_from_string(to_string(method)), method);
}

}  // namespace
}  // namespace bromwich
