#include "tests/support/oracle_collocation.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <numbers>

namespace bromwich::oracle {
namespace {

// Radau points on [0, 1], including the right end: eigenvalues of the Jacobi matrix of the Legendre polynomials on
// [-1, 1] with its last entry modified so that 1 is an eigenvalue (Golub).
Vector radau_points(Index s) {
  const auto beta = [](Index k) { return double(k) / std::sqrt(4.0 * double(k) * double(k) - 1); };
  Matrix jacobi = Matrix::Zero(s, s);
  for (Index k = 1; k < s; ++k) jacobi(k, k - 1) = jacobi(k - 1, k) = beta(k);
  const Matrix shifted = jacobi.topLeftCorner(s - 1, s - 1) - Matrix::Identity(s - 1, s - 1);
  Vector last = Vector::Zero(s - 1);
  last[s - 2] = beta(s - 1) * beta(s - 1);
  jacobi(s - 1, s - 1) = 1 + shifted.partialPivLu().solve(last)[s - 2];
  Vector points = (Eigen::SelfAdjointEigenSolver<Matrix>(jacobi).eigenvalues().array() + 1) / 2;
  points[s - 1] = 1;
  return points;
}

Matrix rows_at(const Vector& points, Index last) {
  Matrix V(points.size(), last + 1);
  for (Index i = 0; i < points.size(); ++i) V.row(i) = legendre(points[i], last).transpose();
  return V;
}

Collocation make() {
  constexpr Index s = Collocation::degree;
  Collocation c;
  c.nodes = Vector::Zero(s + 1);
  c.nodes.tail(s) = radau_points(s);
  Matrix integrals(s, s);
  for (Index i = 0; i < s; ++i) integrals.row(i) = legendre_integrals(c.nodes[i + 1]).head(s).transpose();
  c.runge_kutta = integrals * rows_at(c.nodes.tail(s), s - 1).inverse();
  c.values = rows_at(c.nodes, s);
  c.coefficients = c.values.inverse();
  c.samples = Vector::NullaryExpr(
      s + 1, [](Index k) { return (1 - std::cos(std::numbers::pi * (double(k) + 0.5) / double(s + 1))) / 2; });
  c.from_samples = rows_at(c.samples, s).inverse();
  // P_k' = 2 ((2k-1) P_{k-1} + (2k-5) P_{k-3} + ...) on [0, 1].
  c.derivative = Matrix::Zero(s + 1, s + 1);
  for (Index k = 1; k <= s; ++k)
    for (Index j = k - 1; j >= 0; j -= 2) c.derivative(j, k) = 2 * (2 * double(j) + 1);
  return c;
}

}  // namespace

const Collocation& Collocation::get() {
  static const Collocation made = make();
  return made;
}

Vector legendre(double s, Index last) {
  Vector P(last + 1);
  const double z = 2 * s - 1;
  P[0] = 1;
  if (last > 0) P[1] = z;
  for (Index k = 1; k < last; ++k) P[k + 1] = ((2 * double(k) + 1) * z * P[k] - double(k) * P[k - 1]) / (double(k) + 1);
  return P;
}

Vector legendre_integrals(double s) {
  constexpr Index last = Collocation::degree;
  const Vector P = legendre(s, last + 1);
  Vector integrals(last + 1);
  integrals[0] = s;
  for (Index k = 1; k <= last; ++k) integrals[k] = (P[k + 1] - P[k - 1]) / (2 * (2 * double(k) + 1));
  return integrals;
}

}  // namespace bromwich::oracle
