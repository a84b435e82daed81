// Problems with several solutions: they are found and reported in the warning of a result.

#include "core/lcp/other_solutions.hpp"

#include "core/scene/relay.hpp"
#include "tests/support/run.hpp"

#include <Eigen/LU>

#include <random>

namespace bromwich {
namespace {

// All solutions with nonsingular M_SS, exact for small integers.
std::vector<Vector> by_brute_force(const Matrix& M, const Vector& q) {
  std::vector<Vector> found;
  const Index n = q.size();
  for (unsigned set = 0; set < 1u << n; ++set) {
    Matrix active = Matrix::Identity(n, n);  // rows of S: (M y)_i = -q_i, others: y_i = 0
    Vector right = Vector::Zero(n);
    for (Index i = 0; i < n; ++i)
      if (set >> i & 1u) {
        active.row(i) = M.row(i);
        right[i] = -q[i];
      }
    if (std::abs(active.determinant()) < 1e-9) continue;
    const Vector y = active.fullPivLu().solve(right), w = M * y + q;
    if (y.minCoeff() < -1e-9 || w.minCoeff() < -1e-9) continue;
    bool known = false;
    for (const Vector& other : found) known |= (other - y).cwiseAbs().maxCoeff() < 1e-7;
    if (!known) found.push_back(y);
  }
  return found;
}

TEST(OtherSolutions, AreFoundWhereThereAreSome) {
  std::mt19937 random(3);
  std::uniform_int_distribution<int> entry(-3, 3);
  int several = 0, single = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const Index n = 1 + trial % 4;
    const Matrix M = Matrix::NullaryExpr(n, n, [&] { return double(entry(random)); });
    const Vector q = Vector::NullaryExpr(n, [&] { return double(entry(random)) + 0.5; });  // not degenerate
    const std::vector<Vector> all = by_brute_force(M, q);
    if (all.empty()) continue;
    const auto other = another_solution(M, q, all.front());
    if (all.size() > 1) {
      ++several;
      ASSERT_TRUE(other) << M << '\n' << q.transpose();
      const Vector w = M * *other + q;
      EXPECT_GE(other->minCoeff(), -1e-9);
      EXPECT_GE(w.minCoeff(), -1e-9);
      EXPECT_LE(other->cwiseMin(w).cwiseAbs().maxCoeff(), 1e-9);
      EXPECT_GE((*other - all.front()).cwiseAbs().maxCoeff(), 1e-7);
    } else if (!other) {
      ++single;
    }
  }
  EXPECT_GE(several, 20);
  EXPECT_GE(single, 100);
}

TEST(OtherSolutions, DoNotExistForPMatrices) {
  const Matrix M{{2, 1, 0}, {-1, 2, 1}, {0, -1, 2}};
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 100; ++trial) {
    const Vector q = Vector::NullaryExpr(3, [&] { return normal(random); });
    const std::vector<Vector> all = by_brute_force(M, q);
    ASSERT_EQ(all.size(), 1u);
    EXPECT_FALSE(another_solution(M, q, all.front()));
  }
}

// y = (t, 1 - t) for all t in [0, 1].
TEST(OtherSolutions, OfASingularBlock) {
  EXPECT_TRUE(another_solution(Matrix{{1, 1}, {1, 1}}, Vector{{-1, -1}}, Vector{{0.5, 0.5}}));
  EXPECT_FALSE(another_solution(Matrix{{1, 0}, {0, 1}}, Vector{{-1, -1}}, Vector{{1, 1}}));
}

// The same as two of ten components, from a corner of the set: the second is zero, and may grow.
TEST(OtherSolutions, OfALargerProblemLieNextToOne) {
  Matrix M = Matrix::Identity(10, 10);
  Vector q = Vector::Constant(10, -1), y = Vector::Ones(10);
  y[1] = 0;
  EXPECT_FALSE(another_solution(M, q, Vector::Ones(10), true));
  M(0, 1) = M(1, 0) = 1;
  EXPECT_FALSE(another_solution(M, q, y));
  const auto other = another_solution(M, q, y, true);
  ASSERT_TRUE(other);
  EXPECT_NEAR((*other)[0], 0.5, 1e-15);  // half way to the other corner
  EXPECT_NEAR((*other)[1], 0.5, 1e-15);
}

// x' in Sgn x from 0 may stay, or leave to either side at any time.
TEST(OtherSolutions, AreSaidOfARelayThatPushesAway) {
  Scene scene = relay_scene(Matrix{{0}}, Matrix{{-1}}, Matrix{{1}}, {}, Vector{{0}});
  scene.T = 1;
  const Result r = run(scene, Method::automatic, 50);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.warning.find("not unique"), std::string::npos) << r.warning;
}

TEST(OtherSolutions, AreSaidWhereMIsNegative) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  scene.M = Matrix{{-1}};
  scene.x0 = Vector{{1}};
  const Result r = run(scene, Method::automatic, 50);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_NE(r.warning.find("not unique"), std::string::npos) << r.warning;
  scene.M = Matrix{{1}};
  EXPECT_EQ(run(scene, Method::automatic, 50).warning, "");
}

}  // namespace
}  // namespace bromwich
