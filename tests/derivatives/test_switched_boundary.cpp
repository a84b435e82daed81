// Derivatives of boundary values with located switches, also where A has a mode that y alone fixes: against closed
// forms, and both passes against each other.

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "derivatives/result_derivative.hpp"
#include "derivatives/switched_derivative.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace bromwich::switched_boundary_test {
namespace {

constexpr double pi = std::numbers::pi, loss = 0.3, phase = 1.5;

// x' = sin(2 pi t + phase) - loss + y, x at the floor c or above, x(0) = x(1): A = 0, and E0 + ET e^{TA} = 0.
//
// x leaves the floor where the inflow is zero and grows, at t1; behind the contact x(t) = c + F(t) - F(t1), F the
// integral of the inflow. So x(0) = x(1) = c + F(1) - F(t1).
struct Reservoir {
  double floor = 0.2, ratio = 1, b = 0;  ///< x(0) - ratio x(1) = b

  double leaves() const { return 1 + (std::asin(loss) - phase) / (2 * pi); }
  double integral(double t) const { return -std::cos(2 * pi * t + phase) / (2 * pi) - loss * t; }
  double last() const { return floor + integral(1) - integral(leaves()); }
  double first() const { return ratio * last() + b; }

  Scene scene() const {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
    s.M = Matrix(Matrix::Zero(1, 1));
    s.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(2 * pi * t + phase) - loss; };
    s.g = [c = floor](double, Eigen::Ref<Vector> v) { v[0] = -c; };
    s.T = 1;
    s.boundary = BoundaryCondition{Matrix{{1}}, Matrix{{-ratio}}, Vector{{b}}};
    return s;
  }
};

const Vector times = Vector::LinSpaced(21, 0, 1);
// What the integration with a tolerance of 1e-11 leaves.
constexpr double exact = 1e-9;

TEST(SwitchedBoundary, AModeThatTheConstraintFixes) {
  const Reservoir r;
  const SwitchedDerivative d(r.scene(), times);
  EXPECT_NEAR(d.values().x(0, 0), r.first(), exact);
  EXPECT_NEAR(d.start()[0], r.first(), exact);
  const auto first = [&](const DataChange& c) { return d.jvp(c).x(0, 0); };
  DataChange c;
  c.f = RowMatrix::Ones(21, 1);  // F(1) - F(t1) grows by 1 - t1; the inflow is zero at t1
  EXPECT_NEAR(first(c), 1 - r.leaves(), exact);
  c = {};
  c.g = -RowMatrix::Ones(21, 1);  // the floor
  EXPECT_NEAR(first(c), 1, exact);
  c = {};
  c.b = Vector{{1}};  // x(1) does not see x(0)
  EXPECT_NEAR(first(c), 1, exact);
  c = {};
  c.ET = Matrix{{1}};
  EXPECT_NEAR(first(c), -r.last(), exact);
  c = {};
  c.E0 = Matrix{{1}};
  EXPECT_NEAR(first(c), -r.first(), exact);
  c = {};
  c.B = Matrix{{1}};  // y alone changes
  EXPECT_NEAR(first(c), 0, exact);
  c = {};
  c.A = Matrix{{1}};  // x(1) by the integral of x from t1 on: inflow at rest pushes with c while the floor holds
  const auto twice = [&](double t) { return std::sin(2 * pi * t + phase) / (4 * pi * pi) + loss * t * t / 2; };
  const double t1 = r.leaves(), of_x = (r.floor - r.integral(t1)) * (1 - t1) - (twice(1) - twice(t1));
  EXPECT_NEAR(first(c), of_x, exact);
}

TEST(SwitchedBoundary, GradientIsTheTranspose) {
  Reservoir r;
  r.ratio = 0.8, r.b = 0.1;
  const SwitchedDerivative d(r.scene(), times);
  EXPECT_NEAR(d.values().x(0, 0), r.first(), exact);
  const auto table = [](double k) {
    return RowMatrix(Vector::NullaryExpr(21, [k](Index i) { return std::sin(k * double(i) + 0.3); }));
  };
  DataChange c;
  c.f = table(1), c.g = table(2), c.A = Matrix{{0.4}}, c.B = Matrix{{-0.7}}, c.N = Matrix{{0.9}};
  c.b = Vector{{0.6}}, c.E0 = Matrix{{-0.2}}, c.ET = Matrix{{1.1}};
  SolutionChange of{table(3), table(4), table(5), table(6)};
  const SolutionChange out = d.jvp(c);
  const auto dot = [](const auto& a, const auto& b) { return a.cwiseProduct(b).sum(); };
  const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w) + dot(of.integral, out.integral);
  const DataChange bar = d.vjp(of);
  EXPECT_EQ(bar.x0.size(), 0);
  const double backward = dot(bar.f, c.f) + dot(bar.g, c.g) + dot(bar.A, c.A) + dot(bar.B, c.B) + dot(bar.N, c.N) +
                          dot(bar.b, c.b) + dot(bar.E0, c.E0) + dot(bar.ET, c.ET);
  EXPECT_NEAR(backward, forward, 1e-12 * (1 + std::abs(forward)));  // rounding
}

TEST(SwitchedBoundary, OfAResultByShooting) {
  const Reservoir r;
  const Scene scene = r.scene();
  const auto backend = make_cpu_backend(1);
  Options options;
  options.method = Method::shooting;
  options.steps = 20;
  const Result result = solve(scene, *backend, options);
  ASSERT_EQ(result.status, Status::solved) << result.reason;
  const ResultDerivative d(scene, result, *backend);
  EXPECT_STREQ(to_string(d.form()), "located switches");
  DataChange c;
  c.f = RowMatrix::Ones(21, 1);
  EXPECT_NEAR(d.jvp(c).x(0, 0), 1 - r.leaves(), exact);
  const DerivativeError error(scene, result, *backend, d);
  EXPECT_LT(error.of_jvp(c).x.maxCoeff(), 1e-6);
}

// Large and small units: x in thousandths, t in units of 1e-3.
TEST(SwitchedBoundary, InOtherUnits) {
  const Reservoir r;
  Scene s = r.scene();
  s.T = 1e3;
  s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1e-5}}, Matrix{{1e4}}};
  s.f = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(2 * pi * 1e-3 * t + phase) - loss; };
  s.g = [c = r.floor](double, Eigen::Ref<Vector> v) { v[0] = -1e7 * c; };
  s.boundary = BoundaryCondition{Matrix{{1e-6}}, Matrix{{-1e-6}}, Vector{{0}}};
  const SwitchedDerivative d(s, Vector(1e3 * times));
  EXPECT_NEAR(d.values().x(0, 0), 1e3 * r.first(), 1e3 * exact);
  DataChange c;
  c.b = Vector{{1e-6}};
  EXPECT_NEAR(d.jvp(c).x(0, 0), 1, exact);
  SolutionChange of;
  of.x = RowMatrix::Zero(21, 1);
  of.x(0, 0) = 1;
  EXPECT_NEAR(d.vjp(of).b[0], 1e6, 1e6 * exact);
}

TEST(SwitchedBoundary, SaysWhatItDoesNotTake) {
  const SwitchedDerivative d(Reservoir().scene(), times);
  DataChange c;
  c.x0 = Vector{{1}};
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("change b"), std::string::npos);
}

}  // namespace
}  // namespace bromwich::switched_boundary_test
