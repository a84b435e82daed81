#include "core/phi.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <array>
#include <cmath>

namespace bromwich {

namespace {

// Below this the closed form of phi_2 loses more than the series does: (e^x - 1 - x)/x^2 has absolute error about
// eps/|x|, the series below leaves out x^17/19! < 2^-56 |x|^17, below rounding of phi_2 >= 0.36 for |x| < 1.
constexpr double series_radius = 1.0;

// 1/(k+2)!, k = 0..16.
constexpr std::array<double, 17> phi2_coefficients = [] {
  std::array<double, 17> c{};
  double factorial = 2;
  for (std::size_t k = 0; k < c.size(); ++k) {
    c[k] = 1 / factorial;
    factorial *= double(k + 3);
  }
  return c;
}();

template <class T>
T phi2_series(T x) {
  T sum = phi2_coefficients.back();
  for (std::size_t k = phi2_coefficients.size() - 1; k-- > 0;) sum = phi2_coefficients[k] + x * sum;
  return sum;
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
