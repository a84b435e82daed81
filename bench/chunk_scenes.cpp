#include "bench/chunk_scenes.hpp"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace bromwich::study {

namespace {

constexpr double pi = std::numbers::pi;

struct Parts {
  Matrix A, B, N, M;
  Vector x0;
};

Scene scene_of(const std::string& name, const Parts& parts, double step, Index steps) {
  Scene scene;
  scene.name = name;
  scene.dynamics = DenseDynamics{parts.A, parts.B, parts.N};
  scene.M = parts.M;
  scene.x0 = parts.x0;
  scene.T = step * double(steps);
  scene.default_steps = steps;
  scene.breakpoints_are_all = true;
  return scene;
}

// At the rows of the grid, where the sources jump: every `each` steps and `after` steps later.
void jumps(Scene& scene, Index each, Index after, double step) {
  const Index steps = scene.default_steps;
  for (Index j = 0; j < steps; j += each)
    for (const Index at : {j, j + after})
      if (at > 0 && at < steps) scene.breakpoints.push_back(step * double(at));
}

// Whether t lies in the first `part` of its period; jumps belong to what follows.
bool on(double t, double period, double part) {
  const double phase = t / period, within = phase - std::floor(phase + 1e-9);
  return within < part - 1e-9;
}

// Three diodes in a row between four grounded capacitors, driven by a sine and loaded at the end.
Scene ladder(Index steps) {
  constexpr Index k = 3, m = k + 1;
  const double C = 1e-6, R = 10, period = 1e-3, step = period / 100;
  Parts p{Matrix::Zero(m, m), Matrix::Zero(m, k), Matrix::Zero(k, m), 0.5 * Matrix::Identity(k, k), Vector::Zero(m)};
  p.A(0, 0) = -1 / (R * C);
  p.A(k, k) = -1 / (1e4 * C);
  for (Index i = 0; i < k; ++i) {
    p.B(i, i) -= 1 / C;
    p.B(i + 1, i) += 1 / C;
    p.N(i, i) = -1;
    p.N(i, i + 1) = 1;
  }
  Scene scene = scene_of("ladder", p, step, steps);
  scene.f = [=](double t, Eigen::Ref<Vector> f) {
    f.setZero();
    f[0] = 10 / (R * C) * std::sin(2 * pi * t / period);
  };
  return scene;
}

// A buck converter with an ideal freewheeling diode, in discontinuous conduction.
Scene buck(Index steps) {
  const double L = 1e-4, C = 1e-4, R = 50, period = 5e-5, step = period / 100;
  Parts p{Matrix{{0, -1 / L}, {1 / C, -1 / (R * C)}}, Matrix{{1 / L}, {0}}, Matrix{{1, 0}}, Matrix{{0}},
          Vector::Zero(2)};
  Scene scene = scene_of("buck", p, step, steps);
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f << (on(t, period, 0.5) ? 10 : -6) / L, 0; };
  jumps(scene, 100, 50, step);
  return scene;
}

// Four ideal diodes between a driven resonator and a resistor; M is skew but for the resistor.
Scene diode_bridge(Index steps) {
  const double R = 1e3, L = 1e-2, C = 1e-6, period = 1e-3, step = period / 400;
  Parts p;
  p.A = Matrix{{0, -1 / C}, {1 / L, 0}};
  p.B = Matrix{{0, 0, -1 / C, 1 / C}, {0, 0, 0, 0}};
  p.N = Matrix{{0, 0}, {0, 0}, {-1, 0}, {1, 0}};
  p.M = Matrix{{1 / R, 1 / R, -1, 0}, {1 / R, 1 / R, 0, -1}, {1, 0, 0, 0}, {0, 1, 0, 0}};
  p.x0 = Vector{{10, 0}};
  Scene scene = scene_of("diode-bridge", p, step, steps);
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f << 2 * pi / period * 10 * std::cos(2 * pi * t / period), 0; };
  return scene;
}

// A relay in the loop of a plant of third order, on its limit cycle.
Scene relay_feedback(Index steps) {
  const double step = 2.5e-3;
  const Vector b{{1, -2, 1}};
  Parts p;
  p.A = Matrix{{-3.5, 1, 0}, {-627.5, 0, 1}, {-625, 0, 0}};
  p.B = Matrix::Zero(3, 2);
  p.B.col(0) = b;
  p.N = Matrix{{1, 0, 0}, {0, 0, 0}};
  p.M = Matrix{{0, 1}, {-1, 0}};
  p.x0 = Vector{{0, -0.001, -0.02}};
  Scene scene = scene_of("relay-feedback", p, step, steps);
  scene.f = [=](double, Eigen::Ref<Vector> f) { f = -b; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 2; };
  return scene;
}

// A boost converter: a switch whose current lies between 0 and a gated bound, and a diode (examples/boost.toml).
Scene boost(Index steps) {
  const double V = 10, L = 1e-4, C = 1e-4, R = 10, duty = 0.4, period = 5e-5, bound = 100, step = period / 400;
  Parts p;
  p.A = Matrix{{0, 0}, {0, -1 / (R * C)}};
  p.B = Matrix{{0, -1 / L, 1 / L}, {1 / C, 0, 0}};
  p.N = Matrix{{0, 1}, {-1, 0}, {1, 0}};
  p.M = Matrix{{0, -1, 1}, {1, 0, 0}, {-1, 0, 0}};
  p.x0 = Vector{{2, 16}};
  Scene scene = scene_of("boost", p, step, steps);
  scene.f = [=](double, Eigen::Ref<Vector> f) { f << V / L, 0; };
  scene.g = [=](double t, Eigen::Ref<Vector> g) { g << 0, (on(t, period, duty) ? bound : 0), 0; };
  jumps(scene, 400, 160, step);
  return scene;
}

// A bridge of six diodes between three phases with line inductances (examples/three-phase.toml).
Scene three_phase(Index steps) {
  const double V = 325, L = 1e-3, C = 1e-3, R = 50, step = 0.02 / 400;
  Parts p{Matrix::Zero(4, 4), Matrix::Zero(4, 6), Matrix::Zero(6, 4), Matrix::Zero(6, 6), Vector::Zero(4)};
  p.A(3, 3) = -1 / (R * C);
  for (Index i = 0; i < 3; ++i) {
    for (Index k = 0; k < 3; ++k) p.B(i, k) = (i == k ? -2 : 1) / (3 * L);
    p.B(3, 3 + i) = 1 / C;
    p.N(i, i) = -1;
    p.N(3 + i, 3) = 1;
    p.M(i, 3 + i) = 1;
    p.M(3 + i, i) = -1;
  }
  Scene scene = scene_of("three-phase", p, step, steps);
  scene.f = [=](double t, Eigen::Ref<Vector> f) {
    for (Index k = 0; k < 3; ++k) f[k] = V / L * std::sin(100 * pi * t - 2 * pi * double(k) / 3);
    f[3] = 0;
  };
  return scene;
}

// A cart with a pole between two soft walls, held by feedback and pushed to and fro.
Scene cart_pole(Index steps) {
  const double mp = 0.411, mc = 0.978, lp = 0.6, lc = 0.4267, gravity = 9.81, step = 2.5e-4;
  Matrix A = Matrix::Zero(4, 4);
  A(0, 2) = A(1, 3) = 1;
  A(2, 1) = gravity * mp / mc;
  A(3, 1) = gravity * (mc + mp) / (lc * mc);
  const Vector push{{0, 0, 1 / mc, 1 / (lc * mc)}}, feedback{{-3.1623, 40.7776, -4.3017, 7.6742}};
  Parts p;
  p.A = A - push * feedback.transpose();
  p.B = Matrix{{0, 0}, {0, 0}, {0.415276222189, -0.415276222189}, {8.991192365908, -8.991192365908}};
  p.N = Matrix{{-1, lp, 0, 0}, {1, -lp, 0, 0}};
  p.M = Matrix::Identity(2, 2) / 100;
  p.x0 = Vector{{0.3, 0, 0.3, 0}};
  Scene scene = scene_of("cart-pole", p, step, steps);
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f = 3 * std::sin(2 * pi * t) * push; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 0.35, 0.35; };
  return scene;
}

}  // namespace

const std::vector<std::string>& chunk_scenes() {
  static const std::vector<std::string> names{"ladder", "buck",        "diode-bridge", "relay-feedback",
                                              "boost",  "three-phase", "cart-pole"};
  return names;
}

Scene chunk_scene(const std::string& name, Index steps) {
  if (name == "ladder") return ladder(steps);
  if (name == "buck") return buck(steps);
  if (name == "diode-bridge") return diode_bridge(steps);
  if (name == "relay-feedback") return relay_feedback(steps);
  if (name == "boost") return boost(steps);
  if (name == "three-phase") return three_phase(steps);
  if (name == "cart-pole") return cart_pole(steps);
  throw std::invalid_argument(name + ": no scene of this study");
}

}  // namespace bromwich::study
