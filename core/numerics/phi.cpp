#include "core/numerics/phi.hpp"

#include <array>
#include <cmath>

namespace bromwich {

using namespace phi_series;

double phi1(double x) { return x == 0 ? 1.0 : std::expm1(x) / x; }

double phi2(double x) { return std::abs(x) < series_radius ? phi2_series(x) : (phi1(x) - 1) / x; }

ArrayPhi array_phi(const Eigen::ArrayXd& x) {
  const Eigen::ArrayXd e = x.exp(), near = phi2_series(x), far = (e - 1) / x;  // e^x, phi_2 and phi_1
  ArrayPhi phi;
  phi.phi2 = (x.abs() < series_radius).select(near, (far - 1) / x);
  phi.phi1 = (x.abs() < series_radius).select(1 + x * near, far);
  phi.exponential = (x.abs() < series_radius).select(1 + x * (1 + x * near), e);
  return phi;
}

double phi(int k, double x) {
  if (k == 0) return std::exp(x);
  if (std::abs(x) >= series_radius) {  // each step divides by x, so the error does not exceed that of phi_1
    double value = phi1(x), coefficient = 1;
    for (int j = 1; j < k; ++j) {
      coefficient /= double(j);
      value = (value - coefficient) / x;
    }
    return value;
  }
  double term = 1, sum = 0;
  for (int j = 2; j <= k; ++j) term /= double(j);
  for (int j = k + 1; j <= k + series_terms; ++j) {
    sum += term;
    term *= x / double(j);
  }
  return sum;
}

Complex expm1(Complex z) {
  const double a = z.real(), b = z.imag(), s = std::sin(b / 2);
  return {std::expm1(a) * std::cos(b) - 2 * s * s, std::exp(a) * std::sin(b)};
}

Complex phi1(Complex x) { return x == 0.0 ? Complex(1) : expm1(x) / x; }

Complex phi2(Complex x) { return std::abs(x) < series_radius ? phi2_series(x) : (phi1(x) - 1.0) / x; }

}  // namespace bromwich
