#include "core/phi.hpp"

#include "core/sectorial.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <array>
#include <cmath>

namespace bromwich {

namespace {

// Below this the closed form of phi_2 loses more than the series does: (e^x - 1 - x)/x^2 has absolute error about
// eps/|x|, the series below leaves out x^17/19! < 2^-56 |x|^17, below rounding of phi_2 >= 0.36 for |x| < 1.
constexpr double series_radius = 1.0;
constexpr int series_terms = 18;  // of phi_k, k >= 1: what is left out is below 2/19! < 2^-54 of the first

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
T phi2_series(const T& x) {
  T sum = 0.0 * x + phi2_coefficients.back();
  for (std::size_t k = phi2_coefficients.size() - 1; k-- > 0;) sum = phi2_coefficients[k] + x * sum;
  return sum;
}

}  // namespace

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
  if (std::abs(x) >= series_radius) {  // each step divides by x: the error stays below that of phi_1
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

namespace {

// Above this size the block matrix of 3m rows costs more than doublings of three m x m matrices.
constexpr Index largest_block = 16;

double one_norm(const Matrix& A) { return A.cwiseAbs().colwise().sum().maxCoeff(); }

// Squaring multiplies rounding by the norm: above this it costs more than three digits.
constexpr double stiff_norm = 1024;

std::optional<std::vector<Matrix>> stiff_phis(const Matrix& A, int last) {
  return one_norm(A) > stiff_norm ? sectorial_phis(A, last) : std::nullopt;
}

// A symmetric matrix that was computed is so to rounding of its largest entries; it is not known better than that.
bool is_symmetric(const Matrix& A) {
  return (A - A.transpose()).cwiseAbs().maxCoeff() <= 8 * epsilon * A.cwiseAbs().maxCoeff();
}

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
  const double norm = one_norm(A);
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

std::vector<double> inverse_factorials(int last) {
  std::vector<double> inverse{1};
  for (int k = 1; k <= last; ++k) inverse.push_back(inverse.back() / double(k));
  return inverse;
}

// phi_k(2X) from phi_0(X), ..., phi_last(X).
std::vector<Matrix> doubled_phis(const std::vector<Matrix>& p, const std::vector<double>& inverse_factorial) {
  std::vector<Matrix> twice;
  for (std::size_t k = 0; k < p.size(); ++k) {
    const std::size_t a = k / 2, b = k - a;
    Matrix sum = p[a] * p[b];
    for (std::size_t j = a + 1; j <= k; ++j) sum += inverse_factorial[k - j] * p[j];
    for (std::size_t j = b + 1; j <= k; ++j) sum += inverse_factorial[k - j] * p[j];
    twice.push_back(std::ldexp(1.0, -int(k)) * sum);
  }
  return twice;
}

}  // namespace

std::vector<Matrix> matrix_phis(const Matrix& A, int last) {
  std::vector<Matrix> p(std::size_t(last) + 1, A);
  if (A.rows() == 0) return p;
  if (is_symmetric(A)) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(0.5 * (A + A.transpose()));
    const Matrix& V = eigen.eigenvectors();
    for (int k = 0; k <= last; ++k)
      p[std::size_t(k)] =
          V * eigen.eigenvalues().unaryExpr([k](double x) { return phi(k, x); }).asDiagonal() * V.transpose();
    return p;
  }
  if (auto stiff = stiff_phis(A, last)) return *stiff;
  const double norm = one_norm(A);
  const int doublings = norm > series_radius ? int(std::ceil(std::log2(norm / series_radius))) : 0;
  const Matrix X = std::ldexp(1.0, -doublings) * A;
  const std::vector<double> inverse = inverse_factorials(last + series_terms);
  Matrix sum = inverse.back() * Matrix::Identity(A.rows(), A.rows());
  for (int j = last + series_terms - 1; j >= 0; --j) {  // Horner: sum is phi_j once j <= last
    sum = (X * sum).eval();
    sum.diagonal().array() += inverse[std::size_t(j)];
    if (j <= last) p[std::size_t(j)] = sum;
  }
  for (int i = 0; i < doublings; ++i) p = doubled_phis(p, inverse);
  return p;
}

std::vector<Matrix> contour_phis(const Matrix& A, const Contour& contour, int last) {
  const Index m = A.rows();
  std::vector<Matrix> p(std::size_t(last) + 1, Matrix::Zero(m, m));
  for (Index i = 0; i < contour.nodes.size(); ++i) {
    const Complex z = contour.nodes[i];
    ComplexMatrix shifted = -A.cast<Complex>();
    shifted.diagonal().array() += z;
    const ComplexMatrix inverse = shifted.partialPivLu().inverse();
    Complex factor = contour.weights[i] * std::exp(z);
    for (Matrix& value : p) {
      value += (factor * inverse).real();
      factor /= z;
    }
  }
  return p;
}

MatrixPhi matrix_phi(const Matrix& A) {
  if (A.rows() == 0) return {A, A, A};
  if (is_symmetric(A)) return symmetric_phi(0.5 * (A + A.transpose()));
  if (auto stiff = stiff_phis(A, 2)) return {(*stiff)[0], (*stiff)[1], (*stiff)[2]};
  return A.rows() <= largest_block ? block_phi(A) : doubled_phi(A);
}

}  // namespace bromwich
