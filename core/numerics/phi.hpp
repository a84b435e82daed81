#pragma once
// The phi-functions of exponential integrators: phi_0(x) = e^x and
// phi_k(x) = ∫_0^1 e^{(1-s)x} s^{k-1}/(k-1)! ds = Σ_j x^j/(j+k)!, so that phi_k(x) = 1/k! + x phi_{k+1}(x).

#include "../base/types.hpp"

#include <array>
#include <cstddef>

namespace bromwich {

double phi1(double x);
double phi2(double x);
Complex phi1(Complex x);
Complex phi2(Complex x);

/// phi_k(x), k >= 0.
double phi(int k, double x);

/// e^x, phi_1(x) and phi_2(x) of many numbers at once.
struct ArrayPhi {
  Eigen::ArrayXd exponential, phi1, phi2;
};
ArrayPhi array_phi(const Eigen::ArrayXd& x);

/// e^z - 1 without cancellation for small z.
Complex expm1(Complex z);

// The series of phi_2, for scalars, arrays and matrices alike.
namespace phi_series {

// Below this radius the closed form of phi_2 is less accurate than the series: (e^x - 1 - x)/x^2 has an absolute error
// of about eps/|x|. The series omits x^17/19! < 2^-56 |x|^17, below the rounding of phi_2 >= 0.36 for |x| < 1.
inline constexpr double series_radius = 1.0;
inline constexpr int series_terms = 18;  // of phi_k, k >= 1: the remainder is below 2/19! < 2^-54 of the first

// 1/(k+2)!, k = 0..16.
inline constexpr std::array<double, 17> phi2_coefficients = [] {
  std::array<double, 17> c{};
  double factorial = 2;
  for (std::size_t k = 0; k < c.size(); ++k) {
    c[k] = 1 / factorial;
    factorial *= double(k + 3);
  }
  return c;
}();

template <class T>
T phi2_series(const T& x) {
  T sum = 0.0 * x + phi2_coefficients.back();
  for (std::size_t k = phi2_coefficients.size() - 1; k-- > 0;) sum = phi2_coefficients[k] + x * sum;
  return sum;
}

}  // namespace phi_series

}  // namespace bromwich
