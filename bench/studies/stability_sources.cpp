#include "bench/studies/stability_cases.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <string>

namespace bromwich::app::hard {
namespace {

template <typename S>
void tell(S& scene, std::vector<double> breaks) {
  if constexpr (requires { scene.breakpoints; }) scene.breakpoints = std::move(breaks);
}

/// The rectifier between two switches: x' = -r x + c sin(omega t) with r = 2100, c = 20000 while it conducts.
struct Phase {
  double omega, begin, x;
  bool conducts;

  double at(double t) const {
    const double r = conducts ? 2100 : 100, c = conducts ? 20000 : 0;
    const auto forced = [&](double s) {
      return c * (r * std::sin(omega * s) - omega * std::cos(omega * s)) / (r * r + omega * omega);
    };
    return forced(t) + (x - forced(begin)) * std::exp(-r * (t - begin));
  }
};

double triangle(double turns) { return 4 * std::abs(turns - std::floor(turns) - 0.5) - 1; }
double square(double turns) { return turns - std::floor(turns) < 0.5 ? -4 : 4; }

}  // namespace

// x has kinks, so that f jumps: `periods` triangles, two edges each.
void Catalogue::edges(const std::string& name, double periods, bool told, bool y_jumps) {
  constexpr double T = 1, shift = 0.137;
  const Matrix A = (Matrix(2, 2) << -1, 2, -2, -1).finished(), B = ports(2, 1);
  const double size = 1 / std::sqrt(periods);
  const Motion motion{
      [=](Index i, double t) { return std::cos(t + double(i)) + size * triangle(periods * t + shift); },
      [=](Index i, double t) { return -std::sin(t + double(i)) + size * periods * square(periods * t + shift); }};
  const Switch S = [=](Index, double t) {
    return std::sin(7 * t + 0.3) + (y_jumps ? 0.3 * square(periods * t + shift) : 0);
  };
  Scene scene = manufactured(DenseDynamics{A, B, B.transpose()}, Matrix(Matrix::Ones(1, 1)), T, motion, S);
  if (told) {
    std::vector<double> at;
    for (double k = 1; (k / 2 - shift) / periods < T; ++k)
      if (k / 2 > shift) at.push_back((k / 2 - shift) / periods);
    tell(scene, at);
  }
  add("sources", name + (told ? ", named" : ""), scene).y_jumps = y_jumps;
}

void Catalogue::sources() {
  const std::string group = "sources";
  for (const bool told : {false, true}) {
    edges("square wave, 6 edges", 3, told, false);
    edges("square wave, y jumps", 3.3, told, true);
    edges("square wave, 57 periods", 57.3, told, false);
    if (!quick_) edges("10^4 edges", 5000, told, false);
    pulse(told);
  }
  const Matrix A = (Matrix(2, 2) << -1, 2, -2, -1).finished(), B = ports(2, 1);
  const DenseDynamics d{A, B, B.transpose()};
  // A table: x' is linear between knots.
  const Motion table{[](Index i, double t) {
                       double x = std::cos(double(i));
                       for (int k = 1; k < 20; ++k) {
                         const double s = t - 0.0513 * k;
                         x += (k % 2 ? 10 : -10) * s * std::abs(s);
                       }
                       return x;
                     },
                     [](Index, double t) {
                       double slope = 0;
                       for (int k = 1; k < 20; ++k) slope += (k % 2 ? 20 : -20) * std::abs(t - 0.0513 * k);
                       return slope;
                     }};
  add(group, "table of 19 knots", manufactured(d, Matrix(Matrix::Ones(1, 1)), 1, table, sines(1)));
  const Motion grows{[](Index i, double t) { return std::exp((3 - double(i)) * t); },
                     [](Index i, double t) { return (3 - double(i)) * std::exp((3 - double(i)) * t); }};
  add(group, "growth, e^15", manufactured(d, Matrix(Matrix::Ones(1, 1)), 5, grows, sines(5)));
  contact();
  rectifier(801);
  if (!quick_) rectifier(12800);
}

// y = (1 - |t - c|/d)+, x' = y/d: the contact is short and moves x by 1.
void Catalogue::contact() {
  constexpr double c = 0.371717, d = 1e-4;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(1, 1), Matrix::Constant(1, 1, 1 / d), Matrix::Zero(1, 1)};
  scene.M = Matrix(Matrix::Ones(1, 1));
  scene.g = [](double t, Eigen::Ref<Vector> g) { g[0] = std::abs(t - c) / d - 1; };
  scene.x0 = Vector::Zero(1);
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    const double u = std::clamp((t - c) / d, -1.0, 1.0);
    y[0] = 1 - std::abs(u);
    x[0] = u < 0 ? (1 + u) * (1 + u) / 2 : 1 - (1 - u) * (1 - u) / 2;
  };
  add("sources", "contact of 2e-4", scene, "by hand");
}

// x' = -100 x + 1000 y, w = x + y/2 - 10 sin(2 pi turns t): x follows the peaks of a sine that coarse grids do not
// resolve.
void Catalogue::rectifier(double turns) {
  const double omega = 2 * pi * turns;
  std::vector<Phase> phases{{omega, 0, 0, true}};
  const auto over = [&](double t) { return 10 * std::sin(omega * t) - phases.back().at(t); };
  const double step = 1 / (turns * 64);
  for (double t = step; t < 1 + step; t += step) {
    const bool on = phases.back().conducts;
    if ((over(t) > 0) == on) continue;
    double a = std::max(t - step, phases.back().begin), b = t;
    for (int i = 0; i < 60; ++i) {
      const double middle = (a + b) / 2;
      ((over(middle) > 0) == on ? a : b) = middle;
    }
    phases.push_back({omega, b, phases.back().at(b), !on});
  }
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Constant(1, 1, -100), Matrix::Constant(1, 1, 1000), Matrix::Ones(1, 1)};
  scene.M = Matrix(Matrix::Constant(1, 1, 0.5));
  scene.g = [omega](double t, Eigen::Ref<Vector> g) { g[0] = -10 * std::sin(omega * t); };
  scene.x0 = Vector::Zero(1);
  scene.exact = [=](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    auto phase =
        std::upper_bound(phases.begin(), phases.end(), t, [](double at, const Phase& p) { return at < p.begin; });
    if (phase != phases.begin()) --phase;
    x[0] = phase->at(t);
    y[0] = std::max(0.0, 2 * (10 * std::sin(omega * t) - x[0]));
  };
  add("sources", "rectifier, " + std::to_string(int(turns)) + " periods", scene, "phase by phase");
}

void Catalogue::pulse(bool told) {
  const double a = 0.2754, b = 0.2902, r = 1 / 0.8, height = 175.676;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Constant(1, 1, -r), Matrix::Ones(1, 1), Matrix::Ones(1, 1)};
  scene.M = Matrix(Matrix::Zero(1, 1));
  scene.f = [=](double t, Eigen::Ref<Vector> f) { f[0] = t >= a && t < b ? height : 0; };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
  scene.x0 = Vector::Zero(1);
  scene.exact = [=](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    const auto since = [&](double start) { return t > start ? -std::expm1(-r * (t - start)) : 0; };
    x[0] = height / r * (since(a) - since(b));
    y[0] = 0;
  };
  if (told) tell(scene, {a, b});
  add("sources", told ? "pulse of 0.015, named" : "pulse of 0.015", scene, "by hand");
}

}  // namespace bromwich::app::hard
