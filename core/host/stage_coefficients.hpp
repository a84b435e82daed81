#pragma once
// The coefficients of core/host/stage_step.hpp in complex (Radau IIA) or real (implicit Euler) arithmetic.

#include "../base/types.hpp"

#include <cmath>

namespace bromwich::host {

template <class Scalar>
struct Coefficients;

template <>
struct Coefficients<Complex> {
  static constexpr Index stages = 2;
  Complex mu{2, std::sqrt(2.0)};
  Complex v[2] = {1, Complex(1, 2 * std::sqrt(2.0))};
  Complex w[2] = {std::conj(v[1]) / (std::conj(v[1]) - v[1]), -1.0 / (std::conj(v[1]) - v[1])};
  Complex start = 2.0 * w[0] - 2.0 * w[1];  // w · L1, L1 = (2, -2)
  static Matrix real(const Eigen::Ref<const ComplexMatrix>& z) { return 2 * z.real(); }
  static double real(Complex z) { return 2 * z.real(); }
};

template <>
struct Coefficients<double> {
  static constexpr Index stages = 1;
  double mu = 1;
  double v[1] = {1};
  double w[1] = {1};
  double start = 1;
  static const Matrix& real(const Matrix& z) { return z; }
  static double real(double z) { return z; }
};

}  // namespace bromwich::host
