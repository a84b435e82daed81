#include "bench/studies/stability.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <utility>

namespace bromwich::app {
namespace {

constexpr double pi = std::numbers::pi;

/// A function of time with its derivative, by component.
struct Motion {
  std::function<double(Index i, double t)> x, slope;
};
using Switch = std::function<double(Index i, double t)>;

// t in [0, 2] for any T.
Motion cosines(Index m, double T) {
  const auto rate = [=](Index i) { return 2 / T * (1 + double(i) / double(m)); };
  return {[=](Index i, double t) { return std::cos(rate(i) * t); },
          [=](Index i, double t) { return -rate(i) * std::sin(rate(i) * t); }};
}
Switch sines(double T, double turns = 2) {
  return [=](Index i, double t) { return std::sin(2 * pi * turns * t / T + 0.3 + double(i)); };
}

template <typename S>
void tell(S& scene, std::vector<double> breaks) {
  if constexpr (requires { scene.breakpoints; }) scene.breakpoints = std::move(breaks);
}

struct Matrices {
  SparseMatrix A, B, N, M;
};

Scene manufactured(const Dynamics& dynamics, const LcpMatrix& M, double T, Motion motion, Switch S) {
  const Index m = states(dynamics), n = constraints(dynamics);
  Scene scene;
  scene.dynamics = dynamics;
  scene.M = M;
  scene.T = T;
  const auto parts = std::make_shared<Matrices>();
  if (const auto* dense = get_if<DenseDynamics>(&dynamics))
    *parts = {dense->A.sparseView(), dense->B.sparseView(), dense->N.sparseView(), {}};
  else
    *parts = {get<SparseDynamics>(dynamics).A, get<SparseDynamics>(dynamics).B, get<SparseDynamics>(dynamics).N, {}};
  const Matrix full = n <= 2000 ? to_dense(M) : Matrix();
  parts->M = full.sparseView();
  const auto x = [=](double t) { return Vector(Vector::NullaryExpr(m, [&](Index i) { return motion.x(i, t); })); };
  const auto y = [=](double t) {
    return Vector(Vector::NullaryExpr(n, [&](Index i) { return std::max(0.0, S(i, t)); }));
  };
  scene.x0 = x(0);
  scene.f = [=](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = motion.slope(i, t);
    f -= parts->A * x(t) + parts->B * y(t);
  };
  scene.g = [=](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::max(0.0, -S(i, t));
    g -= parts->N * x(t) + parts->M * y(t);
  };
  scene.exact = [=](double t, Eigen::Ref<Vector> at_x, Eigen::Ref<Vector> at_y) {
    at_x = x(t);
    at_y = y(t);
  };
  return scene;
}

Matrix ports(Index m, Index n) {
  return Matrix::NullaryExpr(m, n, [](Index i, Index j) { return std::cos(double(i) + 2 * double(j)); });
}
Matrix two() { return (Matrix(2, 2) << 2, -1, -1, 2).finished(); }

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

class Catalogue {
 public:
  explicit Catalogue(bool quick) : quick_(quick) {}

  std::vector<HardCase> all() {
    spectra();
    matrices();
    sources();
    starts();
    times_and_scales();
    sizes();
    return std::move(list_);
  }

 private:
  HardCase& add(const std::string& group, const std::string& name, Scene scene,
                const std::string& reference = "manufactured") {
    scene.name = name;
    list_.push_back({.group = group, .name = name, .reference = reference, .scene = std::move(scene)});
    return list_.back();
  }

  HardCase& dense(const std::string& group, const std::string& name, const Matrix& A, const Matrix& M, double T) {
    const Index m = A.rows(), n = M.rows();
    const Matrix B = ports(m, n);
    return add(group, name, manufactured(DenseDynamics{A, B, B.transpose()}, M, T, cosines(m, T), sines(T)));
  }

  static Matrix stiff(std::initializer_list<double> values) {
    const Index m = Index(values.size());
    const Vector v = Vector::LinSpaced(m, 1, double(m)), d = Eigen::Map<const Vector>(values.begin(), m);
    const Matrix V = Matrix::Identity(m, m) - 2 / v.squaredNorm() * v * v.transpose();
    return V * d.asDiagonal() * V.transpose();
  }

  static Matrix oscillators(std::initializer_list<double> frequencies, double growth) {
    const Index m = 2 * Index(frequencies.size());
    Matrix A = Matrix::Zero(m, m);
    Index i = 0;
    for (const double w : frequencies) {
      A.block(i, i, 2, 2) << growth, w, -w, growth;
      i += 2;
    }
    return A;
  }

  static Matrix chain(Index m, double diagonal, double above) {
    Matrix A = diagonal * Matrix::Identity(m, m);
    A.diagonal(1).setConstant(above);
    return A;
  }

  void spectra() {
    const std::string group = "A";
    dense(group, "A = 0", Matrix::Zero(4, 4), two(), 2);
    dense(group, "nilpotent", chain(6, 0, 1), two(), 2);
    dense(group, "Jordan block", chain(6, -1, 1), two(), 2);
    dense(group, "defective, companion", (Matrix(3, 3) << -3, 1, 0, -3, 0, 1, -1, 0, 0).finished(), two(), 2);
    dense(group, "undamped, 10 periods", oscillators({1, 3}, 0), two(), 20);
    dense(group, "undamped, 1 and 1000", oscillators({1, 1000}, 0), two(), 2);
    dense(group, "unstable, e^10", oscillators({20, 3}, 5), two(), 2);
    dense(group, "stiff, 1e8", stiff({-1e8, -1e4, -1e2, -1, -1e-4, 0}), two(), 2);
    dense(group, "stiff, 1e12", stiff({-1e12, -1e4, -1e2, -1, -1e-4, 0}), two(), 2);
    dense(group, "non-normal", chain(32, -1, -8), two(), 2);
    dense(group, "stiff and M = 0", stiff({-1e8, -1e2, -1}), Matrix::Zero(2, 2), 2);
    // w = 1 - x; x' = 20 x - 40 y is unstable without y, and decays like e^{-20 t} with it.
    Scene held;
    held.dynamics = DenseDynamics{Matrix::Constant(1, 1, 20), Matrix::Constant(1, 1, -40), Matrix::Constant(1, 1, -1)};
    held.M = Matrix(Matrix::Ones(1, 1));
    held.x0 = Vector::Ones(1);
    held.T = 5;
    held.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) { x[0] = y[0] = std::exp(-20 * t); };
    add(group, "unstable without y, e^100", held, "by hand");
  }

  void matrices() {
    const std::string group = "M";
    const Matrix A = -Matrix::Identity(4, 4) + oscillators({20, 3}, 5) / 20;
    dense(group, "M = 0", A, Matrix::Zero(2, 2), 2);
    dense(group, "M = 1e-10", A, 1e-10 * Matrix::Identity(2, 2), 2);
    dense(group, "M = diag(1, 1e-12)", A, Vector((Vector(2) << 1, 1e-12).finished()).asDiagonal(), 2);
    dense(group, "skew", A, (Matrix(2, 2) << 0, 1, -1, 0).finished(), 2);
    dense(group, "singular, PSD", A, Matrix::Ones(2, 2), 2).compare_y = false;
    const Index n = quick_ ? 8 : 12;
    Matrix murty = Matrix::Identity(n, n);
    murty.triangularView<Eigen::StrictlyUpper>().setConstant(2);
    dense(group, "Murty", A, murty, 2);
    dense(group, "Fathi", A, murty * murty.transpose(), 2);
    const Matrix B = ports(4, 2);
    const auto with = [&](const std::string& name, const Switch& S) {
      add(group, name, manufactured(DenseDynamics{A, B, B.transpose()}, two(), 2, cosines(4, 2), S));
    };
    with("degenerate over intervals", [](Index i, double t) {
      const double s = std::sin(2 * pi * t + 0.3 + double(i));
      return s > 0.5 ? s - 0.5 : s < -0.5 ? s + 0.5 : 0;
    });
    with("grazing", [](Index i, double t) { return std::pow(std::sin(2 * pi * t + 0.3 + double(i)), 3); });
    Scene fold;  // Z: the least solution merges with another at ln(5/3) and ceases to exist
    fold.dynamics =
        DenseDynamics{-Matrix::Identity(1, 1), (Matrix(1, 2) << 0.5, 0).finished(), (Matrix(2, 1) << 0, 1).finished()};
    fold.M = Matrix((Matrix(2, 2) << 1, -2, -2, 1).finished());
    fold.lcp_class = LcpClass::Z;
    fold.g = [](double, Eigen::Ref<Vector> g) { g << -1, 0; };
    fold.x0 = Vector::Constant(1, 3);
    fold.T = 1;
    fold.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      x[0] = 0.5 + 2.5 * std::exp(-t);
      y << 1, 0;
    };
    HardCase& c = add(group, "Z, lost at ln(5/3)", fold, "by hand");
    c.expected = "infeasible";
    c.until = std::log(5. / 3) - 0.02;
  }

  static double triangle(double turns) { return 4 * std::abs(turns - std::floor(turns) - 0.5) - 1; }
  static double square(double turns) { return turns - std::floor(turns) < 0.5 ? -4 : 4; }

  // x has kinks, so that f jumps: `periods` triangles, two edges each.
  void edges(const std::string& name, double periods, bool told, bool y_jumps) {
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

  void sources() {
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
  void contact() {
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
  void rectifier(double turns) {
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

  void pulse(bool told) {
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

  void starts() {
    const std::string group = "starts";
    Scene jump;  // x0 = -1 violates the constraint: the state jumps to 0, then x' = 1 - x
    jump.dynamics = DenseDynamics{-Matrix::Identity(1, 1), Matrix::Ones(1, 1), Matrix::Ones(1, 1)};
    jump.M = Matrix(Matrix::Zero(1, 1));
    jump.f = [](double, Eigen::Ref<Vector> f) { f[0] = 1; };
    jump.x0 = -Vector::Ones(1);
    jump.T = 2;
    jump.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      x[0] = -std::expm1(-t);
      y[0] = 0;
    };
    HardCase& c = add(group, "incompatible x0", jump, "by hand");
    c.y_jumps = true;
    c.impulse = Vector::Ones(1);
    sliding();
    zeno();
    falling();
    braked();
  }

  // A mass that flies freely meets a rigid stop and loses its velocity.
  static Scene at_stop(double stiffness, double weight, double T) {
    Scene scene;
    scene.dynamics = DenseDynamics{(Matrix(2, 2) << 0, 1, -stiffness, 0).finished(), (Matrix(2, 1) << 0, 1).finished(),
                                   (Matrix(1, 2) << 1, 0).finished()};
    scene.M = Matrix(Matrix::Zero(1, 1));
    if (weight > 0) scene.f = [=](double, Eigen::Ref<Vector> f) { f << 0, -weight; };
    scene.x0 = Vector::Unit(2, 0);
    scene.T = T;
    return scene;
  }

  void falling() {
    constexpr double g = 9.81;
    Scene scene = at_stop(0, g, 2);
    scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      const double height = 1 - g * t * t / 2;
      x << std::max(height, 0.0), (height > 0 ? -g * t : 0);
      y.setConstant(NAN);
    };
    add("starts", "ball on a rigid floor", scene, "by hand").compare_y = false;
  }

  void braked() {
    Scene scene = at_stop(1, 0, 3);
    scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      x << (t < pi / 2 ? std::cos(t) : 0), (t < pi / 2 ? -std::sin(t) : 0);
      y.setConstant(NAN);
    };
    add("starts", "spring against a stop", scene, "by hand").compare_y = false;
  }

  // x' in -Sgn x: y = (s, the negative part of x), Sgn = 1 - 2 s.
  void sliding() {
    Scene scene;
    scene.dynamics =
        DenseDynamics{Matrix::Zero(1, 1), (Matrix(1, 2) << 2, 0).finished(), (Matrix(2, 1) << 1, 0).finished()};
    scene.M = Matrix((Matrix(2, 2) << 0, 1, -1, 0).finished());
    scene.f = [](double, Eigen::Ref<Vector> f) { f[0] = -1; };
    scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 1; };
    scene.x0 = Vector::Ones(1);
    scene.T = 2;
    scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      x[0] = std::max(0.0, 1 - t);
      y << (t < 1 ? 0 : 0.5), 0;
    };
    add("starts", "relay, slides from t = 1", scene, "by hand").y_jumps = true;
  }

  // Two relays: the state rotates around the origin and reaches it at t = 2 after infinitely many switches.
  void zeno() {
    const Matrix turn = 500 * (Matrix(2, 2) << .01, .99, -.99, .01).finished();
    Scene scene;
    Matrix B = Matrix::Zero(2, 4), N = Matrix::Zero(4, 2), M = Matrix::Zero(4, 4);
    B.leftCols(2) = -2 * turn;
    N.topRows(2) = -Matrix::Identity(2, 2);
    M.topRightCorner(2, 2).setIdentity();
    M.bottomLeftCorner(2, 2) = -Matrix::Identity(2, 2);
    scene.dynamics = DenseDynamics{B.rows() == 2 ? Matrix::Zero(2, 2) : Matrix(), B, N};
    scene.M = M;
    scene.f = [turn](double, Eigen::Ref<Vector> f) { f = turn * Vector::Ones(2); };
    scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 0, 1, 1; };
    scene.x0 = Vector::Constant(2, 10);
    scene.T = 2.5;
    std::vector<double> times{0};
    std::vector<Vector> corners{scene.x0};
    Vector sign = Vector::Ones(2);  // of x, from a corner on
    while (corners.back().cwiseAbs().maxCoeff() > 1e-12 && times.size() < 5000) {
      const Vector velocity = -turn * sign, x = corners.back();
      const Index i = velocity[0] * sign[0] < 0 ? 0 : 1;
      const double step = -x[i] / velocity[i];
      times.push_back(times.back() + step);
      corners.push_back(x + step * velocity);
      corners.back()[i] = 0;
      sign[i] = -sign[i];
    }
    scene.exact = [=](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
      y.setConstant(NAN);
      const std::size_t k = std::size_t(std::upper_bound(times.begin(), times.end(), t) - times.begin());
      if (k == times.size()) {
        x.setZero();
        return;
      }
      const double s = (t - times[k - 1]) / (times[k] - times[k - 1]);
      x = (1 - s) * corners[k - 1] + s * corners[k];
    };
    add("starts", "Zeno, ends at t = 2", scene, "switch by switch").compare_y = false;
  }

  static Scene in_units(const Matrix& A, double T, const Vector& x, const Vector& y, const Vector& w) {
    const Index m = A.rows(), n = 2;
    const Matrix B = ports(m, n), X = x.asDiagonal(), X1 = x.cwiseInverse().asDiagonal();
    const Matrix Y1 = y.cwiseInverse().asDiagonal(), W = w.asDiagonal();
    const DenseDynamics d{X * A * X1, X * B * Y1, W * B.transpose() * X1};
    const Motion base = cosines(m, T);
    // y and w of a row have different units: S is in units of y where it is positive, otherwise in units of w.
    const Vector unit_y = y;
    Scene scene = manufactured(d, Matrix(W * two() * Y1), T,
                               {[=](Index i, double t) { return x[i] * base.x(i, t); },
                                [=](Index i, double t) { return x[i] * base.slope(i, t); }},
                               [=, S = sines(T)](Index i, double t) {
                                 const double s = S(i, t);
                                 return (s > 0 ? y[i] : w[i]) * s;
                               });
    return scene;
  }

  void times_and_scales() {
    const std::string group = "scales";
    const Matrix A = -Matrix::Identity(4, 4) + oscillators({20, 3}, 5) / 20;
    for (const auto& [name, T] : {std::pair{"T = 1e-9", 1e-9}, {"T = 1e9", 1e9}})
      add(group, name,
          manufactured(DenseDynamics{A * (2 / T), ports(4, 2) * (2 / T), ports(4, 2).transpose()}, two(), T,
                       cosines(4, T), sines(T)));
    dense(group, "T = 1000, undamped", oscillators({1, 3}, 0), two(), 1000);
    const Vector ones = Vector::Ones(2), one4 = Vector::Ones(4);
    for (const double unit : {1e-13, 1e12})
      add(group, unit < 1 ? "all at 1e-13" : "all at 1e12", in_units(A, 2, unit * one4, unit * ones, unit * ones));
    add(group, "x at 1e-12, y at 1e12", in_units(A, 2, 1e-12 * one4, 1e12 * ones, ones));
    add(group, "components 1e9 apart",
        in_units(A, 2, (Vector(4) << 1, 1e9, 1e-4, 1e5).finished(), (Vector(2) << 1, 1e9).finished(),
                 (Vector(2) << 1e9, 1).finished()));
  }

  // Heat in a rod of m cells, n contacts spread over it.
  void rod(Index m, Index n) {
    std::vector<Eigen::Triplet<double>> a, b;
    const double c = 0.01 * double(m) * double(m);
    for (Index i = 0; i < m; ++i) {
      a.emplace_back(i, i, -2 * c);
      if (i > 0) a.emplace_back(i, i - 1, c);
      if (i + 1 < m) a.emplace_back(i, i + 1, c);
    }
    for (Index k = 0; k < n; ++k) b.emplace_back((2 * k + 1) * m / (2 * n), k, 1);
    SparseMatrix A(m, m), B(m, n);
    A.setFromTriplets(a.begin(), a.end());
    B.setFromTriplets(b.begin(), b.end());
    const Motion motion{
        [=](Index i, double t) { return std::cos(t) * std::sin(pi * (double(i) + 1) / double(m + 1)); },
        [=](Index i, double t) { return -std::sin(t) * std::sin(pi * (double(i) + 1) / double(m + 1)); }};
    const LcpMatrix M = Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 4), Vector::Constant(n, -1)};
    HardCase& one = add("sizes", "n = " + std::to_string(n) + ", m = " + std::to_string(m),
                        manufactured(SparseDynamics{A, B, B.transpose()}, M, 1, motion, sines(1)));
    one.scene.lcp_class = LcpClass::P;
    // x is an eigenvector of A times cos t: f has 1 + n shapes instead of m values.
    std::vector<Eigen::Triplet<double>> shapes;
    for (Index i = 0; i < m; ++i) shapes.emplace_back(i, 0, std::sin(pi * (double(i) + 1) / double(m + 1)));
    for (Index k = 0; k < n; ++k) shapes.emplace_back((2 * k + 1) * m / (2 * n), k + 1, -1);
    one.scene.f_entry = SourceEntry::through_F;
    one.scene.F = SparseMatrix(m, n + 1);
    one.scene.F.setFromTriplets(shapes.begin(), shapes.end());
    const double decay = c * 4 * std::pow(std::sin(pi / (2 * double(m + 1))), 2);
    one.scene.f = [decay, S = sines(1)](double t, Eigen::Ref<Vector> f) {
      f[0] = -std::sin(t) + decay * std::cos(t);
      for (Index k = 1; k < f.size(); ++k) f[k] = std::max(0.0, S(k - 1, t));
    };
    // g depends only on the states at the contacts.
    one.scene.g = [m, n, S = sines(1)](double t, Eigen::Ref<Vector> g) {
      const auto y = [&](Index k) { return k < 0 || k >= n ? 0 : std::max(0.0, S(k, t)); };
      for (Index k = 0; k < n; ++k)
        g[k] = std::max(0.0, -S(k, t)) - (4 * y(k) - y(k - 1) - y(k + 1)) -
               std::cos(t) * std::sin(pi * (double((2 * k + 1) * m / (2 * n)) + 1) / double(m + 1));
    };
    for (Index k = 0; k < 8; ++k) one.components.push_back(k * m / 8);
    one.scene.default_steps = 64;
    if (n > 10) one.tolerance = 1e-2;
  }

  // Many constraints on few states.
  void wide(Index n) {
    const Index m = 10;
    const Matrix B = ports(m, n) / std::sqrt(double(n));
    const LcpMatrix M = Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 4), Vector::Constant(n, -1)};
    HardCase& one =
        add("sizes", "n = " + std::to_string(n) + ", m = " + std::to_string(m),
            manufactured(DenseDynamics{chain(m, -1, 0.5), B, B.transpose()}, M, 1, cosines(m, 1), sines(1)));
    one.scene.default_steps = 32;
    one.tolerance = 1e-2;
  }

  void sizes() {
    const Index m = quick_ ? 20 : 60, n = quick_ ? 10 : 30;
    dense("sizes", "n = " + std::to_string(n) + ", m = " + std::to_string(m), chain(m, -1, 0.5),
          3 * Matrix::Identity(n, n) - Matrix::Ones(n, n) / double(n), 2);
    rod(100, 1);
    if (quick_) return;
    wide(1000);
    rod(400, 100);
    rod(100000, 2);
  }

  bool quick_;
  std::vector<HardCase> list_;
};

}  // namespace

std::vector<HardCase> hard_cases(bool quick) { return Catalogue(quick).all(); }

}  // namespace bromwich::app
