#include "core/events/collocation.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

constexpr Index s = Collocation::degree;

// The roots of P_s - P_{s-1}, from the Jacobi matrix with a last entry that makes 1 a root (Golub, SIAM Rev. 15, 1973).
Vector radau_points() {
  Matrix jacobi = Matrix::Zero(s, s);
  double before = 0, now = 1;  // monic Legendre polynomials on [-1, 1], at 1
  for (Index k = 1; k < s; ++k) {
    const double b = double(k * k) / double(4 * k * k - 1);
    jacobi(k, k - 1) = jacobi(k - 1, k) = std::sqrt(b);
    const double next = now - (k > 1 ? double((k - 1) * (k - 1)) / double(4 * (k - 1) * (k - 1) - 1) : 0) * before;
    before = now;
    now = next;
  }
  const double last = double((s - 1) * (s - 1)) / double(4 * (s - 1) * (s - 1) - 1);
  jacobi(s - 1, s - 1) = 1 - last * before / now;
  Vector c = (Eigen::SelfAdjointEigenSolver<Matrix>(jacobi, Eigen::EigenvaluesOnly).eigenvalues().array() + 1) / 2;
  c[s - 1] = 1;
  return c;
}

template <typename Row>
Matrix rows_of(const Vector& points, const Row& row) {
  Matrix values(points.size(), s + 1);
  for (Index i = 0; i < points.size(); ++i) values.row(i) = row(points[i]).transpose();
  return values;
}

Vector with_zero(const Vector& c) {
  Vector all(c.size() + 1);
  all << 0, c;
  return all;
}

// P_k' = 2 ((2k - 1) P_{k-1} + (2k - 5) P_{k-3} + ...) on [0, 1].
Matrix derivative_matrix() {
  Matrix d = Matrix::Zero(s + 1, s + 1);
  for (Index k = 1; k <= s; ++k)
    for (Index j = k - 1; j >= 0; j -= 2) d(j, k) = 2 * (2 * double(j) + 1);
  return d;
}

Vector bernstein_polynomials(double at) {
  Vector b(s + 1);
  double choose = 1;
  for (Index k = 0; k <= s; ++k) {
    b[k] = choose * std::pow(at, double(k)) * std::pow(1 - at, double(s - k));
    choose *= double(s - k) / double(k + 1);
  }
  return b;
}

std::vector<Collocation::Eigenvalue> eigenvalues_of(const Matrix& A) {
  const Eigen::EigenSolver<Matrix> solver(A);
  const ComplexMatrix right = solver.eigenvectors(), left = right.inverse();
  std::vector<Collocation::Eigenvalue> all;
  for (Index k = 0; k < s; ++k) {
    const Complex value = solver.eigenvalues()[k];
    if (value.imag() >= 0) all.push_back({value, right.col(k), left.row(k).transpose(), value.imag() > 0 ? 2.0 : 1.0});
  }
  return all;
}

Collocation make() {
  Collocation c;
  c.nodes = radau_points();
  c.stages = rows_of(c.nodes, legendre);
  c.integrals = rows_of(c.nodes, legendre_integrals);
  c.coefficients = rows_of(with_zero(c.nodes), legendre).inverse();
  c.derivative = derivative_matrix();
  for (Index k = 0; k <= s; ++k)
    c.samples[k] = (1 - std::cos(std::numbers::pi * (double(k) + 0.5) / double(s + 1))) / 2;
  const Matrix at_samples = rows_of(c.samples, legendre);
  c.from_samples = at_samples.inverse();
  c.bernstein = rows_of(c.samples, bernstein_polynomials).inverse() * at_samples;
  c.checks = {0.137609, 0.381966, 0.739551};  // irregular, and away from the samples
  c.at_checks = rows_of(c.checks, legendre);
  // Polynomials of degree s - 1 on the stages: the columns of `stages` up to that degree.
  c.eigenvalues = eigenvalues_of(c.integrals.leftCols(s) * c.stages.leftCols(s).inverse());
  return c;
}

}  // namespace

const Collocation& Collocation::get() {
  static const Collocation c = make();
  return c;
}

double first_below(const LegendreValues& bernstein, double noise) {
  struct Part {
    LegendreValues b;
    double begin, length;
  };
  constexpr double shortest = 0x1p-50;
  if (bernstein.minCoeff() >= -noise) return 1;
  Part parts[64];
  int count = 0;
  parts[count++] = {bernstein, 0, 1};
  while (count > 0) {
    Part whole = parts[--count];
    if (whole.b.minCoeff() >= -noise) continue;
    if (whole.b[0] < -noise || whole.length < shortest) return whole.begin;
    // De Casteljau: the coefficients of both halves.
    Part first{{}, whole.begin, whole.length / 2}, second{{}, whole.begin + whole.length / 2, whole.length / 2};
    for (Index k = 0; k <= s; ++k) {
      first.b[k] = whole.b[0];
      second.b[s - k] = whole.b[s - k];
      for (Index i = 0; i < s - k; ++i) whole.b[i] = (whole.b[i] + whole.b[i + 1]) / 2;
    }
    parts[count++] = second;
    parts[count++] = first;
  }
  return 1;
}

double zero_before(const LegendreValues& coefficients, double at) {
  const auto value = [&](double t) { return coefficients.dot(legendre(t)); };
  double positive = at;
  for (double back = 0x1p-40; value(positive) < 0; back *= 2) {
    if (positive == 0) return 0;  // the zero is where the step begins
    positive = std::max(0.0, at - back);
  }
  double negative = at;
  for (int k = 0; k < 60 && negative - positive > 0; ++k) {
    const double middle = positive + (negative - positive) / 2;
    (value(middle) < 0 ? negative : positive) = middle;
  }
  return positive;
}

}  // namespace bromwich
