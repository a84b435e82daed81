// Method shooting on initial values: the discrete solution of method march.

#include "core/scan/stage_chunks.hpp"

#include "bromwich/catalogue.hpp"
#include "bromwich/solver.hpp"
#include "core/scan/coarse_start.hpp"
#include "core/scan/held_products.hpp"
#include "core/solve/engines.hpp"

#include "bromwich/derivative.hpp"
#include "tests/support/random_scenes.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <string>
#include <vector>

namespace bromwich {
namespace {

// Both take the same steps. Their states differ by the rounding at which chunks settle, 64 eps of the state for a step,
// which the complementarity problems of the steps amplify by a condition of at most 1e3 in most scenes.
constexpr double same_steps = 1e-11;

double apart(const RowMatrix& a, const RowMatrix& b) {
  const double size = std::max(a.cwiseAbs().maxCoeff(), b.cwiseAbs().maxCoeff());
  return size > 0 ? distance(a, b) / size : distance(a, b);
}

Result shot(const Scene& scene, Index chunks, Index steps = 0, int threads = 2, bool coarse = true) {
  InnerOptions options{options_for(Method::shooting, steps)};
  options.states = StateSelection::all;
  options.chunks = chunks;
  options.coarse_start = coarse;
  return solve_valid(scene, *make_cpu_backend(threads), options);
}

Result marched_on(const Scene& scene, Index steps = 0) {
  Options options = options_for(Method::march, steps);
  options.states = StateSelection::all;
  return solve(scene, *make_cpu_backend(1), options);
}

void expect_the_march(const Scene& scene, const Result& r, Index steps, const std::string& name) {
  const Result march = marched_on(scene, steps);
  ASSERT_EQ(r.status, march.status) << name << ": " << r.reason << " | " << march.reason;
  EXPECT_EQ(r.method, Method::shooting);
  if (r.status != Status::solved) return;
  EXPECT_LE(apart(r.y, march.y), same_steps) << name;
  EXPECT_LE(apart(r.x, march.x), same_steps) << name;
  EXPECT_EQ(r.certificate.has_value(), march.certificate.has_value()) << name;
}

/// m inductors and capacitors behind a diode, driven by a sine or by pulses: `M` is the slope of the diode.
Scene ladder(double M, bool pulses) {
  Scene scene;
  Matrix A(3, 3), B(3, 2), N(2, 3);
  A << -3, 0, 0, 0, -0.2, 0, 0, 0, -0.5;
  B << -1, 0, 1, -1, 0, 1;
  N << -1, 1, 0, 0, -1, 1;
  scene.dynamics = DenseDynamics{A, B, N};
  scene.M = Matrix(M * Matrix::Identity(2, 2));
  scene.x0 = Vector::Zero(3);
  scene.T = 40;
  scene.default_steps = 2000;
  scene.f = [pulses](double t, Eigen::Ref<Vector> v) {
    v.setZero();
    v[0] = pulses ? (std::fmod(t, 1.7) < 0.6 ? 4 : -1) : 3 * std::sin(2 * t);
  };
  for (int k = 0; pulses && k * 1.7 < 40; ++k)
    for (const double t : {k * 1.7, k * 1.7 + 0.6})
      if (t > 0 && t < 40) scene.breakpoints.push_back(t);
  scene.breakpoints_are_all = true;
  return scene;
}

TEST(MethodShooting, IsMarchForAnyNumberOfChunks) {
  for (const double M : {0.5, 0.0})
    for (const bool pulses : {false, true}) {
      const Scene scene = ladder(M, pulses);
      for (const Index chunks : {1, 2, 7, 64, 500, 2000}) {
        const std::string name =
            "M " + std::to_string(M) + (pulses ? ", pulses, " : ", sine, ") + std::to_string(chunks);
        const Result r = shot(scene, chunks);
        expect_the_march(scene, r, 0, name);
        EXPECT_NE(r.kernel.find(std::to_string(chunks) + " chunks"), std::string::npos) << r.kernel;
        // Perturbations decay by e^{-0.2 t}: over a few chunks where these are long.
        EXPECT_LE(r.iterations, chunks <= 64 ? 8 : 40) << name;
      }
      expect_the_march(scene, shot(scene, 32, 0, 2, false), 0, "all chunks begin at x0");
    }
}

TEST(MethodShooting, IsMarchOnRandomScenes) {
  Index solved = 0, differ = 0;
  std::string found;
  for (std::uint32_t seed = 0; seed < 330; ++seed) {
    const oracle::RandomScene random = oracle::any_scene(seed);
    const Result march = marched_on(random.scene, random.steps);
    const Result r = shot(random.scene, 1 + seed % 16, random.steps);
    const bool same =
        r.status == march.status &&
        (r.status != Status::solved || (apart(r.y, march.y) <= same_steps && apart(r.x, march.x) <= same_steps));
    solved += r.status == Status::solved;
    differ += !same;
    if (!same) found += " " + std::to_string(seed) + " (" + to_string(random.family) + ")";
  }
  EXPECT_GE(solved, 200);
  // Of least norm, and with nearly singular steps: y has fewer digits there. In 1e4 scenes 18 (bench/chunks.cpp).
  EXPECT_LE(differ, 3) << found;
}

TEST(MethodShooting, ThreadsDoNotChangeTheRows) {
  const Scene scene = ladder(0, true);
  const Result one = shot(scene, 16, 0, 1), two = shot(scene, 16, 0, 2);
  EXPECT_EQ(distance(one.y, two.y), 0);
  EXPECT_EQ(distance(one.x, two.x), 0);
}

// A ball on the ground: every impact multiplies perturbations.
TEST(MethodShooting, ImpactsEndInTurnWithTheMarch) {
  Scene scene;
  const Matrix A{{0, 1}, {-1, 0}}, B{{0}, {1}}, N{{1, 0}};
  scene.dynamics = DenseDynamics{A, B, N};
  scene.M = Matrix{{1e-5}};
  scene.x0 = Vector{{1, 0}};
  scene.f = [](double, Eigen::Ref<Vector> v) { v << 0, -1; };
  scene.T = 60;
  scene.default_steps = 6000;
  const Result r = shot(scene, 128);
  expect_the_march(scene, r, 0, "impacts");
  EXPECT_LT(r.iterations, 64);
}

TEST(MethodShooting, StopsWhereMarchStops) {
  // w = x - t + M y with M < 0, from x = 1: no solution from t = 1 on.
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(1, 1), Matrix::Zero(1, 1), Matrix::Ones(1, 1)};
  scene.M = Matrix::Zero(1, 1);
  scene.x0 = Vector::Ones(1);
  scene.g = [](double t, Eigen::Ref<Vector> v) { v[0] = -t; };
  scene.T = 2;
  scene.default_steps = 100;
  const Result r = shot(scene, 8), march = marched_on(scene);
  EXPECT_EQ(r.status, march.status);
  EXPECT_EQ(r.reason, march.reason);
  EXPECT_EQ(r.infeasible_at, march.infeasible_at);
}

TEST(MethodShooting, KeepsItsPlaceInASolver) {
  Scene scene = ladder(0.5, false);
  const auto backend = make_cpu_backend(2);
  Options options = options_for(Method::shooting);
  options.states = StateSelection::all;
  Solver solver(scene, *backend, options);
  solver.solve();
  scene.x0 = Vector{{1, -2, 0.5}};
  solver.set_x0(scene.x0);
  expect_the_march(scene, solver.solve(), 0, "another x0");
}

TEST(MethodShooting, ReachesATolerance) {
  Options options = options_for(Method::shooting);
  options.tolerance = 1e-5;
  options.states = StateSelection::all;
  const Scene scene = ladder(0.5, false);
  const Result r = solve(scene, *make_cpu_backend(2), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_TRUE(r.error_estimate.has_value());
  EXPECT_LE(*r.error_estimate, 1e-5);
  // With four times the steps the error, of order 2, is a sixteenth.
  const Result fine = marched_on(scene, 4 * r.steps);
  RowMatrix at_points(r.steps + 1, 3);
  for (Index j = 0; j <= r.steps; ++j) at_points.row(j) = fine.x.row(4 * j);
  EXPECT_LE(apart(r.x, at_points), 1.1e-5);
}

TEST(MethodShooting, HasDerivativesAndValuesBetweenSteps) {
  Scene scene = ladder(0.5, false);
  scene.x0 = Vector{{1, -2, 0.5}};  // from rest y(0) = w(0) = 0
  const Result r = shot(scene, 16), march = marched_on(scene);
  const SolutionDerivative of_chunks(scene, r), of_march(scene, march);
  SolutionChange at_end;
  at_end.x = RowMatrix::Zero(march.x.rows(), 3);
  at_end.x.bottomRows(1).setOnes();
  EXPECT_LE(distance(of_chunks.vjp(at_end).x0, of_march.vjp(at_end).x0), same_steps);
  const auto backend = make_cpu_backend(1);
  const std::vector<double> times{0.013, 7.7777, 39.99};
  EXPECT_LE(distance(at_times(scene, *backend, r, times).x, at_times(scene, *backend, march, times).x), same_steps);
}

TEST(MethodShooting, OtherDynamicsAreRefused) {
  const Scene scene = make_scene("signorini", {{"Q", 15}});
  const Result r = solve(scene, *make_cpu_backend(1), options_for(Method::shooting, 64));
  EXPECT_EQ(r.status, Status::unsupported);
  EXPECT_EQ(r.reason, "method shooting: the dynamics are not dense; use method march or euler");
}

// ---- parts ----

TEST(HeldProduct, IsTheProductOfItsSteps) {
  const Matrix P{{0.5, 0.2}, {-0.1, 0.9}}, Q{{1.1, 0}, {0.3, -0.4}};
  HeldProduct product;
  product.begin(2);
  Matrix expected = Matrix::Identity(2, 2);
  const auto take = [&](const Matrix& step, std::uint64_t key, int times) {
    for (int k = 0; k < times; ++k) {
      product.step({key}, [&] { return step; });
      expected = step * expected;
    }
  };
  take(P, 1, 13), take(Q, 2, 1), take(P, 1, 7);
  // 21 products of matrices of norm below 1.2.
  EXPECT_LE((product.product() - expected).cwiseAbs().maxCoeff(), 1e-13);
  const std::uint64_t sets = product.sets();
  product.begin(2);
  take(P, 1, 14), take(Q, 2, 1), take(P, 1, 6);
  EXPECT_NE(product.sets(), sets);
}

TEST(HeldSolution, SolvesOnTheSet) {
  const Matrix W{{2, -1, 0.5}, {0.3, 1, 4}, {1, 0, 3}};
  const Matrix Z = held_solution(W, Vector{{1, 0, 2}});
  const Vector q{{-1, 5, -2}}, y = Z * q;
  EXPECT_EQ(y[1], 0);
  const Vector w = W * y + q;
  EXPECT_NEAR(w[0], 0, 1e-14);
  EXPECT_NEAR(w[2], 0, 1e-14);
  // A constraint that is there twice: of least norm, which shares y.
  const Vector twice = held_solution(Matrix::Constant(2, 2, 4), Vector{{1, 1}}) * Vector{{-8, -8}};
  EXPECT_NEAR(twice[0], 1, 1e-14);
  EXPECT_NEAR(twice[1], 1, 1e-14);
}

TEST(CoarseStates, FollowTheScene) {
  // x' = -x + t, x(0) = 1: x = t - 1 + 2 e^{-t}. Implicit Euler with 100 steps of 0.05 errs by less than 0.05.
  Dynamics dynamics = DenseDynamics{-Matrix::Identity(1, 1), Matrix::Ones(1, 1), Matrix::Ones(1, 1)};
  const LcpMatrix M = Matrix(Matrix::Identity(1, 1));
  const HostThreads alone;
  ScanPlan plan;
  plan.threads = &alone;
  const std::vector<Index> rows{0, 250, 500, 1000};
  const CoarseStates s = coarse_states(
      plan, rows,
      [&] {
        CoarseInput in{&dynamics,
                       &M,
                       LcpClass::P,
                       SparseMatrix(Matrix(Matrix::Ones(1, 1)).sparseView()),
                       Vector::Ones(1),
                       Vector::LinSpaced(1001, 0, 5),
                       RowMatrix::Constant(1001, 1, 10),
                       {}};
        in.phi = in.t;
        return in;
      },
      Vector::Ones(1), 1);
  EXPECT_EQ(s.x[0][0], 1);
  for (const std::size_t c : {1u, 2u}) {
    const double t = 5 * double(rows[c]) / 1000;
    EXPECT_NEAR(s.x[c][0], t - 1 + 2 * std::exp(-t), 0.05);
    EXPECT_EQ(s.y[c][0], 0);
  }
}

}  // namespace
}  // namespace bromwich
