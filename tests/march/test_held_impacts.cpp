// Whole steps on which nothing changes: a mass that slides, in closed form, and what ends such steps.

#include "core/march/held_impacts.hpp"
#include "tests/mechanics/structures.hpp"

#include <gtest/gtest.h>

#include <optional>

namespace bromwich::held_impacts_test {
namespace {

constexpr double h = 0.1, weight = 2, mu = 0.25, push = 0.2;

// A unit mass on the ground, pushed along it. The rows of its contact: normal, friction, slip.
class Sliding {
 public:
  Sliding() {
    Structure s;
    s.M = sparse(Matrix::Identity(2, 2));
    Contact ground;
    ground.normal = Vector{{0, 1}}, ground.tangent = Matrix{{1, 0}};
    ground.mu = mu;
    scene_ = make_mechanism(s, {ground}).scene;
    rows_ = impact_rows(scene_);
    flow_.emplace(rows_->A);
    held_.emplace(*rows_, *flow_, h);
    now_ = {0, h, Matrix::Zero(4, 3), Matrix::Zero(3, 3), false};
    now_.f.col(0) = Vector{{0, 0, push, -weight}};
  }

  /// On the ground, with these forces at the step before.
  void stay(const Vector& y) {
    const std::vector<Index> all{0, 1, 2};
    Matrix mean = Matrix::Zero(4, 3);  // of D over the step
    flow_->advance(h, {Matrix(rows_->B), {}, {}}, mean);
    Matrix W = rows_->M;
    for (const Index i : {0, 1}) W.row(i) += Matrix(rows_->speeds * mean).row(i) / h;
    W.col(2) = rows_->M.col(2);
    held_->hold({1, 0, 0}, all, W, y, {0}, rows_->onto.leftCols(1));
  }
  void fly() { held_->hold({0, 0, 0}, {}, Matrix(0, 0), Vector::Zero(3), {}, Matrix(4, 0)); }
  bool step(Vector& x) { return held_->step(now_, x, y, integral, residual); }
  bool is_held(const Vector& with) const { return held_->is_held({1, 0, 0}, with); }
  SmoothSources& now() { return now_; }

  Vector y = Vector::Zero(3), integral = Vector::Zero(3);
  double residual = 0;

 private:
  Scene scene_;
  std::optional<ImpactRows> rows_;
  std::optional<ImpactFlow> flow_;
  std::optional<HeldImpacts> held_;
  SmoothSources now_;
};

constexpr double rounding = 1e-14;

TEST(HeldImpacts, AMassThatSlides) {
  Sliding mass;
  const Vector forward{{weight, 0, 0}};
  mass.stay(forward);
  EXPECT_TRUE(mass.is_held(forward));
  EXPECT_FALSE(mass.is_held(Vector{{weight, 1, 0}}));
  Vector x{{0.3, 0, 1, 0}};
  ASSERT_TRUE(mass.step(x));
  const double slows = mu * weight - push;
  EXPECT_LE((x - Vector{{0.3 + h - slows * h * h / 2, 0, 1 - slows * h, 0}}).cwiseAbs().maxCoeff(), rounding);
  EXPECT_LE((mass.y - Vector{{weight, 0, 0}}).cwiseAbs().maxCoeff(), rounding);
  EXPECT_LE((mass.integral - Vector{{weight * h, 0, 0}}).cwiseAbs().maxCoeff(), rounding);
  EXPECT_LE(mass.residual, rounding);
}

TEST(HeldImpacts, BackwardAndAtRest) {
  Sliding mass;
  const Vector backward{{weight, 2 * mu * weight, 1}};
  mass.stay(backward);
  Vector x{{0, 0, -1, 0}};
  ASSERT_TRUE(mass.step(x));
  const double slows = mu * weight + push;
  EXPECT_LE((x - Vector{{-h + slows * h * h / 2, 0, -1 + slows * h, 0}}).cwiseAbs().maxCoeff(), rounding);
  EXPECT_LE((mass.y - Vector{{weight, 2 * mu * weight, 1 - slows * h}}).cwiseAbs().maxCoeff(), 4 * rounding);
  EXPECT_LE(std::abs(mass.integral[2] - h * (1 - slows * h / 2)), rounding);  // how far it has slid
  mass.stay(Vector{{weight, mu * weight - push, 0}});
  x = Vector{{0.3, 0, 0, 0}};
  ASSERT_TRUE(mass.step(x));
  EXPECT_LE((x - Vector{{0.3, 0, 0, 0}}).cwiseAbs().maxCoeff(), rounding);
  EXPECT_LE(std::abs(mass.y[1] - (mu * weight - push)), 4 * rounding);
}

// Sliding that ends, friction at its bound, and a contact that opens: nothing is changed then.
TEST(HeldImpacts, WhatEndsThem) {
  const auto refused = [](Sliding& mass, const Vector& with, const Vector& from) {
    mass.stay(with);
    Vector x = from;
    EXPECT_FALSE(mass.step(x));
    EXPECT_EQ(x, from);
    EXPECT_TRUE(mass.integral.isZero(0));
  };
  Sliding mass;
  refused(mass, Vector{{weight, 0, 0}}, Vector{{0, 0, (mu * weight - push) * h / 2, 0}});
  mass.now().f(2, 0) = 2 * mu * weight;
  refused(mass, Vector{{weight, mu * weight - push, 0}}, Vector{{0, 0, 0, 0}});
  mass.now().f(3, 0) = 1;
  refused(mass, Vector{{weight, 0, 0}}, Vector{{0, 0, 1, 0}});
}

// In flight: it stays open until it would be on the ground at the end.
TEST(HeldImpacts, AFlight) {
  const double falls = weight * h * h / 2;
  for (const double height : {1.01 * falls, 0.99 * falls}) {
    Sliding flying;
    flying.fly();
    Vector x{{0, height, 0, 0}};
    const bool stays = flying.step(x);
    EXPECT_EQ(stays, height > falls);
    if (stays) {
      EXPECT_LE(std::abs(x[1] - (height - falls)), rounding);
      EXPECT_TRUE(flying.y.isZero(0));
    }
  }
}

}  // namespace
}  // namespace bromwich::held_impacts_test
