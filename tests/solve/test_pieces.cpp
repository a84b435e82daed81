// Grids of pieces against uniform grids that are as fine everywhere.

#include "core/solve/pieces.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/shared_dynamics.hpp"
#include "core/scene/natural_units.hpp"
#include "core/solve/solve.hpp"
#include "core/solve/stages.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace bromwich::pieces_test {
namespace {

// Heat in a rod with one end on a constraint: K(t) falls like t^{-1/2} at first, and y leaves y_0 like t^{1/2}.
Scene rod() {
  const Index m = 40;
  const double c = double((m + 1) * (m + 1));
  Scene scene;
  Matrix A = Matrix::Zero(m, m);
  for (Index i = 0; i < m; ++i) {
    A(i, i) = i == 0 ? -c : -2 * c;
    if (i > 0) A(i, i - 1) = A(i - 1, i) = c;
  }
  Matrix B = Matrix::Zero(m, 1), N = Matrix::Zero(1, m);
  B(0, 0) = double(m + 1);
  N(0, 0) = 1;
  scene.dynamics = DenseDynamics{A, B, N};
  scene.M = Matrix{{0.2}};
  scene.lcp_class = LcpClass::P;
  scene.x0 = Vector::Zero(m);
  scene.g = [](double, Eigen::Ref<Vector> g) { g << -1; };
  scene.T = 1;
  scene.default_steps = 64;
  return scene;
}

InnerOptions inner() {
  InnerOptions options;
  options.method = Method::march;
  options.states = StateSelection::all;
  options.trace = true;
  options.units = std::make_shared<const NaturalUnits>();
  options.family = std::make_shared<GridFamily>(true);
  return options;
}

Result pass(const Scene& scene, Backend& backend, const InnerOptions& options) {
  return run_stages(scene, backend, options, pass);
}

Result uniform(const Scene& scene, Backend& backend, Index steps) {
  Options options;
  options.method = Method::march;
  options.steps = steps;
  options.states = StateSelection::all;
  options.trace = true;
  return solve(scene, backend, options);
}

TEST(Pieces, OfOneLevelAreTheUniformGrid) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = rod();
  const Result found = solve_in_pieces(scene, *backend, inner(), pass, std::vector<int>(8, 2));
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  const Result expected = uniform(scene, *backend, 32);
  ASSERT_EQ(found.y.rows(), 9);
  for (Index k = 0; k <= 8; ++k) {
    EXPECT_NEAR(found.t[k], expected.t[4 * k], 1e-15);
    EXPECT_NEAR(found.y(k, 0), expected.y(4 * k, 0), 1e-13) << k;
    EXPECT_LE((found.x.row(k) - expected.x.row(4 * k)).cwiseAbs().maxCoeff(), 1e-13) << k;
    EXPECT_NEAR(found.trace(k, 0), expected.trace(4 * k, 0), 1e-13) << k;
    EXPECT_NEAR(found.y_integral(k, 0), integral_of_y(expected)(4 * k, 0), 1e-13) << k;
  }
}

// A piece begins with the state and the sources of its time.
TEST(Pieces, OfManyLevelsApproachAFineGrid) {
  const auto backend = make_cpu_backend(1);
  Scene scene = rod();
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << std::cos(9 * t) - 0.5; };
  scene.breakpoints = {0.3};
  const auto family = inner();
  const Result found = solve_in_pieces(scene, *backend, family, pass, {9, 9, 8, 8, 8, 9, 7, 7});
  ASSERT_EQ(found.status, Status::solved) << found.reason;
  const Result expected = uniform(scene, *backend, 1 << 13);
  for (Index k = 1; k <= 8; ++k) {
    EXPECT_NEAR(found.y(k, 0), expected.y(k << 10, 0), 2e-4) << k;
    EXPECT_LE((found.x.row(k) - expected.x.row(k << 10)).cwiseAbs().maxCoeff(), 2e-4) << k;
  }
  EXPECT_FALSE(found.continuous);
}

TEST(Pieces, StopWithTheReasonOfAPiece) {
  const auto backend = make_cpu_backend(1);
  Scene scene = rod();
  scene.g = [](double t, Eigen::Ref<Vector> g) { g << (t < 0.6 ? -1 : NAN); };
  const Result found = solve_in_pieces(scene, *backend, inner(), pass, {1, 1, 2, 2});
  EXPECT_EQ(found.status, Status::nonfinite);
  EXPECT_FALSE(found.reason.empty());
  EXPECT_TRUE(std::isfinite(found.y(2, 0)));
  EXPECT_TRUE(std::isnan(found.y(4, 0)));
}

TEST(Pieces, SayWhatTheyDoNotTake) {
  EXPECT_EQ(unsuited_to_pieces(rod()), "");
  Scene other = rod();
  other.M = Matrix{{0.0}};
  other.lcp_class = LcpClass::PSD;
  EXPECT_NE(unsuited_to_pieces(other), "");
  EXPECT_NE(unsuited_to_pieces(make_scene("signorini", {{"Q", 5}})), "");
  other = rod();
  other.free_rows = {0};
  EXPECT_NE(unsuited_to_pieces(other), "");
}

// The layer at t = 0 takes steps of its own; the others stay long.
TEST(Pieces, MeetAToleranceWithFewerSteps) {
  const auto backend = make_cpu_backend(2);
  const Scene scene = rod();
  PieceGoal goal{1e-5, 0, {}, 1 << 16, 0};
  const auto found = refine_pieces(scene, *backend, inner(), pass, 64, goal);
  ASSERT_TRUE(found);
  const Result fine = uniform(scene, *backend, 1 << 16);
  double error = 0, size = fine.y.bottomRows(1 << 16).cwiseAbs().maxCoeff();
  for (Index k = 1; k <= 64; ++k) error = std::max(error, std::abs(found->y(k, 0) - fine.y(k << 10, 0)) / size);
  EXPECT_LE(error, 1e-5);
  // Uniform grids with as many steps are not there yet.
  const Index steps = found->errors->grids.back();
  Index J = 64;
  while (2 * J <= steps) J *= 2;
  const Result same = uniform(scene, *backend, J);
  double other = 0;
  for (Index k = 1; k <= 64; ++k)
    other = std::max(other, std::abs(same.y(k * (J / 64), 0) - fine.y(k << 10, 0)) / size);
  EXPECT_GT(other, error) << steps << " steps";
  EXPECT_FALSE(refine_pieces(scene, *backend, inner(), pass, 64, {1e-5, 0, {}, 128, 0}))
      << "a budget that is too small";
}

}  // namespace
}  // namespace bromwich::pieces_test
