// Derivatives of Kronecker sums against central differences of solves, and against those of the dense matrices.

#include "derivatives/modal_derivative.hpp"

#include "catalogue/catalogue.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/derivatives/drawn_changes.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich::modal_derivative_test {
namespace {

using namespace derivative_test;

Result solved(const Scene& scene, Index J, Method method = Method::march) {
  Options options;
  options.steps = J;
  options.method = method;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

void expect_transposed(const ModalDerivative& d, const Scene& s, Index J) {
  const DataChange c = drawn(s, J, 5);
  Random random(6);
  const Index n = s.constraints();
  const SolutionChange out = d.jvp(c, true);
  const SolutionChange of{random.matrix(J + 1, n), random.matrix(J + 1, s.states()), random.matrix(J + 1, n),
                          random.matrix(J + 1, n)};
  const DataChange bar = d.vjp(of);
  const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w) + dot(of.integral, out.integral);
  const double backward = bar.x0.dot(c.x0) + dot(bar.f, c.f) + dot(bar.g, c.g) + dot(bar.M, c.M);
  const double size = of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm() + of.w.norm() * out.w.norm() +
                      of.integral.norm() * out.integral.norm();
  EXPECT_LE(std::abs(forward - backward), 1e-12 * size);
}

// Two programs for one discrete solution: modes with one state at a time, and dense matrices.
TEST(ModalDerivative, IsThatOfTheDenseMatrices) {
  for (const char* name : {"signorini", "signorini3d", "with ends that reflect"}) {
    const Index J = 40;
    Scene s =
        warmed(std::string(name) == "signorini3d" ? name : "signorini", std::string(name) == "signorini3d" ? 4 : 9);
    if (std::string(name).starts_with("with")) {
      KroneckerDynamics& d = get<KroneckerDynamics>(s.dynamics);
      d.along.first = 1, d.along.last = 0.4, d.across.last = 1;
    }
    const Scene dense = written_out(s);
    const Matrix B = dense.dynamics->small_state()->B;
    const Result r = solved(s, J);
    const ModalDerivative modal(s, r);
    const SolutionDerivative other(dense, r);
    EXPECT_NEAR(modal.margin().margin, other.margin().margin, 1e-9);
    ASSERT_GT(modal.margin().margin, 1e-9);
    DataChange c = drawn(s, J, 3), written = c;
    written.f = c.f * B.transpose();
    const SolutionChange a = modal.jvp(c, true), b = other.jvp(written);
    // The exponential of the dense matrices has rounding of h |A| eps, of which 40 steps add up: below 1e-11.
    EXPECT_LE((a.y - b.y).norm(), 1e-10 * b.y.norm()) << name;
    EXPECT_LE((a.x - b.x).norm(), 1e-10 * b.x.norm()) << name;
    EXPECT_LE((a.w - b.w).norm(), 1e-10 * b.w.norm()) << name;
    EXPECT_LE((a.integral - b.integral).norm(), 1e-10 * b.integral.norm()) << name;
    Random random(4);
    const SolutionChange of{random.matrix(J + 1, s.constraints()), {}, random.matrix(J + 1, s.constraints()), {}};
    const DataChange u = modal.vjp(of), v = other.vjp(of);
    EXPECT_LE((u.x0 - v.x0).norm(), 1e-10 * v.x0.norm()) << name;
    EXPECT_LE((u.g - v.g).norm(), 1e-10 * v.g.norm()) << name;
    EXPECT_LE((u.M - v.M).norm(), 1e-10 * v.M.norm()) << name;
    EXPECT_LE((u.f - v.f * B).norm(), 1e-10 * (v.f * B).norm()) << name;
    expect_transposed(modal, s, J);
  }
}

// More states than the dense derivative takes.
TEST(ModalDerivative, AgreesWithDifferencesOfSolves) {
  const Index J = 48;
  const Scene s = warmed("signorini", 63, 0.5);
  for (const Method method : {Method::march, Method::contour}) {
    const ModalDerivative d(s, solved(s, J, method));
    ASSERT_GT(d.margin().margin, 1e-8);
    const DataChange all = drawn(s, J, 9);
    for (int member = 0; member < 4; ++member) {
      DataChange c;
      if (member == 0) c.x0 = all.x0;
      if (member == 1) c.f = all.f;
      if (member == 2) c.g = all.g;
      if (member == 3) c.M = all.M;
      // The sets stay within the step; the solves end at 1e-12, that over the step is left of the difference.
      const SolutionChange out = d.jvp(c);
      const double step = 0.2 * d.margin().margin / (1 + out.y.cwiseAbs().maxCoeff() + out.w.cwiseAbs().maxCoeff());
      const Result up = solved(changed(s, c, step), J), down = solved(changed(s, c, -step), J);
      const RowMatrix y = (up.y - down.y) / (2 * step);
      EXPECT_LE((out.y - y).cwiseAbs().maxCoeff(), 1e-6 * y.cwiseAbs().maxCoeff() + 1e-13 / step)
          << member << " " << to_string(method);
    }
    expect_transposed(d, s, J);
  }
}

// The parameters of the sum, with decay and ends that reflect.
TEST(ModalDerivative, ByTheDynamicsAgreesWithDifferencesOfSolves) {
  const Index J = 40;
  Scene s = warmed("signorini", 9);
  {
    KroneckerDynamics& d = get<KroneckerDynamics>(s.dynamics);
    d.along.first = 1, d.across.last = 0.4, d.along.decay = 0.1, d.across.decay = 0.3;
  }
  const ModalDerivative derivative(s, solved(s, J));
  ASSERT_GT(derivative.margin().margin, 1e-8);
  const auto scene_with = [&](const KroneckerChange& c) {
    Scene other = s;
    KroneckerDynamics& d = get<KroneckerDynamics>(other.dynamics);
    d.along.diffusivity *= 1 + c.face, d.across.diffusivity *= 1 + c.across;
    d.along.decay += c.decay, d.b *= 1 + c.input, d.n *= 1 + c.output;
    return other;
  };
  Random random(7);
  const SolutionChange of{random.matrix(J + 1, s.constraints()), random.matrix(J + 1, s.states()),
                          random.matrix(J + 1, s.constraints()), random.matrix(J + 1, s.constraints())};
  const DataChange gradient = derivative.vjp(of);
  const auto solve_all = [](const Scene& scene) {
    Options options;
    options.steps = J;
    options.method = Method::march;
    options.states = StateSelection::all;
    return solve(scene, *make_cpu_backend(1), options);
  };
  const KroneckerChange changes[] = {{.face = 1},  {.across = 1}, {.decay = 1},
                                     {.input = 1}, {.output = 1}, {1, -0.5, 0.3, 0.2, -0.7}};
  for (const KroneckerChange& c : changes) {
    const SolutionChange out = derivative.jvp(c, true);
    const double step =
        0.2 * derivative.margin().margin / (1 + out.y.cwiseAbs().maxCoeff() + out.w.cwiseAbs().maxCoeff());
    const auto times = [&](double by) {
      return KroneckerChange{by * c.face, by * c.across, by * c.decay, by * c.input, by * c.output};
    };
    const Result up = solve_all(scene_with(times(step))), down = solve_all(scene_with(times(-step)));
    const RowMatrix y = (up.y - down.y) / (2 * step), x = (up.x - down.x) / (2 * step);
    EXPECT_LE((out.y - y).cwiseAbs().maxCoeff(), 1e-6 * y.cwiseAbs().maxCoeff() + 1e-13 / step);
    EXPECT_LE((out.x - x).cwiseAbs().maxCoeff(), 1e-6 * x.cwiseAbs().maxCoeff() + 1e-13 / step);
    const double forward = dot(of.y, out.y) + dot(of.x, out.x) + dot(of.w, out.w) + dot(of.integral, out.integral);
    const double size = of.y.norm() * out.y.norm() + of.x.norm() * out.x.norm() + of.w.norm() * out.w.norm() +
                        of.integral.norm() * out.integral.norm();
    EXPECT_LE(std::abs(forward - derivative.along(c, of, gradient)), 1e-12 * size);
  }
}

// y_i = w_i = 0 at t = 0. Changes of states that no constraint sees leave w(0), but for rounding of the transforms.
TEST(ModalDerivative, FromRest) {
  Scene s = warmed("signorini", 5);
  s.x0.setZero();
  s.f = {};
  s.g = [](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = std::sin((5 + 0.3 * double(i)) * t);
  };
  const Index J = 16;
  const ModalDerivative d(s, solved(s, J));
  const Matrix N = get<DenseDynamics>(written_out(s).dynamics).N;
  DataChange c;
  c.x0 = Random(3).vector(s.states());
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("at t = 0"), std::string::npos) << "w(0) moves";
  for (Index k = 0; k < c.x0.size(); ++k)
    if (N.col(k).norm() > 0) c.x0[k] = 0;
  ASSERT_GT(c.x0.norm(), 0);
  const SolutionChange out = d.jvp(c);
  const double step = 1e-2 * d.margin().margin;
  const Result up = solved(changed(s, c, step), J), down = solved(changed(s, c, -step), J);
  EXPECT_LE(((up.y - down.y) / (2 * step) - out.y).norm(), 1e-6 * out.y.norm());
  // The gradient has the data that leave w(0).
  SolutionChange of;
  of.y = Random(4).matrix(J + 1, 5);
  const DataChange bar = d.vjp(of);
  EXPECT_EQ(bar.x0.size(), 0);
  EXPECT_EQ(bar.g.size(), 0);
  c = {};
  c.f = Random(5).matrix(J + 1, 5);
  const SolutionChange by_f = d.jvp(c);
  EXPECT_NEAR(dot(bar.f, c.f), dot(of.y, by_f.y), 1e-12 * of.y.norm() * by_f.y.norm());
  const KroneckerChange wider{.face = 1};
  EXPECT_NE(refusal([&] { d.along(wider, of, bar); }).find("one-sided"), std::string::npos);
}

TEST(ModalDerivative, Refuses) {
  const Scene s = warmed("signorini", 5);
  const Result r = solved(s, 16);
  const ModalDerivative d(s, r);
  DataChange c;
  c.A = Matrix::Zero(25, 25);
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("part of the structure"), std::string::npos);
  c = {};
  c.x0 = Vector::Zero(24);
  EXPECT_NE(refusal([&] { d.jvp(c); }).find("give 25 x 1"), std::string::npos);
  EXPECT_NE(refusal([&] { ModalDerivative(written_out(s), r); }).find("no Kronecker sum"), std::string::npos);
  Result other = r;
  other.y *= 1.01;
  EXPECT_NE(refusal([&] { ModalDerivative(s, other); }).find("do not give y"), std::string::npos);
}

}  // namespace
}  // namespace bromwich::modal_derivative_test
