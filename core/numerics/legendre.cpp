#include "core/numerics/legendre.hpp"

namespace bromwich {

namespace {

constexpr Index s = legendre_degree;

}  // namespace

LegendreValues legendre(double at) {
  const double z = 2 * at - 1;
  LegendreValues p;
  p[0] = 1;
  p[1] = z;
  for (Index k = 1; k < s; ++k) p[k + 1] = (double(2 * k + 1) * z * p[k] - double(k) * p[k - 1]) / double(k + 1);
  return p;
}

LegendreValues legendre_integrals(double at) {
  const LegendreValues p = legendre(at);
  LegendreValues q;
  q[0] = at;
  for (Index k = 1; k < s; ++k) q[k] = (p[k + 1] - p[k - 1]) / (2 * double(2 * k + 1));
  const double z = 2 * at - 1, after = (double(2 * s + 1) * z * p[s] - double(s) * p[s - 1]) / double(s + 1);
  q[s] = (after - p[s - 1]) / (2 * double(2 * s + 1));
  return q;
}

Matrix legendre_rows(const Vector& at) {
  const Vector z = 2 * at.array() - 1;
  Matrix p(at.size(), s + 1);
  p.col(0).setOnes();
  p.col(1) = z;
  for (Index k = 1; k < s; ++k)
    p.col(k + 1) = (double(2 * k + 1) * z.cwiseProduct(p.col(k)) - double(k) * p.col(k - 1)) / double(k + 1);
  return p;
}

Matrix legendre_integral_rows(const Vector& at) {
  const Matrix p = legendre_rows(at);
  const Vector z = 2 * at.array() - 1;
  const Vector after = (double(2 * s + 1) * z.cwiseProduct(p.col(s)) - double(s) * p.col(s - 1)) / double(s + 1);
  Matrix q(at.size(), s + 1);
  q.col(0) = at;
  for (Index k = 1; k <= s; ++k)
    q.col(k) = ((k < s ? Vector(p.col(k + 1)) : after) - p.col(k - 1)) / (2 * double(2 * k + 1));
  return q;
}

}  // namespace bromwich
