// Modes with constant active sets: y and the constraints fulfil the equations that define them, on random systems.

#include "core/events/mode.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <random>
#include <vector>

namespace bromwich {
namespace {

class Draw {
 public:
  explicit Draw(unsigned seed) : random_(seed) {}

  Matrix matrix(Index rows, Index cols) {
    Matrix a(rows, cols);
    for (Index i = 0; i < a.size(); ++i) a.data()[i] = in_(random_);
    return a;
  }
  Vector vector(Index size) { return matrix(size, 1); }
  JetValues values(Index m, Index n) { return {vector(m), vector(m), vector(m), vector(n), vector(n), vector(n)}; }

 private:
  std::mt19937 random_;
  std::uniform_real_distribution<double> in_{-1, 1};
};

constexpr double close = 1e-9;  // condition numbers of random 3 x 3 matrices stay below 1e5 for these seeds

Vector rate(const SystemMatrices& s, const JetValues& u, const Vector& y) { return s.A * u.x + s.B * y + u.f; }

TEST(SwitchedMode, WithARegularBlockSolvesForY) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Draw draw(seed);
    const SystemMatrices s{draw.matrix(4, 4), draw.matrix(4, 3), draw.matrix(3, 4),
                           draw.matrix(3, 3) + 3 * Matrix::Identity(3, 3)};
    const auto mode = make_switched_mode(s, {0, 2});
    ASSERT_TRUE(mode);
    EXPECT_EQ(mode->constraints.x.rows(), 0);
    const JetValues u = draw.values(4, 3);
    const Vector y = evaluate(mode->y, u), w = s.N * u.x + s.M * y + u.g;
    EXPECT_EQ(y[1], 0);
    EXPECT_LE(std::abs(w[0]) + std::abs(w[2]), close);
    EXPECT_FALSE(mode->uses_df || mode->uses_dg || mode->uses_ddg);
    // x' = A_S x + B (y without its part of x) + f.
    JetValues without = u;
    without.x.setZero();
    EXPECT_LE((mode->A * u.x + s.B * evaluate(mode->y, without) + u.f - rate(s, u, y)).norm(), close);
  }
}

TEST(SwitchedMode, OfRelativeDegreeOneKeepsTheConstraint) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Draw draw(seed);
    const Matrix N = draw.matrix(2, 4);
    const SystemMatrices s{draw.matrix(4, 4), N.transpose() + 0.1 * draw.matrix(4, 2), N, Matrix::Zero(2, 2)};
    const auto mode = make_switched_mode(s, {0, 1});
    ASSERT_TRUE(mode);
    ASSERT_EQ(mode->constraints.x.rows(), 2);
    EXPECT_TRUE(mode->uses_dg);
    const JetValues u = draw.values(4, 2);
    const Vector y = evaluate(mode->y, u);
    EXPECT_LE((s.N * rate(s, u, y) + u.dg).norm(), close);
    // The impulse moves any state onto the constraint.
    JetValues after = u;
    after.x += s.B * (mode->impulse * evaluate(mode->constraints, u));
    EXPECT_LE((s.N * after.x + u.g).norm(), close);
  }
}

TEST(SwitchedMode, OfRigidContactHasAnImpulseThatStopsTheVelocity) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Draw draw(seed);
    // q' = v, v' = -K q - D v + W y + f, w = W^T q + g.
    const Matrix W = draw.matrix(3, 2);
    Matrix A = Matrix::Zero(6, 6), B = Matrix::Zero(6, 2), N = Matrix::Zero(2, 6);
    A.topRightCorner(3, 3).setIdentity();
    A.bottomRows(3) = draw.matrix(3, 6);
    B.bottomRows(3) = W;
    N.leftCols(3) = W.transpose();
    const SystemMatrices s{A, B, N, Matrix::Zero(2, 2)};
    const auto mode = make_switched_mode(s, {0, 1});
    ASSERT_TRUE(mode);
    EXPECT_EQ(mode->constraints.x.rows(), 4) << "positions and velocities";
    EXPECT_TRUE(mode->uses_ddg);
    JetValues u = draw.values(6, 2);
    u.f.head(3).setZero();
    u.df.head(3).setZero();
    const Vector y = evaluate(mode->y, u);
    EXPECT_LE((W.transpose() * rate(s, u, y).tail(3) + u.ddg).norm(), close * (1 + y.norm()));
    u.g = -N * u.x;  // in contact, with a velocity
    JetValues after = u;
    after.x += B * (mode->impulse * evaluate(mode->constraints, u));
    EXPECT_LE((W.transpose() * after.x.tail(3) + u.dg).norm(), 1e3 * close);
    EXPECT_EQ((after.x - u.x).head(3).norm(), 0);
  }
}

TEST(SwitchedMode, OfSkewMSolvesByBothComponents) {
  Draw draw(3);
  Matrix M(2, 2);
  M << 0, 2, -2, 0;
  const SystemMatrices s{draw.matrix(3, 3), draw.matrix(3, 2), draw.matrix(2, 3), M};
  const auto both = make_switched_mode(s, {0, 1});
  ASSERT_TRUE(both);
  EXPECT_EQ(both->constraints.x.rows(), 0);
  const JetValues u = draw.values(3, 2);
  EXPECT_LE((s.N * u.x + M * evaluate(both->y, u) + u.g).norm(), close);
  const auto one = make_switched_mode(s, {1});  // M_SS = 0
  ASSERT_TRUE(one);
  ASSERT_EQ(one->constraints.x.rows(), 1);
  EXPECT_NEAR(s.N.row(1).dot(rate(s, u, evaluate(one->y, u))) + u.dg[1], 0, close);
}

// Impulses of y where M_SS has a null space: M_SS p = 0, so that they leave w finite.
TEST(SwitchedMode, OfSingularMHasImpulsesInItsNullSpace) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Draw draw(seed);
    const Matrix N = draw.matrix(3, 4);
    const Vector v = draw.vector(3);
    const SystemMatrices s{draw.matrix(4, 4), N.transpose(), N, v * v.transpose()};
    const auto mode = make_switched_mode(s, {0, 1, 2});
    ASSERT_TRUE(mode);
    ASSERT_EQ(mode->constraints.x.rows(), 2);
    const JetValues u = draw.values(4, 3);
    const Vector p = mode->impulse * evaluate(mode->constraints, u);
    EXPECT_LE((s.M * p).norm(), close * p.norm());
    JetValues after = u;
    after.x += s.B * p;
    EXPECT_LE(evaluate(mode->constraints, after).norm(), close * (1 + p.norm()));
  }
}

// g_0 - g_1 = 0 is a condition on the sources; where it holds, y is shared equally, and the sum is that of one of them.
TEST(SwitchedMode, OfDuplicatedConstraintsHasAConditionOnG) {
  Draw draw(5);
  const Matrix n = draw.matrix(1, 3);
  Matrix N(2, 3);
  N << n, n;
  for (const double resistance : {0.0, 0.7}) {
    const SystemMatrices s{draw.matrix(3, 3), N.transpose(), N, Matrix::Constant(2, 2, resistance)};
    const auto both = make_switched_mode(s, {0, 1}), one = make_switched_mode(s, {0});
    ASSERT_TRUE(both && one);
    ASSERT_EQ(both->conditions.g.rows(), 1);
    JetValues u = draw.values(3, 2);
    EXPECT_GT(std::abs(evaluate(both->conditions, u)[0]), 1e-3);
    for (Vector* g : {&u.g, &u.dg, &u.ddg}) (*g)[1] = (*g)[0];
    EXPECT_LE(std::abs(evaluate(both->conditions, u)[0]), close);
    const Vector y = evaluate(both->y, u);
    EXPECT_NEAR(y[0], y[1], close * (1 + y.norm()));
    EXPECT_NEAR(y.sum(), evaluate(one->y, u)[0], close * (1 + y.norm()));
    const double w = (N * u.x + s.M * y + u.g)[0], dw = (N * rate(s, u, y) + u.dg)[0];
    EXPECT_NEAR(resistance > 0 ? w : dw, 0, close * (1 + y.norm()));
  }
}

TEST(SwitchedMode, ThatTwoDerivativesDoNotDetermineIsNone) {
  Draw draw(6);
  const Matrix A = draw.matrix(3, 3), none = Matrix::Zero(1, 1);
  EXPECT_FALSE(make_switched_mode({A, draw.matrix(3, 1), Matrix::Zero(1, 3), none}, {0})) << "w does not depend on y";
  // x1' = x2, x2' = x3, x3' = y: relative degree three.
  Matrix chain = Matrix::Zero(3, 3);
  chain(0, 1) = chain(1, 2) = 1;
  EXPECT_FALSE(make_switched_mode({chain, Vector::Unit(3, 2), Vector::Unit(3, 0).transpose(), none}, {0}));
  // Two components that move the state apart, and only their sum is constrained.
  Matrix B = Matrix::Identity(2, 2), N = Matrix::Ones(2, 2);
  EXPECT_FALSE(make_switched_mode({Matrix::Zero(2, 2), B, N, Matrix::Zero(2, 2)}, {0, 1}));
}

// M = P^T R P with resistances from 1e-4 to 1e4: an active set is near singular ones, and w is zero in it but for
// rounding of its terms all the same.
TEST(SwitchedMode, NearSingularOnesLoseNoDigits) {
  constexpr Index n = 5;
  for (unsigned seed = 0; seed < 40; ++seed) {
    Draw draw(seed);
    const Vector R = (draw.vector(n).array() * 4 * std::log(10)).exp();
    const Matrix P = draw.matrix(n, n);
    SystemMatrices s{draw.matrix(3, 3), draw.matrix(3, n), draw.matrix(n, 3), P.transpose() * R.asDiagonal() * P};
    s.M.row(4) = -s.M.row(3);  // two diodes the other way round, parallel
    s.M.col(4) = -s.M.col(3);
    s.N.row(4) = -s.N.row(3);
    const std::vector<Index> active{0, 1, 2, 3};
    const auto mode = make_switched_mode(s, active);
    ASSERT_TRUE(mode) << seed;
    JetValues u = draw.values(3, n);
    u.g[4] = -u.g[3];
    const Vector y = evaluate(mode->y, u), w = s.N * u.x + s.M * y + u.g;
    const Vector of_y = terms(mode->y, {u.x.cwiseAbs(), u.f.cwiseAbs(), u.df, u.g.cwiseAbs(), u.dg, u.ddg});
    const Vector of_w = s.N.cwiseAbs() * u.x.cwiseAbs() + s.M.cwiseAbs() * of_y + u.g.cwiseAbs();
    for (Index i = 0; i < n; ++i) EXPECT_LE(std::abs(w[i]), 16 * epsilon * of_w[i]) << seed << " " << i;
  }
}

TEST(SwitchedMode, WithoutActiveConstraintsHasNoY) {
  Draw draw(7);
  const SystemMatrices s{draw.matrix(3, 3), draw.matrix(3, 2), draw.matrix(2, 3), draw.matrix(2, 2)};
  const auto mode = make_switched_mode(s, {});
  ASSERT_TRUE(mode);
  EXPECT_EQ(evaluate(mode->y, draw.values(3, 2)).norm(), 0);
  EXPECT_EQ(mode->A, s.A);
}

}  // namespace
}  // namespace bromwich
