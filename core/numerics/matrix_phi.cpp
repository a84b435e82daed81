#include "core/numerics/matrix_phi.hpp"

#include "core/numerics/phi.hpp"
#include "core/numerics/sectorial.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>

namespace bromwich {

using namespace phi_series;

namespace {

// Above this size the block matrix with 3m rows costs more than doublings of three m x m matrices.
constexpr Index largest_block = 16;

double largest_column_sum(const Matrix& A) { return A.cwiseAbs().colwise().sum().maxCoeff(); }

// Squaring multiplies rounding errors by the norm: above this limit more than three digits are lost.
constexpr double stiff_norm = 1024;

std::optional<std::vector<Matrix>> stiff_phis(const Matrix& A, int last) {
  return largest_column_sum(A) > stiff_norm ? sectorial_phis(A, last) : std::nullopt;
}

// A computed symmetric matrix is symmetric up to rounding of its largest entries.
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
  const double norm = largest_column_sum(A);
  const int doublings = norm > series_radius ? int(std::ceil(std::log2(norm / series_radius))) : 0;
  const Matrix X = std::ldexp(1.0, -doublings) * A;
  // Paterson and Stockmeyer: polynomials of degree 3 in X are the coefficients of a polynomial in X^4.
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
  const double norm = largest_column_sum(A);
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

MatrixPhi matrix_phi(const Matrix& A) {
  if (A.rows() == 0) return {A, A, A};
  if (is_symmetric(A)) return symmetric_phi(0.5 * (A + A.transpose()));
  if (auto stiff = stiff_phis(A, 2)) return {(*stiff)[0], (*stiff)[1], (*stiff)[2]};
  return A.rows() <= largest_block ? block_phi(A) : doubled_phi(A);
}

}  // namespace bromwich
