// Derivatives with respect to parameters against central differences of whole solves, and where y jumps against those
// of the event-located oracle. Gradients against the transpose, and what is refused.

#include "derivatives/parameter_derivative.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/scene/relay.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/oracle_events.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/refusal.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich::parameter_test {
namespace {

using reference::Random;
using Make = std::function<Scene(double)>;

VariedParameter parameter(const Make& make, double value, const std::string& name = "p") {
  return {name, value, [make](double v) { return ParameterScene{make(v)}; }};
}

Result solved_with(const Scene& scene, Index steps, Method method = Method::march) {
  Options options;
  options.steps = steps;
  options.method = method;
  options.states = scene.states() > 1000 ? StateSelection::none : StateSelection::all;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

ParameterDerivative derivative_of(const Make& make, double p, Index steps, Method method = Method::march) {
  static const auto backend = make_cpu_backend(1);
  const Scene scene = make(p);
  return ParameterDerivative(scene, solved_with(scene, steps, method), *backend, {parameter(make, p)});
}

// All data depend on p. Three states, two constraints, M of class P.
Scene everything(double p, bool mass = false, bool ends = false) {
  Random random(21);
  const Index m = 3, n = 2;
  const auto both = [&](Index rows, Index cols) {
    const Matrix a = random.matrix(rows, cols), b = random.matrix(rows, cols);
    return Matrix(a + 0.3 * std::sin(2 * p) * b);
  };
  Scene s;
  DenseDynamics d{both(m, m) - 2 * Matrix::Identity(m, m), both(m, n), both(n, m)};
  if (mass) d.E = both(m, m) + 4 * Matrix::Identity(m, m);
  s.dynamics = d;
  s.M = Matrix(both(n, n) + 3 * Matrix::Identity(n, n));
  s.lcp_class = LcpClass::P;
  s.T = 2;
  s.f = [p](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = 2 * std::sin(3 * p * t + double(i));
  };
  s.g = [p](double t, Eigen::Ref<Vector> v) {
    for (Index i = 0; i < v.size(); ++i) v[i] = 2 * p * std::cos(4 * t + 0.7 * double(i)) - 0.3;
  };
  s.breakpoints_are_all = true;
  if (ends)
    s.boundary = BoundaryCondition{both(m, m) + 2 * Matrix::Identity(m, m), 0.3 * both(m, m), both(m, 1)};
  else
    s.x0 = both(m, 1);
  return s;
}

// The derivative, and differences of solves with a step that keeps the active sets to first order.
void expect_differences_of_solves(const Make& make, double p, Index steps, Method method = Method::march) {
  const ParameterDerivative d = derivative_of(make, p, steps, method);
  const SolutionChange out = d.jvp(0);
  const double margin = d.of_data().margin().margin;
  ASSERT_GT(margin, 1e-6);
  const double step = 0.05 * margin / (1 + out.y.cwiseAbs().maxCoeff() + out.w.cwiseAbs().maxCoeff());
  const Result up = solved_with(make(p + step), steps, method), down = solved_with(make(p - step), steps, method);
  const double rest = 1e-13 / step;  // rounding of the solves over the step
  const RowMatrix y = (up.y - down.y) / (2 * step);
  EXPECT_GT(y.cwiseAbs().maxCoeff(), 0);
  EXPECT_LE((out.y - y).cwiseAbs().maxCoeff(), 1e-6 * y.cwiseAbs().maxCoeff() + rest);
  if (out.x.size() == 0) return;
  const RowMatrix x = (up.x - down.x) / (2 * step);
  EXPECT_LE((out.x - x).cwiseAbs().maxCoeff(), 1e-6 * x.cwiseAbs().maxCoeff() + rest);
}

TEST(ParameterDerivative, AgreesWithDifferencesOfSolves) {
  expect_differences_of_solves([](double p) { return everything(p); }, 0.7, 60);
  expect_differences_of_solves([](double p) { return everything(p, true); }, 0.7, 60);
  EXPECT_EQ(derivative_of([](double p) { return everything(p); }, 0.7, 60).of_data().form(), DerivativeForm::discrete);
}

// 1600 states in modes: the diffusivity c enters the sum and B.
TEST(ParameterDerivative, OfAKroneckerSum) {
  const Make make = [](double c) { return make_scene("signorini", {{"Q", 40}, {"c", c}}); };
  const ParameterDerivative d = derivative_of(make, 0.06, 48);
  EXPECT_EQ(d.of_data().form(), DerivativeForm::modes);
  expect_differences_of_solves(make, 0.06, 48);
  Random random(2);
  SolutionChange of;
  of.y = random.matrix(49, 40);
  const SolutionChange out = d.jvp(0);
  EXPECT_NEAR(d.vjp(of)[0], of.y.cwiseProduct(out.y).sum(), 1e-10 * of.y.norm() * out.y.norm());
}

// 1600 sparse states: g depends on p, and A may not.
TEST(ParameterDerivative, OfSparseDynamics) {
  const auto make = [](bool in_A) {
    return [in_A](double p) {
      Scene s = make_scene("signorini", {{"Q", 40}});
      SparseDynamics d = to_sparse(*s.dynamics->modes());
      if (in_A) d.A *= p;
      s.dynamics = d;
      const TimeFunction g = s.g;
      s.g = [g, p](double t, Eigen::Ref<Vector> v) {
        g(t, v);
        v.array() += 0.1 * p * std::cos(3 * t);
      };
      return s;
    };
  };
  expect_differences_of_solves(make(false), 0.9, 24);
  EXPECT_NE(refusal([&] { derivative_of(make(true), 0.9, 24); }).find("changes the dynamics"), std::string::npos);
}

// Several parameters: the gradient is the transpose, and a change of all is the sum.
TEST(ParameterDerivative, PassesAreTransposed) {
  const auto scene_of = [](double p, double q) {
    Scene s = everything(p);
    s.x0 *= q;
    return s;
  };
  const double p = 0.7, q = 1.1;
  const Scene scene = scene_of(p, q);
  const auto backend = make_cpu_backend(1);
  const ParameterDerivative d(scene, solved_with(scene, 50), *backend,
                              {parameter([&](double v) { return scene_of(v, q); }, p, "p"),
                               parameter([&](double v) { return scene_of(p, v); }, q, "q")});
  Random random(3);
  const SolutionChange of{random.matrix(51, 2), random.matrix(51, 3), random.matrix(51, 2), random.matrix(51, 2)};
  const auto weighed = [&](const SolutionChange& c) {
    return of.y.cwiseProduct(c.y).sum() + of.x.cwiseProduct(c.x).sum() + of.w.cwiseProduct(c.w).sum() +
           of.integral.cwiseProduct(c.integral).sum();
  };
  const Vector gradient = d.vjp(of);
  for (Index i = 0; i < 2; ++i) EXPECT_NEAR(weighed(d.jvp(i)), gradient[i], 1e-10 * (1 + std::abs(gradient[i])));
  EXPECT_NEAR(weighed(d.jvp(Vector{{0.3, -2}})), 0.3 * gradient[0] - 2 * gradient[1], 1e-9);
  EXPECT_EQ(d.names(), (std::vector<std::string>{"p", "q"}));
  EXPECT_NE(refusal([&] { d.jvp(Vector{{1}}); }).find("give 2"), std::string::npos);
}

oracle::EventSolution located_oracle(const Scene& s) {
  const DenseDynamics& d = *s.dynamics->small_state();
  oracle::EventScene e;
  e.scene.A = d.A, e.scene.B = d.B, e.scene.N = d.N, e.scene.M = to_dense(s.M);
  e.scene.f = s.f ? s.f : [](double, Eigen::Ref<Vector> v) { v.setZero(); };
  e.scene.g = s.g ? s.g : [](double, Eigen::Ref<Vector> v) { v.setZero(); };
  e.scene.x0 = s.x0, e.scene.T = s.T, e.scene.lcp_class = s.lcp_class;
  for (const double t : s.breakpoints)
    if (t > 0 && t < s.T) e.breaks.push_back(t);
  e.longest_step = s.T / 20;
  return oracle::locate_events(e);
}

// At times that no switch of the three solutions is near.
void expect_located_differences(const Make& make, double p, Index steps, double tolerance) {
  const ParameterDerivative d = derivative_of(make, p, steps, Method::automatic);
  ASSERT_TRUE(d.of_data().located());
  const double step = 1e-5 * p;
  const oracle::EventSolution up = located_oracle(make(p + step)), down = located_oracle(make(p - step));
  ASSERT_TRUE(up.decided && down.decided) << up.reason << down.reason;
  const SolutionChange out = d.jvp(0);
  RowMatrix x = out.x, integral = out.integral;
  for (Index j = 0; j < d.times().size(); ++j) {
    const double t = d.times()[j];
    bool near = false;
    for (const double s : d.of_data().switched()->switches()) near = near || std::abs(s - t) < 1e-3 * make(p).T;
    x.row(j) -= ((up.x(t) - down.x(t)) / (2 * step)).transpose();
    integral.row(j) -= ((up.integral(t) - down.integral(t)) / (2 * step)).transpose();
    if (near) x.row(j).setZero(), integral.row(j).setZero();
  }
  EXPECT_LE(x.cwiseAbs().maxCoeff(), tolerance * out.x.cwiseAbs().maxCoeff());
  EXPECT_LE(integral.cwiseAbs().maxCoeff(), tolerance * out.integral.cwiseAbs().maxCoeff());
}

// q'' = -k q - mu sgn q' + 1.2 cos(w t): lambda jumps where q' changes its sign.
Scene with_friction(double mu, double k, double w) {
  Scene scene = relay_scene(
      Matrix{{0, 1}, {-k, 0}}, Matrix{{0}, {mu}}, Matrix{{0, 1}},
      [w](double t, Eigen::Ref<Vector> v) { v << 0, 1.2 * std::cos(w * t); }, Vector{{1, 0.3}});
  scene.breakpoints_are_all = true;
  scene.T = 8;
  return scene;
}

TEST(ParameterDerivative, AgreesWithTheOracleThroughJumps) {
  expect_located_differences([](double mu) { return with_friction(mu, 2, 0.9); }, 0.5, 200, 1e-4);
  expect_located_differences([](double k) { return with_friction(0.5, k, 0.9); }, 2, 200, 1e-4);
  expect_located_differences([](double w) { return with_friction(0.5, 2, w); }, 0.9, 200, 1e-4);
}

// f = max(sin(p t), 0): its kinks move with p, and its change has other limits on both sides of them. The derivative of
// the discrete solution is refused, since f bends inside steps, and switches are located.
TEST(ParameterDerivative, FollowsKinksThatMove) {
  const Make make = [](double p) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{-0.3}}, Matrix{{1}}, Matrix{{1}}};
    s.M = Matrix{{1}};
    s.f = [p](double t, Eigen::Ref<Vector> v) { v[0] = std::max(std::sin(p * t), 0.0) - 0.4; };
    for (int k = 1; k * reference::pi / p < 5; ++k) s.breakpoints.push_back(k * reference::pi / p);
    s.breakpoints_are_all = true;
    s.x0 = Vector{{0.5}};
    s.T = 5;
    return s;
  };
  expect_located_differences(make, 1.9, 100, 1e-5);
}

// Pulses whose ends move with p: x' = 1 between 0.3 + p and 1.1 + 2p, held off by a contact that y = max(-x, 0) makes.
TEST(ParameterDerivative, FollowsJumpsThatMove) {
  const auto make = [](bool stated, bool in_g) {
    return [=](double p) {
      Scene s;
      s.dynamics = DenseDynamics{Matrix{{-0.2}}, Matrix{{1}}, Matrix{{1}}};
      s.M = Matrix{{1}};
      const TimeFunction pulse = [p](double t, Eigen::Ref<Vector> v) {
        v[0] = t >= 0.3 + p && t < 1.1 + 2 * p ? 1 + 0.2 * p * t : -0.7;
      };
      (in_g ? s.g : s.f) = pulse;
      if (stated) s.breakpoints = {0.3 + p, 1.1 + 2 * p};
      s.breakpoints_are_all = stated;
      s.x0 = Vector{{0.2}};
      s.T = 3;
      return s;
    };
  };
  expect_located_differences(make(true, false), 0.113, 100, 1e-5);
  expect_located_differences(make(true, true), 0.113, 100, 1e-5);
  const ParameterDerivative searched = derivative_of(make(false, true), 0.113, 100, Method::automatic),
                            stated = derivative_of(make(true, true), 0.113, 100, Method::automatic);
  EXPECT_LE((searched.jvp(0).x - stated.jvp(0).x).cwiseAbs().maxCoeff(), 1e-7);
  SolutionChange of;
  of.x = RowMatrix::Ones(101, 1);
  EXPECT_NEAR(stated.vjp(of)[0], stated.jvp(0).x.sum(), 1e-10 * stated.jvp(0).x.norm());
  // With p = 0.11 the second jump is at a time point: its row is the limit from the right, and has no weight.
  const ParameterDerivative at_a_row = derivative_of(make(true, true), 0.11, 100, Method::automatic);
  EXPECT_EQ(at_a_row.one_sided(), std::vector<Index>{44});
  EXPECT_NE(refusal([&] { at_a_row.vjp(of); }).find("is at a switch"), std::string::npos);
}

// A source with values of its own at 0 and T, as sign(sin(2 pi t)) has them: the limits from inside count. By hand:
// x' = p with x(0) = 1 has dx(T)/dp = T; x' = y = -x - p, held active, has dx(T)/dp = e^{-T} - 1. The tolerance is that
// of an integration to 1e-11 and of data by differences.
TEST(ParameterDerivative, SourcesHaveTheirLimitsAtTheEnds) {
  for (const bool in_g : {false, true}) {
    const Make make = [in_g](double p) {
      Scene s;
      s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
      s.M = Matrix{{1}};
      s.T = 2;
      (in_g ? s.g : s.f) = [p](double t, Eigen::Ref<Vector> v) { v[0] = t > 0 && t < 2 ? p : 0; };
      s.breakpoints_are_all = true;
      s.x0 = Vector{{in_g ? -3.0 : 1.0}};
      return s;
    };
    const double p = 0.5, expected = in_g ? std::exp(-2.0) - 1 : 2;
    const auto backend = make_cpu_backend(1);
    const Scene scene = make(p);
    const ParameterDerivative d(scene, solved_with(scene, 4), *backend, {parameter(make, p)}, true);
    EXPECT_NEAR(d.jvp(0).x(4, 0), expected, 1e-8) << in_g;
    SolutionChange of;
    of.x = RowMatrix::Zero(5, 1);
    of.x(4, 0) = 1;
    EXPECT_NEAR(d.vjp(of)[0], expected, 1e-8) << in_g;
  }
}

// By hand: x' = f with f = 1 up to p and 0 after, so that x(T) = x0 + p. And with a set that changes at the jump.
TEST(ParameterDerivative, OfTheTimeOfAJump) {
  const Make make = [](double p) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{0}}, Matrix{{1}}, Matrix{{1}}};
    s.M = Matrix(Matrix::Zero(1, 1));
    s.f = [p](double t, Eigen::Ref<Vector> v) { v[0] = t < p ? 1 : -2; };
    s.breakpoints = {p};
    s.breakpoints_are_all = true;
    s.x0 = Vector{{0.5}};
    s.T = 2;
    return s;
  };
  const ParameterDerivative d = derivative_of(make, 0.6, 50, Method::automatic);
  const Index before = 20, last = 50;  // t = 0.8; the contact begins at t = p + (0.5 + p)/2 = 1.15
  EXPECT_NEAR(d.jvp(0).x(before, 0), 3, 1e-9);
  EXPECT_NEAR(d.jvp(0).x(last, 0), 0, 1e-9);
  EXPECT_NEAR(d.jvp(0).integral(last, 0), -2 * 1.5, 1e-9) << "of y = 2 from then on";
}

TEST(ParameterDerivative, OfAQuantityThatDependsOnTheParameter) {
  // x' = -p x, I = p ∫ x^2 + x(T): I = x0^2 (1 - e^{-2pT})/2 + x0 e^{-pT}, dI/dp = x0^2 T e^{-2pT} - x0 T e^{-pT}.
  const double x0 = 2, T = 1, p = 0.8;
  const auto make = [&](double v) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{-v}}, Matrix{{1}}, Matrix{{0}}};
    s.M = Matrix{{1}};
    s.g = [](double, Eigen::Ref<Vector> w) { w[0] = 1; };
    s.breakpoints_are_all = true;
    s.x0 = Vector{{x0}};
    s.T = T;
    QuadraticQuantity q;
    q.W = Matrix{{v}}.sparseView();
    q.end_c = Vector{{1}};
    return ParameterScene{s, quadratic_quantity(q, 1)};
  };
  const Scene scene = make(p).scene;
  const auto backend = make_cpu_backend(1);
  const Index steps = 400;
  const ParameterDerivative d(scene, solved_with(scene, steps), *backend, {{"p", p, make}});
  const QuantityByParameters found = d.quantity();
  const double e = std::exp(-p * T), error = 4.0 / double(steps * steps);  // of x linear between time points
  EXPECT_NEAR(found.value, x0 * x0 * (1 - e * e) / 2 + x0 * e, error);
  EXPECT_NEAR(found.gradient[0], x0 * x0 * T * e * e - x0 * T * e, error);
}

// Data that oscillate many times on 1e-3 of the parameter are differentiated with a smaller distance.
TEST(ParameterDerivative, ChoosesItsDistance) {
  const Make make = [](double p) {
    Scene s;
    s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
    s.M = Matrix{{1}};
    s.x0 = Vector{{2 + std::sin(5000 * p)}};
    s.T = 1;
    return s;
  };
  const ParameterDerivative d = derivative_of(make, 1, 10);
  EXPECT_LT(d.distance(), 1e-3);
  EXPECT_NEAR(d.jvp(0).x(0, 0), 5000 * std::cos(5000.0), 1e-5 * 5000);
}

TEST(ParameterDerivative, Refuses) {
  const auto with = [](const std::function<void(Scene&, double)>& set) {
    return [set](double p) {
      Scene s;
      s.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
      s.M = Matrix{{1}};
      s.g = [](double t, Eigen::Ref<Vector> v) { v[0] = std::sin(3 * t + 0.5); };
      s.breakpoints_are_all = true;
      s.x0 = Vector{{1}};
      s.T = 1;
      set(s, p);
      return s;
    };
  };
  const auto why = [&](const std::function<void(Scene&, double)>& set, double p = 1) {
    return refusal([&] { derivative_of(with(set), p, 20); });
  };
  EXPECT_NE(why([](Scene& s, double p) { s.T = p; }).find("by p: T depends on it"), std::string::npos);
  EXPECT_NE(why([](Scene& s, double p) { s.x0[0] = std::abs(p - 1); }).find("x0 is not differentiable at p = 1"),
            std::string::npos);
  EXPECT_NE(why([](Scene& s, double p) { s.x0[0] = std::floor(p); }).find("x0 is not differentiable at p = 1"),
            std::string::npos);
  // A pulse that appears with p.
  const std::string jump = why(
      [](Scene& s, double p) {
        s.g = [p](double t, Eigen::Ref<Vector> v) { v[0] = t < p ? 1 : -1; };
        if (p >= 0.5) s.breakpoints = {p};
      },
      0.5);
  EXPECT_NE(jump.find("jumps of f and g appear or vanish with it"), std::string::npos) << jump;
  const std::string none = why([](Scene& s, double p) {
    if (p > 1) throw Error("p", "is above 1", "give less");
    s.x0[0] = p;
  });
  EXPECT_NE(none.find("there is no scene with p = 1."), std::string::npos) << none;
  const auto backend = make_cpu_backend(1);
  const Scene scene = with([](Scene&, double) {})(1);
  Result bad = solved_with(scene, 20);
  EXPECT_NE(refusal([&] { ParameterDerivative(scene, bad, *backend, {}); }).find("is empty"), std::string::npos);
  bad.status = Status::infeasible;
  EXPECT_NE(refusal([&] {
              ParameterDerivative(scene, bad, *backend, {parameter(with([](Scene&, double) {}), 1)});
            }).find("not solved"),
            std::string::npos);
}

}  // namespace
}  // namespace bromwich::parameter_test
