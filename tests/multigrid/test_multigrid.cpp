// Multigrid in time: the solution of the march, speed of convergence, and cases where it cannot converge.

#include "core/multigrid/multigrid.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/multigrid/smoothing.hpp"
#include "core/multigrid/time_levels.hpp"
#include "tests/support/expanding.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <complex>

namespace bromwich {
namespace {

Scene signorini(double Q) { return make_scene("signorini", {{"Q", Q}}); }

/// Two methods for the same discrete problem: the iteration leaves 1e-12, a few times that if its kernel is a fit.
constexpr double same_solution = 1e-10;

void expect_march(const Scene& scene, Index J) {
  const Result result = run(scene, Method::multigrid, J);
  const std::string name = scene.name + ", " + std::to_string(scene.constraints()) + " constraints, " +
                           std::to_string(J) + " steps: " + result.reason;
  ASSERT_EQ(result.status, Status::solved) << name;
  EXPECT_EQ(result.method, Method::multigrid);
  EXPECT_LE(distance(result.y, solved_y(scene, Method::march, J)), same_solution) << name;
}

// Numbers of steps that can be halved often, once, and not at all.
TEST(Multigrid, EqualsMarchingOnSignorini) {
  for (const double Q : {1., 3., 15., 40.})
    for (const Index J : {1, 2, 7, 33, 64, 100, 250, 512}) expect_march(signorini(Q), J);
}

// Six grids: the nested start skips one.
TEST(Multigrid, EqualsMarchingOnManyGrids) { expect_march(signorini(127), 4096); }

// Only x0 and g, on rectangles.
TEST(Multigrid, EqualsMarchingWithoutASource) {
  for (const auto& [along, across] : {std::pair<Index, Index>{15, 15}, {15, 60}, {31, 9}}) {
    Scene scene;
    scene.dynamics = reference::signorini_dynamics(along, across, 0.01);
    scene.M = Tridiagonal{Vector::Constant(along, -1), Vector::Constant(along, 4), Vector::Constant(along, -1)};
    scene.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(std::sin(3 * t) - 0.5); };
    scene.x0 = Vector::LinSpaced(along * across, 0, 1);
    scene.T = 3;
    expect_march(scene, 256);
    Options options = options_for(Method::multigrid, 256);
    options.tuning.convolution = ConvolutionChoice::fft;
    EXPECT_LE(distance(run(scene, options).y, solved_y(scene, Method::march, 256)), same_solution) << across;
  }
}

TEST(Multigrid, EqualsMarchingOnDenseScenes) {
  for (const auto spectrum :
       {oracle::SpectrumKind::real_negative, oracle::SpectrumKind::sector, oracle::SpectrumKind::imaginary})
    for (const auto matrix :
         {oracle::MatrixKind::dominant, oracle::MatrixKind::positive_definite, oracle::MatrixKind::m_matrix})
      for (const Index J : {64, 200}) expect_march(oracle::random_scene(5, 6, 4, spectrum, matrix), J);
}

TEST(Multigrid, EqualsMarchingWithTabulatedWeights) {
  Options options = options_for(Method::multigrid, 256);
  options.tuning.convolution = ConvolutionChoice::fft;
  for (const Scene& scene :
       {signorini(15), oracle::random_scene(6, 5, 3, oracle::SpectrumKind::sector, oracle::MatrixKind::dominant)}) {
    const Result result = run(scene, options);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    EXPECT_LE(distance(result.y, solved_y(scene, Method::march, 256)), same_solution) << scene.name;
  }
}

// More than 512 states: a sparse scene uses lag weights.
TEST(Multigrid, EqualsMarchingOnSparseScenes) {
  Scene scene = signorini(24);
  const SparseDynamics sparse = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  scene.dynamics = sparse;
  scene.f_entry = SourceEntry::through_F;
  scene.F = sparse.B;
  expect_march(scene, 96);
}

// ---- how fast ----

struct Cycles {
  double contraction = 0;  ///< the largest of the cycles
  Index cycles = 0, sweeps = 0;
};

Cycles cycles_of(const Scene& scene, Index J) {
  const Result result = run(scene, Method::multigrid, J);
  EXPECT_EQ(result.status, Status::solved) << result.reason;
  EXPECT_EQ(result.cycles, Index(result.history.size()));
  Cycles found{0, result.cycles, result.iterations};
  for (std::size_t i = 1; i < result.history.size(); ++i)
    if (result.history[i] > 1e-12)  // below, rounding
      found.contraction = std::max(found.contraction, result.history[i] / result.history[i - 1]);
  return found;
}

TEST(Multigrid, ContractsTenfoldPerCycle) {
  for (const double Q : {31., 63., 255.})
    for (const Index J : {256, 1024}) {
      if (Q == 255 && J == 1024) continue;  // takes long
      const Cycles found = cycles_of(signorini(Q), J);
      EXPECT_LE(found.contraction, 0.1) << Q << ' ' << J;
      EXPECT_GT(found.contraction, 0) << Q << ' ' << J;
      EXPECT_LE(found.cycles, 6) << Q << ' ' << J;
      EXPECT_LE(2 * found.sweeps, run(signorini(Q), Method::contour, J).iterations) << Q << ' ' << J;
    }
}

// h c/dx^2 = 0.5: half of M comes from the weight W_0 on the coarsest grid, and only the shift smooths.
TEST(Multigrid, ContractsOnCoarseGridsToo) {
  const Cycles found = cycles_of(signorini(127), 64);
  EXPECT_LE(found.contraction, 0.1);
  EXPECT_LE(found.cycles, 10);
}

// ---- what a cycle does ----

TEST(Multigrid, ACycleLeavesTheSolutionAsItIs) {
  for (const Scene& scene :
       {signorini(31), oracle::random_scene(8, 4, 3, oracle::SpectrumKind::sector, oracle::MatrixKind::dominant)}) {
    const auto backend = make_cpu_backend(1);
    const DiscreteProblem p = discretise(scene, *backend, 128);
    const Options options;
    const auto op = make_time_operator(p);
    TimeLevels levels = time_levels(*op, options);
    ASSERT_GE(levels.size(), 3u);
    const RowMatrix solution = solved_y(scene, Method::march, 128);
    backend->upload(solution, *levels[0].y);
    Result result;
    Multigrid multigrid(*backend, options, levels);
    multigrid.begin(options, result);
    multigrid.cycle(0);
    RowMatrix after;
    backend->download(*levels[0].y, after);
    EXPECT_LE(distance(after, solution), same_problem) << scene.name;
    EXPECT_EQ(result.iterations, levels[0].sweeps + 1);
  }
}

TEST(Multigrid, CoarseWeightsAreThoseOfTheCoarseGrid) {
  const DenseDynamics d{Matrix{{-1, 3}, {-3, -1}}, Matrix{{1, 0}, {2, 1}}, Matrix{{1, -1}, {0, 2}}};
  const LagTable fine = lag_table(dense_recurrence(d, Rule::exponential, 0.05), 40);
  const LagTable exact = lag_table(dense_recurrence(d, Rule::exponential, 0.1), 20), found = coarsen(fine);
  EXPECT_EQ(found.outputs, 2);
  EXPECT_EQ(found.inputs, 2);
  // Weights of size 0.1 from e^{hA} by scaling and squaring. The last lag of W acts on nothing.
  EXPECT_LE(distance(found.W.topRows(20), exact.W.topRows(20)), 1e-15);
  EXPECT_LE(distance(found.S, exact.S), 1e-15);
}

Tridiagonal toeplitz(Index n, double a, double b) {
  return {Vector::Constant(n, b), Vector::Constant(n, a), Vector::Constant(n, b)};
}

ModalRecurrence memoryless(Index n, double w) {
  ModalRecurrence r;
  r.decay = r.output = r.start = RowMatrix::Zero(0, n);
  r.w0 = Vector::Constant(n, w);
  r.w1 = r.s1 = Vector::Zero(n);
  return r;
}

std::optional<Smoothing> smoothing_of(const LcpMatrix& M, const ModalRecurrence& r, Index steps, double useful = 0) {
  return best_smoothing(SweptMatrix(M, r.basis()), r, steps, useful);
}

TEST(Smoothing, FindsTheShiftThatCancelsAKernelWithoutMemory) {
  const std::optional<Smoothing> found = smoothing_of(toeplitz(20, 4, -1), memoryless(20, -1.2), 200);
  ASSERT_TRUE(found);
  // Shifts are tried in steps of at most 8/120: |D + 1.2| <= 1/30, over eigenvalues of M + D of at least 0.7.
  EXPECT_NEAR(found->shift, -1.2, 1. / 30);
  EXPECT_LE(found->factor(), 0.05);
}

// Σ_d W_d = w + C / (1 - E): with w = 0, C = -0.5, E = 0.75 that is -2, and the eigenvalues of M begin near 2.
TEST(Smoothing, SumsTheWeightsAtFrequencyZero) {
  ModalRecurrence r = memoryless(20, 0);
  r.decay = RowMatrix::Constant(1, 20, 0.75);
  r.output = RowMatrix::Constant(1, 20, -0.5);
  const std::optional<Smoothing> found = smoothing_of(toeplitz(20, 4, -1), r, 200);
  ASSERT_TRUE(found);
  const double smallest = 4 - 2 * std::cos(M_PI / 21), D = found->shift;
  EXPECT_NEAR(found->smooth_factor, std::abs(-2 - D) / (smallest + D), 1e-12);
}

// Each further frequency bound is an octave lower and includes the earlier ones. The symbol C e^{-i omega} /
// (1 - E e^{-i omega}) has the absolute value |C| / |1 - E e^{-i omega}|, largest at the lowest frequency; D is about 0
// for E near 1.
TEST(Smoothing, LooksAtWhatCoarserGridsCannotSee) {
  ModalRecurrence r = memoryless(20, 0);
  r.decay = RowMatrix::Constant(1, 20, 0.99);
  r.output = RowMatrix::Constant(1, 20, -0.02);
  const std::optional<Smoothing> found = smoothing_of(toeplitz(20, 4, -1), r, 4096, 0.2);
  ASSERT_TRUE(found);
  const double smallest = 4 - 2 * std::cos(M_PI / 21), D = found->shift;
  ASSERT_GE(found->unseen.size(), 3u);
  for (std::size_t k = 0; k < found->unseen.size(); ++k) {
    const std::complex<double> z = std::polar(1., M_PI / std::exp2(double(k) + 2));
    const double lowest = std::abs(D + 0.02 / (z - 0.99)) / (smallest + D);
    EXPECT_GE(found->unseen[k], lowest * (1 - 1e-12)) << k;
    EXPECT_LE(found->unseen[k], 1.01 * lowest) << k;  // D is not exactly 0
    if (k > 0) {
      EXPECT_GE(found->unseen[k], found->unseen[k - 1]);
    }
    EXPECT_EQ(k + 1 == found->unseen.size(), found->unseen[k] >= 0.2) << "as long as it is useful";
  }
  EXPECT_EQ(smoothing_of(toeplitz(20, 4, -1), r, 4096)->unseen.size(), 1u);
}

TEST(Smoothing, KeepsMPlusDAnMMatrix) {
  const std::optional<Smoothing> found = smoothing_of(toeplitz(20, 4, -1), memoryless(20, -5), 200);
  ASSERT_TRUE(found);
  EXPECT_GT(found->shift, -(4 - 2 * std::cos(M_PI / 21)));
  EXPECT_FALSE(smoothing_of(toeplitz(20, 4, 1), memoryless(20, -1), 200)) << "not an M-matrix";
  EXPECT_FALSE(smoothing_of(toeplitz(20, 1, -1), memoryless(20, -1), 200)) << "not definite";
  EXPECT_FALSE(smoothing_of(LcpMatrix(Matrix(Matrix::Identity(3, 3))), memoryless(3, -1), 200)) << "dense";
  Tridiagonal uneven = toeplitz(20, 4, -1);
  uneven.upper[7] = -0.9;
  EXPECT_FALSE(smoothing_of(uneven, memoryless(20, -1), 200));
}

// ---- the error that it estimates ----

double error_at_coarse_points(const Scene& scene, const RowMatrix& y, Index J) {
  const RowMatrix exact = solved_y(scene, Method::march, 16 * J);
  double largest = 0;
  for (Index i = 0; i <= J / 2; ++i)
    largest = std::max(largest, (y.row(2 * i) - exact.row(32 * i)).cwiseAbs().maxCoeff());
  return largest;
}

TEST(Multigrid, EstimatesTheErrorOfTheDiscretisation) {
  for (const double Q : {15., 31.})
    for (const Index J : {256, 512}) {
      const Result result = run(signorini(Q), Method::multigrid, J);
      ASSERT_TRUE(result.error_estimate) << Q << ' ' << J;
      const double error = error_at_coarse_points(signorini(Q), result.y, J);
      // Moving ends of the contact set make the ratio of two differences vary by a factor of two around 4.
      EXPECT_GE(*result.error_estimate, 0.4 * error) << Q << ' ' << J;
      EXPECT_LE(*result.error_estimate, 5 * error) << Q << ' ' << J;
    }
}

TEST(Multigrid, EstimatesNothingFromFewerThanThreeGrids) {
  EXPECT_FALSE(run(signorini(7), Method::multigrid, 34).error_estimate);
  EXPECT_FALSE(run(signorini(7), Method::march, 64).error_estimate);
}

// ---- where it cannot work, or has to stop ----

TEST(Multigrid, TakesCyclesInWWhereSweepsCannotContract) {
  // Cycles in y have no coarser grid that contracts; those in w solve the steps of implicit Euler.
  const Result coarse = run(expanding(), Method::multigrid, 8);
  ASSERT_EQ(coarse.status, Status::solved) << coarse.reason;
  EXPECT_EQ(coarse.form, "dual");
  const Result steps = run(expanding(), Method::euler, 8);
  EXPECT_LE(distance(coarse.y.bottomRows(8), steps.y.bottomRows(8)), 1e-10 * std::max(1.0, steps.y.maxCoeff()));
  // L ||W_0|| = 10/320 at h = 1/160, and 10/160 on the coarser grid, the coarsest.
  EXPECT_GT(run(expanding(), Method::multigrid, 1280).cycles, 0);
  expect_march(expanding(), 1280);
}

TEST(Multigrid, IsTheIterationWhereStepsCannotBeHalved) {
  const Result odd = run(signorini(15), Method::multigrid, 401);
  ASSERT_EQ(odd.status, Status::solved) << odd.reason;
  EXPECT_EQ(odd.cycles, 0);
  EXPECT_EQ(odd.iterations, run(signorini(15), Method::contour, 401).iterations);
  EXPECT_FALSE(odd.error_estimate);
}

TEST(Multigrid, StopsWhenAsked) {
  Options options = options_for(Method::multigrid, 256);
  int asked = 0;
  options.interrupted = [&] { return ++asked > 1; };
  const Result result = run(signorini(15), options);
  EXPECT_EQ(result.status, Status::interrupted);
  EXPECT_TRUE(result.y.array().isNaN().all());
}

TEST(Multigrid, SweepsThatRunOut) {
  Options options = options_for(Method::multigrid, 256);
  options.max_iterations = 1;
  const Result result = run(signorini(31), options);
  EXPECT_EQ(result.status, Status::tolerance_not_met);
  EXPECT_EQ(result.cycles, 1);
  EXPECT_TRUE(result.y.allFinite());
}

TEST(Multigrid, ALooserToleranceTakesFewerCycles) {
  Options options = options_for(Method::multigrid, 256);
  options.iteration_tolerance = 1e-5;
  const Result loose = run(signorini(63), options), tight = run(signorini(63), Method::multigrid, 256);
  ASSERT_EQ(loose.status, Status::solved) << loose.reason;
  EXPECT_LT(loose.cycles, tight.cycles);
  EXPECT_LE((loose.y - tight.y).cwiseAbs().maxCoeff(), 1e-5 * std::max(1.0, tight.y.maxCoeff()));
}

TEST(Multigrid, TakesCyclesInWWhereYWouldRing) {
  Scene scene = expanding();
  scene.M = Matrix{{0}};
  const Result result = run(scene, Method::multigrid, 64);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  EXPECT_EQ(result.form, "dual");
  const Result steps = run(scene, Method::euler, 64);
  ASSERT_EQ(steps.status, Status::solved) << steps.reason;
  EXPECT_LE(distance(result.y.bottomRows(64), steps.y.bottomRows(64)), 1e-9 * std::max(1.0, steps.y.maxCoeff()));
}

}  // namespace
}  // namespace bromwich
