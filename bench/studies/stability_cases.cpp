#include "bench/studies/stability_cases.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

namespace bromwich::app::hard {
namespace {

struct Matrices {
  SparseMatrix A, B, N, M;
};

}  // namespace

// t in [0, 2] for any T.
Motion cosines(Index m, double T) {
  const auto rate = [=](Index i) { return 2 / T * (1 + double(i) / double(m)); };
  return {[=](Index i, double t) { return std::cos(rate(i) * t); },
          [=](Index i, double t) { return -rate(i) * std::sin(rate(i) * t); }};
}
Switch sines(double T, double turns) {
  return [=](Index i, double t) { return std::sin(2 * pi * turns * t / T + 0.3 + double(i)); };
}

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

std::vector<HardCase> Catalogue::all() {
  spectra();
  matrices();
  sources();
  starts();
  times_and_scales();
  sizes();
  return std::move(list_);
}

HardCase& Catalogue::add(const std::string& group, const std::string& name, Scene scene, const std::string& reference) {
  scene.name = name;
  list_.push_back({.group = group, .name = name, .reference = reference, .scene = std::move(scene)});
  return list_.back();
}

HardCase& Catalogue::dense(const std::string& group, const std::string& name, const Matrix& A, const Matrix& M,
                           double T) {
  const Index m = A.rows(), n = M.rows();
  const Matrix B = ports(m, n);
  return add(group, name, manufactured(DenseDynamics{A, B, B.transpose()}, M, T, cosines(m, T), sines(T)));
}

Matrix Catalogue::stiff(std::initializer_list<double> values) {
  const Index m = Index(values.size());
  const Vector v = Vector::LinSpaced(m, 1, double(m)), d = Eigen::Map<const Vector>(values.begin(), m);
  const Matrix V = Matrix::Identity(m, m) - 2 / v.squaredNorm() * v * v.transpose();
  return V * d.asDiagonal() * V.transpose();
}

Matrix Catalogue::oscillators(std::initializer_list<double> frequencies, double growth) {
  const Index m = 2 * Index(frequencies.size());
  Matrix A = Matrix::Zero(m, m);
  Index i = 0;
  for (const double w : frequencies) {
    A.block(i, i, 2, 2) << growth, w, -w, growth;
    i += 2;
  }
  return A;
}

Matrix Catalogue::chain(Index m, double diagonal, double above) {
  Matrix A = diagonal * Matrix::Identity(m, m);
  A.diagonal(1).setConstant(above);
  return A;
}

void Catalogue::spectra() {
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

void Catalogue::matrices() {
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

Scene Catalogue::in_units(const Matrix& A, double T, const Vector& x, const Vector& y, const Vector& w) {
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

void Catalogue::times_and_scales() {
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
void Catalogue::rod(Index m, Index n) {
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
  const Motion motion{[=](Index i, double t) { return std::cos(t) * std::sin(pi * (double(i) + 1) / double(m + 1)); },
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
void Catalogue::wide(Index n) {
  const Index m = 10;
  const Matrix B = ports(m, n) / std::sqrt(double(n));
  const LcpMatrix M = Tridiagonal{Vector::Constant(n, -1), Vector::Constant(n, 4), Vector::Constant(n, -1)};
  HardCase& one = add("sizes", "n = " + std::to_string(n) + ", m = " + std::to_string(m),
                      manufactured(DenseDynamics{chain(m, -1, 0.5), B, B.transpose()}, M, 1, cosines(m, 1), sines(1)));
  one.scene.default_steps = 32;
  one.tolerance = 1e-2;
}

void Catalogue::sizes() {
  const Index m = quick_ ? 20 : 60, n = quick_ ? 10 : 30;
  dense("sizes", "n = " + std::to_string(n) + ", m = " + std::to_string(m), chain(m, -1, 0.5),
        3 * Matrix::Identity(n, n) - Matrix::Ones(n, n) / double(n), 2);
  rod(100, 1);
  if (quick_) return;
  wide(1000);
  rod(400, 100);
  rod(100000, 2);
}

}  // namespace bromwich::app::hard

namespace bromwich::app {

std::vector<HardCase> hard_cases(bool quick) { return hard::Catalogue(quick).all(); }

}  // namespace bromwich::app
