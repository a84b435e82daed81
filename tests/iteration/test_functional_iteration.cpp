// The functional iteration: number of sweeps, cases without convergence, memory.

#include "catalogue/catalogue.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "tests/support/expanding.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

TEST(FunctionalIteration, ReachesThePapersToleranceInSixteenSweeps) {
  const Scene scene = make_scene("signorini", {{"Q", 39}});
  Options options = options_for(Method::contour, 400);
  const RowMatrix converged = run(scene, options).y;
  options.max_iterations = 16;
  const Result early = run(scene, options);
  const double h = 0.01, dx = 1.0 / 40;  // (4.8): min(h, dx^2)/50
  EXPECT_LE(distance(early.y, converged), std::fmin(h, dx * dx) / 50);
  EXPECT_EQ(early.status, Status::tolerance_not_met);
}

TEST(FunctionalIteration, SweepsDoNotDependOnTheStep) {
  // Superlinear convergence of a Volterra iteration depends on T and K, not on h: the counts of the paper's Fig. 4.6.
  const Scene scene = make_scene("signorini", {{"Q", 39}});
  const Index coarse = run(scene, options_for(Method::contour, 200)).iterations;
  const Index fine = run(scene, options_for(Method::contour, 1600)).iterations;
  EXPECT_LE(std::abs(coarse - fine), 4) << coarse << " and " << fine;
}

TEST(FunctionalIteration, EqualsMarchingOnALargeGrid) {
  const Scene scene = make_scene("signorini", {{"Q", 511}});
  Options options = options_for(Method::march, 100);
  options.tuning.recurrence = RecurrenceChoice::modal;
  const Result march = run(scene, options), contour = run(scene, options_for(Method::contour, 100));
  ASSERT_EQ(march.status, Status::solved);
  ASSERT_EQ(contour.status, Status::solved);
  // A change of 1e-12 leaves 1e-12/(1 - rate); weights are good to 1e-13 of their sum (below 2) in every lag.
  EXPECT_LE(distance(march.y, contour.y), 1e-9);
}

TEST(FunctionalIteration, DoesNotConvergeWhereItMustNot) {
  const Result contour = run(expanding(), options_for(Method::contour, 8));
  EXPECT_EQ(contour.status, Status::tolerance_not_met);
  EXPECT_FALSE(contour.reason.empty());
  const Result march = run(expanding(), options_for(Method::march, 8));
  EXPECT_EQ(march.status, Status::solved);
  EXPECT_EQ(run(expanding(), options_for(Method::automatic, 8)).status, Status::solved);
  // With L ||W_0|| = 0.12 both agree.
  EXPECT_LE(distance(run(expanding(), options_for(Method::contour, 320)).y,
                     run(expanding(), options_for(Method::march, 320)).y),
            same_problem);
}

// M = tridiag(-1, 1, -1) is of no class. With q < 0, w >= 0 would need y_i > y_{i+1} > y_i: no y solves the problem at
// t = 0, which no sweep changes, and in which every solver is tried. It ends the iteration after the first one at most.
TEST(FunctionalIteration, AProblemAtZeroWithoutASolutionEndsIt) {
  constexpr Index n = 130;
  Scene scene;
  scene.name = "no class";
  scene.dynamics = DenseDynamics{Matrix(-Matrix::Identity(n, n)), Matrix(0.01 * Matrix::Identity(n, n)),
                                 Matrix(Matrix::Identity(n, n))};
  scene.M = Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 1), Vector::Constant(n, -1)};
  scene.x0 = Vector::Zero(n);
  scene.T = 1;
  scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(-0.2 - t); };
  const Result r = run(scene, options_for(Method::contour, 16));
  EXPECT_NE(r.status, Status::solved);
  EXPECT_LE(r.iterations, 1) << r.reason;
  EXPECT_NE(r.reason.find("t = 0"), std::string::npos) << r.reason;
}

// Transients of the iteration can be many orders above the solution: settled rows are judged by their own size.
TEST(FunctionalIteration, SurvivesLargeTransients) {
  for (const double omega : {5.0, 8.0, 10.0}) {
    Scene scene;
    scene.name = "oscillator";
    scene.dynamics = DenseDynamics{Matrix{{0, omega}, {-omega, 0}}, Matrix{{1}, {0}}, Matrix{{0, -omega}}};
    scene.M = Matrix{{1}};
    scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = std::sin(t) - 0.2; };
    scene.x0 = Vector{{1, 0}};
    scene.T = 10;
    const Result contour = run(scene, options_for(Method::contour, 2000));
    ASSERT_EQ(contour.status, Status::solved) << contour.reason;
    EXPECT_LE(distance(contour.y, run(scene, options_for(Method::march, 2000)).y), 1e-10) << omega;
  }
}

TEST(FunctionalIteration, HoldsAFewArraysOfJTimesN) {
  for (const Method method : {Method::contour, Method::march}) {
    const auto bytes = [&](double Q, Index J) {
      return double(run(make_scene("signorini", {{"Q", Q}}), options_for(method, J)).bytes);
    };
    // Space-time arrays of J n numbers: y, v, r, two in modes, the drive, f, g and y on the host, r of the plan; plus
    // parts independent of J (exponentials, transforms, M). Never J x states, which would be 39 arrays.
    EXPECT_LE(bytes(39, 4096), 8.0 * 11 * 39 * 4097 + 1e6);
    EXPECT_LE(bytes(39, 8192) - bytes(39, 4096), 8.0 * 11 * 39 * 4096);
  }
}

TEST(FunctionalIteration, ScanAndFftAgree) {
  for (const char* name : {"signorini", "dlcp-small", "bridge"}) {
    const Scene scene = make_scene(name);
    Options options = options_for(Method::contour, 600);
    options.tuning.convolution = ConvolutionChoice::scan;
    const Result scan = run(scene, options);
    options.tuning.convolution = ConvolutionChoice::fft;
    const Result fft = run(scene, options);
    ASSERT_EQ(scan.status, Status::solved) << name << ": " << scan.reason;
    ASSERT_EQ(fft.status, Status::solved) << name << ": " << fft.reason;
    // Two kernels, each good to 1e-13 of its largest weight in each of 600 lags, and two stopping points.
    EXPECT_LE(distance(scan.y, fft.y), 1e-9) << name;
  }
}

}  // namespace
}  // namespace bromwich
