#include "core/numerics/sine_basis.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

// One period of the entries of S as a table: i k is reduced exactly for any size.
Vector sine_period(Index n) {
  Vector period(2 * (n + 1));
  for (Index a = 0; a < period.size(); ++a)
    period[a] = std::sqrt(2.0 / double(n + 1)) * std::sin(std::numbers::pi * double(a) / double(n + 1));
  return period;
}

}  // namespace

Vector in_sine_basis(const Vector& v) {
  const Vector period = sine_period(v.size());
  Vector modes = Vector::Zero(v.size());
  for (Index i = 0; i < v.size(); ++i)
    for (Index k = 0; v[i] != 0 && k < v.size(); ++k) modes[k] += v[i] * period[(i + 1) * (k + 1) % period.size()];
  return modes;
}

Matrix sine_matrix(Index n) {
  const Vector period = sine_period(n);
  Matrix S(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k < n; ++k) S(k, i) = period[(i + 1) * (k + 1) % period.size()];
  return S;
}

}  // namespace bromwich
