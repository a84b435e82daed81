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

namespace {

// Above this size the block matrix of 3m rows costs more than doublings of three m x m matrices.
constexpr Index largest_block = 16;

MatrixPhi symmetric_phi(const Matrix& A) {
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(A);
  const Matrix& V = eigen.eigenvectors();
  const Vector& lambda = eigen.eigenvalues();
  const auto function = [&](double (*f)(double)) -> Matrix {
    return V * lambda.unaryExpr(f).asDiagonal() * V.transpose();
  };
  return {function(+[](double x) { return std::exp(x); }), function(+[](double x) { return phi1(x); }),
          function(+[](double x) { return phi2(x); })};
}

MatrixPhi block_phi(const Matrix& A) {
  const Index m = A.rows();
  Matrix block = Matrix::Zero(3 * m, 3 * m);
  block.topLeftCorner(m, m) = A;
  block.block(0, m, m, m).setIdentity();
  block.block(m, 2 * m, m, m).setIdentity();
  const Matrix e = block.exp();
  return {e.topLeftCorner(m, m), e.block(0, m, m, m), e.topRightCorner(m, m)};
}

MatrixPhi doubled_phi(const Matrix& A) {
  const Index m = A.rows();
  const Matrix I = Matrix::Identity(m, m);
  const double norm = A.cwiseAbs().colwise().sum().maxCoeff();
  const int doublings = norm > series_radius ? int(std::ceil(std::log2(norm / series_radius))) : 0;
  const Matrix X = std::ldexp(1.0, -doublings) * A;
  // Paterson and Stockmeyer: polynomials of degree 3 in X, themselves the coefficients of one in X^4.
  const Matrix X2 = X * X, X3 = X2 * X, X4 = X2 * X2;
  Matrix p2 = phi2_coefficients.back() * I;
  for (std::size_t k = phi2_coefficients.size() - 1; k > 0;) {
    k -= 4;
    p2 = (X4 * p2).eval();
    p2 += phi2_coefficients[k + 3] * X3 + phi2_coefficients[k + 2] * X2 + phi2_coefficients[k + 1] * X;
    p2.diagonal().array() += phi2_coefficients[k];
  }
  Matrix p1 = I + X * p2, e = I + X * p1;
  for (int i = 0; i < doublings; ++i) {
    p2 = (0.25 * p1 * p1 + 0.5 * p2).eval();
    p1 = (0.5 * e * p1 + 0.5 * p1).eval();
    e = (e * e).eval();
  }
  return {e, p1, p2};
}

}  // namespace

MatrixPhi matrix_phi(const Matrix& A) {
  if (A.rows() == 0) return {A, A, A};
  // A symmetric matrix that was computed is so to rounding of its largest entries; it is not known better than that.
  const bool symmetric = (A - A.transpose()).cwiseAbs().maxCoeff() <= 8 * epsilon * A.cwiseAbs().maxCoeff();
  if (symmetric) return symmetric_phi(0.5 * (A + A.transpose()));
  return A.rows() <= largest_block ? block_phi(A) : doubled_phi(A);
}

}  // namespace bromwich
