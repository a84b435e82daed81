// When continuous piecewise-linear y is safe.

#include "core/kernel/ringing.hpp"

#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich {
namespace {

DenseRecurrence recurrence(const DenseDynamics& d, double h) { return dense_recurrence(d, Rule::exponential, h); }

// K = 1: W^(-1) = 0 and W_0 = h/2.
TEST(Ringing, OfAnIntegratorSetsInBelowHalfAStep) {
  const double h = 0.01;
  const DenseRecurrence r = recurrence({Matrix{{0}}, Matrix{{1}}, Matrix{{1}}}, h);
  EXPECT_TRUE(choose_basis(Matrix{{h / 1.9}}, LcpClass::P, r).continuous);
  EXPECT_FALSE(choose_basis(Matrix{{h / 2.1}}, LcpClass::P, r).continuous);
  EXPECT_FALSE(choose_basis(Matrix{{0}}, LcpClass::PSD, r).continuous);
}

// K = t: W^(-1) = -h^2/12, W_0 = h^2/6: the root leaves the unit circle where M < h^2/12.
TEST(Ringing, OfAForceOnAPositionGrowsBelowHSquaredOverTwelve) {
  const double h = 0.1, M_unstable = 0.9 * h * h / 12, M_safe = 1.1 * h * h / 4;
  const DenseDynamics d{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  EXPECT_FALSE(choose_basis(Matrix{{M_unstable}}, LcpClass::P, recurrence(d, h)).continuous);
  EXPECT_TRUE(choose_basis(Matrix{{M_safe}}, LcpClass::P, recurrence(d, h)).continuous);

  // In the recurrence itself: y of the closed loop grows for one M and not for the other.
  const auto largest = [&](double M) {
    const DenseRecurrence r = recurrence(d, h);
    Vector z = Vector{{1e-3, 0}};
    double y = 0, most = 0;
    for (int j = 0; j < 200; ++j) {
      y = -(r.output * z)(0) / (M + r.w0(0, 0));
      most = std::max(most, std::abs(y));
      z = (r.decay * z + r.input * Vector{{y}}).eval();
    }
    return std::abs(y) / most;
  };
  EXPECT_EQ(largest(M_unstable), 1);  // still growing at the end
  EXPECT_LT(largest(M_safe), 0.999);
}

TEST(Ringing, LagWeightsAndRecurrenceAgree) {
  const DenseDynamics d{Matrix{{-1, 2}, {0, -3}}, Matrix{{1, 0}, {0, 1}}, Matrix{{1, 0}, {0, 1}}};
  for (const double h : {0.5, 0.1, 0.01})
    for (const double M : {1e-4, 1e-2, 1.0}) {
      const DenseRecurrence r = recurrence(d, h);
      const Matrix matrix = M * Matrix::Identity(2, 2);
      EXPECT_EQ(choose_basis(matrix, LcpClass::P, r).continuous,
                choose_basis(matrix, LcpClass::P, lag_table(r, Index(20 / h))).continuous)
          << h << " " << M;
    }
}

TEST(Ringing, IsSeenInASolution) {
  const Index J = 100;
  RowMatrix y(J + 1, 2);
  for (Index j = 0; j <= J; ++j) y.row(j) << std::sin(0.1 * double(j)), 1 + 0.001 * double(j);
  EXPECT_EQ(ringing_from(y), -1);
  RowMatrix ringing = y;
  for (Index j = 50; j <= J; ++j) ringing(j, 1) += (j % 2 ? 0.1 : -0.1);
  EXPECT_NEAR(double(ringing_from(ringing)), 50, 2);
  RowMatrix damped = y;  // decays by a fifth per step
  for (Index j = 50; j <= J; ++j) damped(j, 1) += (j % 2 ? 0.1 : -0.1) * std::pow(0.8, double(j - 50));
  EXPECT_EQ(ringing_from(damped), -1);
  RowMatrix kink = y;
  for (Index j = 40; j <= J; ++j) kink(j, 0) = 3;
  EXPECT_EQ(ringing_from(kink), -1);
  EXPECT_EQ(ringing_from(RowMatrix::Zero(50, 3)), -1);
}

// Detection by chunks of rows, each with its preceding rows, equals detection over all rows.
TEST(Ringing, IsSeenInChunksOfRows) {
  reference::Random random{41};
  for (int k = 0; k < 20; ++k) {
    RowMatrix y = random.matrix(90, 3);  // about every other random value has a second difference of the other sign
    y.topRows(30) *= 1e-3;
    Vector largest = Vector::Zero(3);
    largest_of_columns(y, 0, 90, largest);
    EXPECT_EQ(largest, y.cwiseAbs().colwise().maxCoeff().transpose());
    for (const Index run : {2, 5, 9}) {
      bool found = false;
      for (Index begin = 0; begin < 90; begin += 7)
        found = found || alternates(y, begin, std::min<Index>(90, begin + 7), 0.01 * largest, run);
      EXPECT_EQ(found, alternates(y, 0, 90, 0.01 * largest, run)) << run;
    }
  }
}

// A stiff contact: with steps too long for its compliance the continuous basis would grow silently.
TEST(Ringing, AStiffContactIsNotSolvedWrongly) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{0, 1}, {0, 0}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
  scene.M = Matrix{{1e-6}};
  scene.f = [](double, Eigen::Ref<Vector> f) { f << 0, -1; };
  scene.x0 = Vector{{0.125, 0}};
  scene.T = 1;
  Options options = options_for(Method::march, 400);
  options.states = StateSelection::all;
  // It falls for 1/2, is thrown back by the spring within about pi/1000, and cannot rise above its start. (Steps of
  // 1/400 barely resolve the contact, which lasts 1/300.)
  for (const Index J : {50, 400, 20000}) {
    options.steps = J;
    const Result r = run(scene, options);
    EXPECT_EQ(r.kernel.find("discontinuous") != std::string::npos, J < 20000) << J;
    if (J == 20000) {
      EXPECT_EQ(r.status, Status::solved) << r.reason;
    }
    if (r.status != Status::solved) continue;
    EXPECT_LE(r.x.col(0).maxCoeff(), 0.125 * (1 + 1e-3)) << J;
    EXPECT_GE(r.x.col(0).minCoeff(), -2e-3) << J;
  }
  EXPECT_EQ(run(scene, Method::contour, 50).status, Status::unsupported);
}

}  // namespace
}  // namespace bromwich
