// The a-priori criterion of the functional iteration, and its windows in time.

#include "core/iteration/forecast.hpp"

#include "catalogue/catalogue.hpp"
#include "core/iteration/windows.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/kernel.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich {
namespace {

Scene scalar(double a, double N, double T) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{a}}, Matrix{{1}}, Matrix{{N}}};
  scene.M = Matrix{{1}};
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = std::sin(3 * t) - 0.5; };
  scene.x0 = Vector{{0}};
  scene.T = T;
  return scene;
}

Forecast of(const Scene& scene, Index J, double tolerance = 1e-12) {
  const double h = scene.T / double(J);
  const LagTable table = lag_table(dense_recurrence(get<DenseDynamics>(scene.dynamics), Rule::exponential, h), J);
  return forecast(scene.M, table, h, tolerance);
}

// K = N e^{at}, L = 1: khat(s) -> N/(s - a) as h -> 0, so s1 = N + a.
TEST(Forecast, OfAScalarKernelIsKnown) {
  const Forecast f = of(scalar(-1, 4, 10), 10000);
  EXPECT_NEAR(f.growth_rate, 3, 0.02);
  EXPECT_NEAR(f.longest_window(1e-12), std::log(1e-12 / epsilon) / 3, 0.05);
  EXPECT_EQ(of(scalar(-1, 0.5, 10), 1000).growth_rate, 0);  // khat(0) = 1/2
  EXPECT_EQ(of(scalar(-1, 0.5, 10), 1000).longest_window(1e-12), INFINITY);
}

// The statement "convergent for any step" is false here: W_0 = 10 phi2(-1) = 3.7.
TEST(Forecast, RefusesTheTwoCycle) {
  const Scene scene = scalar(-1, 10, 4);
  EXPECT_GE(of(scene, 4).kappa0, 1);
  EXPECT_EQ(of(scene, 4).longest_window(1e-12), 0);
  EXPECT_EQ(of(scene, 4).sweeps, INFINITY);
  EXPECT_NE(run(scene, Method::contour, 4).status, Status::solved);
  const Result r = run(scene, Method::automatic, 4);
  EXPECT_EQ(r.status, Status::solved);
  EXPECT_EQ(r.method, Method::march);
}

TEST(Forecast, SingularPrincipalSubmatricesHaveNoLipschitzConstant) {
  Scene scene = make_scene("dlcp-small");
  EXPECT_EQ(of(scene, 100).lipschitz, INFINITY);
  EXPECT_EQ(of(scene, 100).longest_window(1e-12), 0);
}

TEST(Forecast, BoundsTheSweepsOfSignorini) {
  const Scene scene = make_scene("signorini");
  const auto backend = make_cpu_backend(1);
  const double h = scene.T / 400;
  const LagTable table = contour_lag_table(*backend, scene.dynamics, *contour_parameters(0), h, 400);
  const Forecast f = forecast(scene.M, table, h, 1e-12);
  const Result r = run(scene, Method::contour, 400);
  EXPECT_GE(f.sweeps, double(r.iterations) - 2);  // the first sweep has no kernel, the last only confirms
  EXPECT_LE(f.sweeps, 2 * double(r.iterations));
}

// Over T = 60 the changes of the sweeps would first grow by e^{s1 T} = e^{180}: the plain iteration cannot reach its
// tolerance. Windows of a few time units can, and they give the solution of marching.
TEST(Windows, CarryTheIterationOverLongHorizons) {
  const Scene scene = scalar(-1, 4, 60);
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, 1500);
  const Index steps = iteration_window(p, 1e-12);
  EXPECT_LT(steps, 100);
  EXPECT_GT(steps, 10);
  const Result r = run(scene, Method::contour, 1500);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.kernel.find("windows in time"), std::string::npos) << r.kernel;
  EXPECT_LE(distance(r.y, run(scene, Method::march, 1500).y), same_problem);
}

TEST(Windows, OfAnyLengthGiveOneSolution) {
  Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, 100);
  const RowMatrix whole = run(scene, Method::march, 100).y;
  for (const Index steps : {1, 7, 50, 99, 100}) {
    Result r;
    solve_in_windows(p, steps, {}, r);
    ASSERT_EQ(r.status, Status::solved) << steps << ": " << r.reason;
    EXPECT_LE(distance(r.y, whole), same_problem) << steps;
  }
}

}  // namespace
}  // namespace bromwich
