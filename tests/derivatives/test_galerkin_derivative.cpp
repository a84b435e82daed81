// Derivatives of boundary-value problems against central differences of solves, and both passes against each other.

#include "derivatives/galerkin_derivative.hpp"

#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/derivatives/drawn_changes.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::galerkin_derivative_test {
namespace {

using namespace derivative_test;

constexpr Index N = 24;

Result solved(const Scene& scene) {
  Options options;
  options.steps = N;
  options.method = Method::galerkin;
  options.states = StateSelection::all;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

// Three states, two constraints, coupled ends; M of class P and not symmetric. With `free`, a third row is an equation.
Scene coupled_ends(bool with_free_row = false, bool with_mass = false) {
  Random random(11);
  const Index m = 3, n = with_free_row ? 3 : 2;
  Scene s;
  s.dynamics =
      DenseDynamics{random.matrix(m, m) - 2 * Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
  Matrix M = 3 * Matrix::Identity(n, n) + random.matrix(n, n);
  s.M = M;
  s.lcp_class = LcpClass::P;
  if (with_free_row) s.free_rows = {1};
  s.T = 2;
  s.f = [](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = 2 * std::sin(3 * t + double(i));
  };
  s.g = [](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = 2 * std::cos(4 * t + 0.7 * double(i)) - 0.3;
  };
  s.boundary = BoundaryCondition{Matrix::Identity(m, m), 0.5 * random.matrix(m, m), random.vector(m)};
  if (with_mass) {
    DenseDynamics d = *s.dynamics->small_state();
    d.E = 2 * Matrix::Identity(m, m) + 0.4 * random.matrix(m, m);
    s.dynamics = d;
  }
  return s;
}

DataChange drawn_with_b(const Scene& s, unsigned seed) {
  Random random(seed);
  const Index n = s.constraints(), m = s.states();
  DataChange c;
  (s.boundary ? c.b : c.x0) = random.vector(m);
  c.f = random.matrix(N + 1, m), c.g = random.matrix(N + 1, n), c.M = random.matrix(n, n);
  c.A = random.matrix(m, m), c.B = random.matrix(m, n), c.N = random.matrix(n, m);
  if (s.lcp_class == LcpClass::PSD) c.M.bottomRows(1).setZero(), c.M.rightCols(1).setZero();  // it stays so
  if (s.dynamics->has_mass()) c.E = random.matrix(m, m);
  if (s.boundary) c.E0 = random.matrix(m, m), c.ET = random.matrix(m, m);
  return c;
}

Scene changed_ends(const Scene& s, const DataChange& c, double by) {
  Scene other = changed(s, c, by);
  if (c.b.size() > 0) other.boundary->b += by * c.b;
  if (c.E0.size() > 0) other.boundary->E0 += by * c.E0;
  if (c.ET.size() > 0) other.boundary->ET += by * c.ET;
  DenseDynamics d = *s.dynamics->small_state();
  if (c.A.size() > 0) d.A += by * c.A;
  if (c.B.size() > 0) d.B += by * c.B;
  if (c.N.size() > 0) d.N += by * c.N;
  if (c.E.size() > 0) d.E += by * c.E;
  other.dynamics = d;
  return other;
}

// One member at a time.
std::vector<DataChange> members_of(const DataChange& all) {
  std::vector<DataChange> each;
  const auto add = [&](auto member) {
    if ((all.*member).size() > 0) each.emplace_back().*member = all.*member;
  };
  add(&DataChange::b), add(&DataChange::x0), add(&DataChange::f), add(&DataChange::g), add(&DataChange::M);
  add(&DataChange::A), add(&DataChange::B), add(&DataChange::N), add(&DataChange::E), add(&DataChange::E0);
  add(&DataChange::ET);
  return each;
}

void expect_differences(const Scene& s) {
  const Result at = solved(s);
  EXPECT_TRUE((at.y.array() > 0).any() && (at.y.array() == 0).any());
  const GalerkinDerivative d(s, at);
  ASSERT_GT(d.margin().margin, 1e-6);
  const std::vector<DataChange> changes = members_of(drawn_with_b(s, 3));
  for (std::size_t member = 0; member < changes.size(); ++member) {
    const DataChange& c = changes[member];
    const SolutionChange out = d.jvp(c);
    // The sets stay within the step; rounding of the solves over the step is left of the difference.
    const double step = 0.05 * d.margin().margin / (1 + out.y.cwiseAbs().maxCoeff() + out.w.cwiseAbs().maxCoeff());
    const Result up = solved(changed_ends(s, c, step)), down = solved(changed_ends(s, c, -step));
    const double rest = 1e-13 / step;
    const RowMatrix y = (up.y - down.y) / (2 * step), x = (up.x - down.x) / (2 * step);
    EXPECT_LE((out.y - y).cwiseAbs().maxCoeff(), 1e-6 * y.cwiseAbs().maxCoeff() + rest) << member;
    EXPECT_LE((out.x - x).cwiseAbs().maxCoeff(), 1e-6 * x.cwiseAbs().maxCoeff() + rest) << member;
    const auto area = [](const Result& r, Index k) {
      return RowMatrix(r.y_left.topRows(k).colwise().sum() + r.y.middleRows(1, k).colwise().sum());
    };
    for (const Index k : {Index(1), N / 2, N}) {
      const RowMatrix integral = s.T / double(N) / 2 * (area(up, k) - area(down, k)) / (2 * step);
      EXPECT_LE((out.integral.row(k) - integral).cwiseAbs().maxCoeff(), 1e-6 * integral.cwiseAbs().maxCoeff() + rest)
          << member;
    }
  }
}

void expect_transposed(const Scene& s) {
  const GalerkinDerivative d(s, solved(s));
  const DataChange c = drawn_with_b(s, 5);
  Random random(6);
  const Index n = s.constraints();
  const SolutionChange out = d.jvp(c);
  const SolutionChange of{random.matrix(N + 1, n), random.matrix(N + 1, s.states()), random.matrix(N + 1, n),
                          random.matrix(N + 1, n)};
  const DataChange bar = d.vjp(of);
  const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w) + dot(of.integral, out.integral);
  double backward = (s.boundary ? bar.b.dot(c.b) : bar.x0.dot(c.x0)) + dot(bar.f, c.f) + dot(bar.g, c.g);
  for (const auto member : {&DataChange::A, &DataChange::B, &DataChange::N, &DataChange::M, &DataChange::E,
                            &DataChange::E0, &DataChange::ET}) {
    ASSERT_EQ((bar.*member).size(), (c.*member).size());
    backward += (bar.*member).cwiseProduct(c.*member).sum();
  }
  const double size = of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm() + of.w.norm() * out.w.norm() +
                      of.integral.norm() * out.integral.norm();
  EXPECT_LE(std::abs(forward - backward), 1e-12 * size);
}

Scene with_initial_value() {
  Scene s = coupled_ends();
  s.boundary.reset();
  s.x0 = Random(12).vector(3);
  return s;
}

TEST(GalerkinDerivative, AgreesWithDifferencesOfSolves) {
  for (const Scene& s : {coupled_ends(), coupled_ends(true), coupled_ends(false, true), with_initial_value()})
    expect_differences(s);
}

// M is positive semidefinite and no P-matrix: its second row is zero, and that constraint never acts. With a free row M
// is not of class P, and its Schur complement is.
Scene beside_an_idle_constraint() {
  Scene s = coupled_ends();
  s.M = Matrix{{2, 0}, {0, 0}};
  s.lcp_class = LcpClass::PSD;
  s.g = [](double t, Eigen::Ref<Vector> v) { v << 2 * std::cos(4 * t) - 0.3, 50; };
  return s;
}
Scene with_a_negative_free_row() {
  Scene s = coupled_ends(true);
  s.M = Matrix{{3, 1, 0}, {-1, -2, 0.5}, {0.3, 0.5, 3}};
  s.lcp_class = LcpClass::automatic;
  return s;
}

TEST(GalerkinDerivative, TakesOtherMWhereYIsContinuous) {
  for (const Scene& s : {beside_an_idle_constraint(), with_a_negative_free_row()}) {
    expect_differences(s);
    expect_transposed(s);
  }
}

TEST(GalerkinDerivative, PassesAreTransposed) {
  for (const Scene& s : {coupled_ends(), coupled_ends(true), coupled_ends(false, true), with_initial_value()})
    expect_transposed(s);
  expect_transposed(make_scene("periodic-rectifier", {}));
}

// x' = x + f, x(0) + x(T) = b: x(0) = (b - ∫ e^{T-s} f)/(1 + e^T), and y never acts.
TEST(GalerkinDerivative, OfALinearProblem) {
  Scene s;
  s.dynamics = DenseDynamics{Matrix::Ones(1, 1), Matrix::Ones(1, 1), Matrix::Zero(1, 1)};
  s.M = Matrix(Matrix::Ones(1, 1));
  s.g = [](double, Eigen::Ref<Vector> v) { v[0] = 1; };
  s.T = 1.5;
  s.boundary = BoundaryCondition{Matrix::Ones(1, 1), Matrix::Ones(1, 1), Vector::Ones(1)};
  const GalerkinDerivative d(s, solved(s));
  DataChange c;
  c.b = Vector::Ones(1);
  const double first = 1 / (1 + std::exp(1.5));
  EXPECT_NEAR(d.jvp(c).x(0, 0), first, 1e-14);
  EXPECT_NEAR(d.jvp(c).x(N, 0), std::exp(1.5) * first, 1e-14);
  SolutionChange of;
  of.x = RowMatrix::Zero(N + 1, 1);
  of.x(0, 0) = 1;
  const DataChange bar = d.vjp(of);
  EXPECT_NEAR(bar.b[0], first, 1e-14);
  EXPECT_NEAR(bar.f.sum(), -(std::exp(1.5) - 1) * first, 1e-14);  // of a constant f
}

TEST(GalerkinDerivative, Refuses) {
  const Scene s = coupled_ends();
  const Result r = solved(s);
  const GalerkinDerivative d(s, r);
  const auto of_change = [&](auto set) {
    DataChange c;
    set(c);
    return refusal([&] { d.jvp(c); });
  };
  EXPECT_NE(of_change([](DataChange& c) { c.A = Matrix::Zero(2, 3); }).find("give 3 x 3"), std::string::npos);
  EXPECT_NE(of_change([](DataChange& c) { c.E = Matrix::Zero(3, 3); }).find("has no E"), std::string::npos);
  EXPECT_NE(of_change([](DataChange& c) { c.x0 = Vector::Zero(3); }).find("change b"), std::string::npos);
  EXPECT_NE(of_change([](DataChange& c) { c.b = Vector::Zero(2); }).find("give 3 x 1"), std::string::npos);
  const auto of_result = [&](auto set) {
    Scene other = s;
    Result result = r;
    set(other, result);
    return refusal([&] { GalerkinDerivative(other, result); });
  };
  EXPECT_NE(of_result([](Scene&, Result& x) { x.y *= 1.01; }).find("do not give its y"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.status = Status::infeasible; }).find("not solved"), std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.method = Method::march; }).find("method march"), std::string::npos);
  EXPECT_NE(of_result([](Scene& x, Result&) {
              x.dynamics = DenseDynamics{Matrix::Ones(1, 1), Matrix(1, 0), Matrix(0, 1)};
            }).find("no constraints"),
            std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) {
              x.interval_rules.assign(std::size_t(N), IntervalRule::radau);
            }).find("M_SS is singular on an active set, and y may jump"),
            std::string::npos);
  EXPECT_NE(of_result([](Scene&, Result& x) { x.y_left = x.y_left.topRows(4).eval(); }).find("other rows"),
            std::string::npos);
}

}  // namespace
}  // namespace bromwich::galerkin_derivative_test
