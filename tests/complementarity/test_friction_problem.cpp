// Contact problems with friction on circles: the law itself says what a solution is.

#include "bromwich/friction_problem.hpp"

#include "core/base/error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace bromwich {
namespace {

using Space = Eigen::Vector3d;

// 0 <= r_n ⊥ u_n >= 0, |r_t| <= mu r_n and r_t = -mu r_n u_t / |u_t|, to `share` of the largest force and velocity.
void expect_law(const Matrix& W, const Vector& q, const Vector& mu, const FrictionResult& f, double share = 1e-9) {
  ASSERT_EQ(f.status, LcpStatus::solved) << f.residual << " after " << f.sweeps << " sweeps";
  const Vector u = W * f.r + q;
  EXPECT_LE((u - f.u).cwiseAbs().maxCoeff(), 1e-12 * (1 + u.cwiseAbs().maxCoeff()));
  const double force = share * f.r.cwiseAbs().maxCoeff(), speed = share * q.cwiseAbs().maxCoeff();
  for (Index i = 0; i < mu.size(); ++i) {
    const double rn = f.r[3 * i], un = u[3 * i];
    const Eigen::Vector2d rt = f.r.segment(3 * i + 1, 2), ut = u.segment(3 * i + 1, 2);
    EXPECT_GE(rn, 0) << i;
    EXPECT_GE(un, -speed) << i;
    EXPECT_TRUE(rn <= force || un <= speed) << i << ": " << rn << " at " << un;
    EXPECT_LE(rt.norm(), mu[i] * rn + force) << i;
    if (ut.norm() > speed) EXPECT_LE((rt + mu[i] * rn * ut.normalized()).norm(), force / share * 1e-6) << i;
  }
}

class Draws {
 public:
  explicit Draws(unsigned seed) : random_(seed) {}
  double normal() { return normal_(random_); }
  Index below(Index n) { return Index(random_() % std::size_t(n)); }
  Matrix matrix(Index rows, Index cols) {
    Matrix m(rows, cols);
    for (double& value : m.reshaped()) value = normal();
    return m;
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
};

struct Packing {
  Matrix W;
  Vector q, mu;
};

// Bodies of six coordinates that touch each other and the ground, pressed together by velocities that they have. With
// `contacts` above twice the number of bodies, forces are not unique.
Packing packing(Index bodies, Index contacts, unsigned seed) {
  Draws draw(seed);
  Matrix H = Matrix::Zero(6 * bodies, 3 * contacts);
  for (Index i = 0; i < contacts; ++i) {
    const Space n = Space(draw.normal(), draw.normal(), draw.normal() + 1).normalized(),
                t = n.cross(Space(draw.normal(), draw.normal(), draw.normal())).normalized();
    Matrix frame(3, 3);
    frame << n, t, n.cross(t);
    const Index a = i < bodies ? i : draw.below(bodies), b = i < bodies ? -1 : draw.below(bodies);
    const auto touch = [&](Index body, double sign) {
      const Space arm = -sign * n + 0.1 * Space(draw.normal(), draw.normal(), draw.normal());
      for (Index k = 0; k < 3; ++k) {
        H.block(6 * body, 3 * i + k, 3, 1) += sign * frame.col(k);
        H.block(6 * body + 3, 3 * i + k, 3, 1) += sign * arm.cross(Space(frame.col(k)));
      }
    };
    touch(a, 1);
    if (b >= 0 && b != a) touch(b, -1);
  }
  Vector inverse_mass(6 * bodies), v(6 * bodies);
  for (Index i = 0; i < bodies; ++i) {
    inverse_mass.segment(6 * i, 3).setConstant(1 / (1 + 0.5 * std::abs(draw.normal())));
    inverse_mass.segment(6 * i + 3, 3).setConstant(2.5 * inverse_mass[6 * i]);
    v.segment(6 * i, 6) << 0.3 * draw.normal(), 0.3 * draw.normal(), -1, 0.2 * draw.normal(), 0.2 * draw.normal(), 0;
  }
  Vector mu(contacts);
  for (double& m : mu) m = 0.2 + 0.1 * double(draw.below(6));
  return {H.transpose() * inverse_mass.asDiagonal() * H, H.transpose() * v, mu};
}

TEST(FrictionProblem, SingleContacts) {
  Draws draw(1);
  int lifted = 0, stuck = 0, slipped = 0;
  for (int k = 0; k < 4000; ++k) {
    const Matrix R = draw.matrix(3, 3);
    const Matrix W = R * R.transpose() + 0.05 * Matrix::Identity(3, 3);
    const Vector q = draw.matrix(3, 1), mu{{std::abs(draw.normal())}};
    const FrictionResult f = solve_friction(W, q, mu);
    expect_law(W, q, mu, f);
    const double bound = mu[0] * f.r[0];
    (f.r[0] == 0 ? lifted : f.r.tail(2).norm() < (1 - 1e-9) * bound ? stuck : slipped) += 1;
  }
  EXPECT_GT(std::min({lifted, stuck, slipped}), 400);
}

TEST(FrictionProblem, ByHand) {
  const FrictionResult slips = solve_friction(Matrix::Identity(3, 3), Vector{{-1, 3, 0}}, Vector{{0.5}});
  EXPECT_LE((slips.r - Vector{{1, -0.5, 0}}).cwiseAbs().maxCoeff(), 1e-15);
  const FrictionResult sticks = solve_friction(Matrix::Identity(3, 3), Vector{{-1, 0.3, -0.2}}, Vector{{0.5}});
  EXPECT_LE((sticks.r - Vector{{1, -0.3, 0.2}}).cwiseAbs().maxCoeff(), 1e-15);
  const FrictionResult smooth = solve_friction(Matrix::Identity(3, 3), Vector{{-1, 3, 1}}, Vector{{0.0}});
  EXPECT_LE((smooth.r - Vector{{1, 0, 0}}).cwiseAbs().maxCoeff(), 1e-15);
}

// The sizes of Siconos' test data, with contacts that share loads.
TEST(FrictionProblem, Packings) {
  for (const auto& [bodies, contacts] : {std::pair<Index, Index>{24, 48}, {12, 60}, {95, 286}, {40, 60}}) {
    SCOPED_TRACE(testing::Message() << bodies << " bodies, " << contacts << " contacts");
    const Packing p = packing(bodies, contacts, unsigned(contacts));
    expect_law(p.W, p.q, p.mu, solve_friction(p.W, p.q, p.mu));
  }
}

// Other units of force and velocity, for all contacts: the same solution.
TEST(FrictionProblem, UnitsDoNotCount) {
  const Packing p = packing(12, 20, 3);
  const FrictionResult one = solve_friction(p.W, p.q, p.mu), other = solve_friction(1e-9 * p.W, 1e4 * p.q, p.mu);
  expect_law(p.W, p.q, p.mu, one);
  EXPECT_NEAR(other.residual, one.residual, 1e-12);
  EXPECT_LE((1e-13 * other.r - one.r).cwiseAbs().maxCoeff(), 1e-8 * one.r.cwiseAbs().maxCoeff());
}

TEST(FrictionProblem, WithoutSolution) {
  FrictionOptions options;
  options.most_sweeps = 100;
  const FrictionResult none = solve_friction(Matrix::Zero(3, 3), Vector{{-1, 0, 0}}, Vector{{0.5}}, options);
  EXPECT_EQ(none.status, LcpStatus::unsolved);
  EXPECT_GT(none.residual, 0.1);
  EXPECT_EQ(solve_friction(Matrix::Constant(3, 3, NAN), Vector::Zero(3), Vector{{0.5}}).status, LcpStatus::nonfinite);
  EXPECT_THROW(solve_friction(Matrix::Identity(3, 3), Vector::Zero(2), Vector{{0.5}}), Error);
  EXPECT_THROW(solve_friction(Matrix::Identity(3, 3), Vector::Zero(3), Vector{{-0.5}}), Error);
  EXPECT_EQ(solve_friction(Matrix(0, 0), Vector(), Vector()).status, LcpStatus::solved);
}

}  // namespace
}  // namespace bromwich
