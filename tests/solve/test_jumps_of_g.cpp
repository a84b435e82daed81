// Jumps of g, the source of the constraints, in sparse scenes and Kronecker sums: steps are divided there, as in dense
// scenes. The error of x is that against located events, which share no code with march.

#include "core/result/located.hpp"
#include "core/result/slack.hpp"
#include "tests/support/run.hpp"
#include "tests/support/trust.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

constexpr double tolerance = 1e-3;

Options for_states(Method method, Index few) {
  Options options = options_for(method);
  options.tolerance_x = tolerance;
  options.states = StateSelection::list;
  for (Index i = 0; i < few; ++i) options.components.push_back(i);
  return options;
}

// A state that follows y within 1e-3 of T, many times faster than steps, and jumps of g by the size of y: the row after
// a jump is right only where the layer behind it is resolved.
TEST(JumpsOfG, AreResolvedBesideFastStates) {
  oracle::SourceScene s;
  const Matrix A{{-1000, 0}, {0, -1}}, B{{1000}, {1}}, N{{1, 1}};
  const std::vector<double> jumps{0.2004, 0.3371, 0.7213};
  const auto level = [](double t) { return t < 0.2004 ? -1.0 : t < 0.3371 ? 1.0 : t < 0.7213 ? -2.0 : 0.5; };
  const TimeFunction g = [level](double t, Eigen::Ref<Vector> v) { v[0] = level(t); };
  s.scene.dynamics = DenseDynamics{A, B, N};
  s.scene.M = Matrix{{0.05}};
  s.scene.g = g;
  s.scene.breakpoints = jumps;
  s.scene.x0 = Vector::Zero(2);
  s.scene.T = 1;
  const Result truth = [&] {
    Options options = options_for(Method::events, 3200);
    options.states = StateSelection::all;
    return run(s.scene, options);
  }();
  ASSERT_EQ(truth.status, Status::solved) << truth.reason;
  const Result r = run(oracle::among_sparse_states(s.scene, 600), for_states(Method::march, 2));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  ASSERT_EQ(truth.steps % r.steps, 0);
  EXPECT_LE(r.steps, 1600);  // of first order it takes hundreds of thousands
  const Index stride = truth.steps / r.steps;
  for (Index j = 1; j <= r.steps; ++j)
    for (Index i = 0; i < 2; ++i)
      EXPECT_NEAR(r.x(j, i), truth.x(stride * j, i), tolerance * truth.x.col(i).cwiseAbs().maxCoeff()) << r.t[j];
}

// g jumps at points of the grid: rows of a march under a tolerance have y and w of one side, that of the value of g
// where x determines y.
TEST(JumpsOfG, RowsOfATolerancesStepsAreOnOneSide) {
  for (const double M : {1.0, 0.0})
    for (const Index others : {0, 600}) {
      oracle::SourceScene s;
      s.scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
      s.scene.M = Matrix{{M}};
      const auto g = [](double t) { return std::fmod(t, 0.5) < 0.2 ? 1.0 : -1.0; };
      s.scene.g = [g](double t, Eigen::Ref<Vector> v) { v[0] = g(t); };
      s.scene.breakpoints = {0.2, 0.5, 0.7, 1, 1.2, 1.5, 1.7, 2};
      s.scene.x0 = Vector{{0}};
      s.scene.T = 2;
      if (others > 0) s.scene = oracle::among_sparse_states(s.scene, others);
      Options options = for_states(Method::march, 1);
      options.trace = true;
      const Result r = run(s.scene, options);
      ASSERT_EQ(r.status, Status::solved) << r.reason;
      ASSERT_TRUE(has_own_steps(r));
      const RowMatrix w = slack(s.scene, r);
      for (Index j = 1; j <= r.steps; ++j) {
        EXPECT_LE(std::abs(std::min(r.y(j, 0), w(j, 0))), 1e-9) << M << " " << others << " " << r.t[j];
        if (M > 0) EXPECT_NEAR(r.y(j, 0), std::max(0.0, -(r.x(j, 0) + g(r.t[j]))), 1e-9) << others << " " << r.t[j];
      }
    }
}

// M = 0.01 and jumps between points of the grid; steps of the march in modes and with sparse matrices are the same.
TEST(JumpsOfG, ModesAndSparseMatricesTakeTheSameParts) {
  const KroneckerDynamics d{{3, 0.25, 0.1}, {60, 1.0 / 61, 0.1}, Vector::Unit(60, 0), Vector::Unit(60, 0)};
  Scene scene;
  scene.dynamics = d;
  scene.M = Matrix(0.01 * Matrix::Identity(3, 3));
  scene.f_entry = SourceEntry::through_B;
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << std::sin(9 * t), t < 0.412 ? 1 : -1, 2; };
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 0.3 ? 0.1 : -0.2), (t < 0.555 ? -0.1 : 0.3), -0.1 * t; };
  scene.breakpoints = {0.3, 0.412, 0.555};
  scene.x0 = Vector::Constant(180, 0.02);
  scene.T = 1;
  Options options = options_for(Method::march, 40);
  options.states = StateSelection::all;
  const Result in_modes = run(scene, options);
  scene.dynamics = to_sparse(d);
  const Result sparse = run(scene, options);
  ASSERT_EQ(in_modes.status, Status::solved) << in_modes.reason;
  ASSERT_EQ(sparse.status, Status::solved) << sparse.reason;
  EXPECT_NE(in_modes.kernel.find("steps in parts"), std::string::npos) << in_modes.kernel;
  EXPECT_NE(in_modes.kernel.find("eigenvalues a mode"), std::string::npos) << in_modes.kernel;
  EXPECT_EQ(in_modes.warning, "");
  EXPECT_LE(distance(in_modes.x, sparse.x), same_problem);
  EXPECT_LE(distance(in_modes.y, sparse.y), same_problem / 0.01);  // y is determined by M
}

// Random scenes with every kind of source among 600 sparse states: what is solved is right, and three of four are
// solved.
TEST(JumpsOfG, RandomSparseScenesAreRight) {
  const auto backend = make_cpu_backend(1);
  Index decided = 0, solved = 0;
  for (std::uint32_t seed = 400; seed < 420; ++seed) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    if (!truth.decided) continue;
    ++decided;
    Options options = for_states(Method::march, s.scene.states());
    options.max_steps = 12800;
    const Result r = solve(oracle::among_sparse_states(s.scene, 600), *backend, options);
    if (r.status != Status::solved) continue;
    ++solved;
    const oracle::TrueError error = oracle::true_error(s, truth, r);
    EXPECT_LE(error.x, 3 * tolerance) << "seed " << seed << ", sources: " << s.sources << " at " << error.x_at;
  }
  EXPECT_GE(decided, 15);
  EXPECT_GE(double(solved), 0.75 * double(decided));
}

}  // namespace
}  // namespace bromwich
