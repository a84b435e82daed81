#include "core/phi.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>

namespace bromwich {

namespace {

// Below this the closed form of phi_2 loses more than the series does: (e^x - 1 - x)/x^2 has absolute error about
// eps/|x|, the series below is truncated at x^13/15! < 2^-53 for |x| < 1.
constexpr double series_radius = 1.0;

template <class T>
T phi2_series(T x) {
  T sum = 0;
  for (int k = 15; k >= 2; --k) sum = 1.0 + x * sum / double(k + 1);
  return 0.5 * sum;
}

}  // namespace

double phi1(double x) { return x == 0 ? 1.0 : std::expm1(x) / x; }

double phi2(double x) { return std::abs(x) < series_radius ? phi2_series(x) : (phi1(x) - 1) / x; }

Complex expm1(Complex z) {
  const double a = z.real(), b = z.imag(), s = std::sin(b / 2);
  return {std::expm1(a) * std::cos(b) - 2 * s * s, std::exp(a) * std::sin(b)};
}

Complex phi1(Complex x) { return x == 0.0 ? Complex(1) : expm1(x) / x; }

Complex phi2(Complex x) { return std::abs(x) < series_radius ? phi2_series(x) : (phi1(x) - 1.0) / x; }

MatrixPhi matrix_phi(const Matrix& A) {
  const Index m = A.rows();
  if (m == 0) return {A, A, A};
  Matrix block = Matrix::Zero(3 * m, 3 * m);
  block.topLeftCorner(m, m) = A;
  block.block(0, m, m, m).setIdentity();
  block.block(m, 2 * m, m, m).setIdentity();
  const Matrix e = block.exp();
  return {e.topLeftCorner(m, m), e.block(0, m, m, m), e.topRightCorner(m, m)};
}

}  // namespace bromwich
