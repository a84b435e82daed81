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

MatrixPhi symmetric_phi(const Matrix& V, const Vector& lambda) {
  const auto function = [&](double (*f)(double)) -> Matrix {
    return V * lambda.unaryExpr(f).asDiagonal() * V.transpose();
  };
  return {function(+[](double x) { return std::exp(x); }), function(+[](double x) { return phi1(x); }),
          function(+[](double x) { return phi2(x); })};
}

std::vector<Matrix> symmetric_phis(const Matrix& V, const Vector& lambda, int last) {
  std::vector<Matrix> p;
  for (int k = 0; k <= last; ++k)
    p.push_back(V * lambda.unaryExpr([k](double x) { return phi(k, x); }).asDiagonal() * V.transpose());
  return p;
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

// e^X, phi_1(X) and phi_2(X) for a norm up to 1.
MatrixPhi phi_by_series(const Matrix& X) {
  const Index m = X.rows();
  const Matrix I = Matrix::Identity(m, m);
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
  return {std::move(e), std::move(p1), std::move(p2)};
}

// Those of 2X.
MatrixPhi doubled(const MatrixPhi& p) {
  return {p.exponential * p.exponential, 0.5 * p.exponential * p.phi1 + 0.5 * p.phi1,
          0.25 * p.phi1 * p.phi1 + 0.5 * p.phi2};
}

int doublings_of(double norm) { return norm > series_radius ? int(std::ceil(std::log2(norm / series_radius))) : 0; }

MatrixPhi doubled_phi(const Matrix& A) {
  const int doublings = doublings_of(largest_column_sum(A));
  MatrixPhi p = phi_by_series(std::ldexp(1.0, -doublings) * A);
  for (int i = 0; i < doublings; ++i) p = doubled(p);
  return p;
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

// phi_0(X), ..., phi_last(X) for a norm up to 1.
std::vector<Matrix> phis_by_series(const Matrix& X, int last, const std::vector<double>& inverse) {
  std::vector<Matrix> p(std::size_t(last) + 1);
  Matrix sum = inverse.back() * Matrix::Identity(X.rows(), X.rows());
  for (int j = last + series_terms - 1; j >= 0; --j) {  // Horner: sum is phi_j once j <= last
    sum = (X * sum).eval();
    sum.diagonal().array() += inverse[std::size_t(j)];
    if (j <= last) p[std::size_t(j)] = sum;
  }
  return p;
}

}  // namespace

std::vector<Matrix> matrix_phis(const Matrix& A, int last) {
  if (A.rows() == 0) return std::vector<Matrix>(std::size_t(last) + 1, A);
  if (is_symmetric(A)) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(0.5 * (A + A.transpose())));
    return symmetric_phis(eigen.eigenvectors(), eigen.eigenvalues(), last);
  }
  if (auto stiff = stiff_phis(A, last)) return *stiff;
  const int doublings = doublings_of(largest_column_sum(A));
  const std::vector<double> inverse = inverse_factorials(last + series_terms);
  std::vector<Matrix> p = phis_by_series(std::ldexp(1.0, -doublings) * A, last, inverse);
  for (int i = 0; i < doublings; ++i) p = doubled_phis(p, inverse);
  return p;
}

MatrixPhi matrix_phi(const Matrix& A) {
  if (A.rows() == 0) return {A, A, A};
  if (is_symmetric(A)) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(0.5 * (A + A.transpose())));
    return symmetric_phi(eigen.eigenvectors(), eigen.eigenvalues());
  }
  if (auto stiff = stiff_phis(A, 2)) return {(*stiff)[0], (*stiff)[1], (*stiff)[2]};
  return A.rows() <= largest_block ? block_phi(A) : doubled_phi(A);
}

namespace {

constexpr Index largest_kept = 512;  ///< states: 6 matrices of 2 MiB for each step and each of its halves
constexpr double most_kept_numbers = double(Index(1) << 25);  ///< 256 MiB
constexpr int last_of_six = 5;

}  // namespace

PhiFamily::PhiFamily(Matrix A) : A_(std::move(A)), keeps_(A_.rows() <= largest_kept) {
  if (A_.rows() > 0) norm_ = largest_column_sum(A_);
}

bool PhiFamily::symmetric() {
  if (!looked_ && A_.rows() > 0 && A_.allFinite() && is_symmetric(A_)) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(0.5 * (A_ + A_.transpose())));
    V_ = eigen.eigenvectors();
    lambda_ = eigen.eigenvalues();
    ++counts_.made;
  }
  looked_ = true;
  return V_.size() > 0;
}

template <class Phis, class Make>
std::shared_ptr<const Phis> PhiFamily::kept_or(Kept<Phis>& kept, double h, const Make& make) {
  constexpr double same = 4 * epsilon;  // steps of grids of pieces agree to rounding
  if (const auto found = kept.lower_bound(h * (1 - same)); found != kept.end() && found->first <= h * (1 + same)) {
    ++counts_.kept;
    return found->second;
  }
  auto made = std::make_shared<const Phis>(make());
  if (!keeps_) return made;
  if (double(kept.size() + 1) * 6 * double(A_.size()) > most_kept_numbers) kept.clear();
  kept[h] = made;
  return made;
}

template <class Phis, class Series, class Twice>
std::shared_ptr<const Phis> PhiFamily::by_doubling(Kept<Phis>& kept, double h, const Series& series,
                                                   const Twice& twice) {
  return kept_or(kept, h, [&]() -> Phis {
    if (!(h * norm_ > series_radius)) {
      ++counts_.made;
      return series(h);
    }
    const auto half = by_doubling(kept, h / 2, series, twice);
    ++counts_.doubled;
    return twice(*half);
  });
}

std::shared_ptr<const MatrixPhi> PhiFamily::phi(double h) {
  if (symmetric()) return kept_or(three_, h, [&] { return symmetric_phi(V_, h * lambda_); });
  const bool whole = !(h * norm_ <= stiff_norm) || A_.rows() <= largest_block || !keeps_;
  if (whole)
    return kept_or(three_, h, [&] {
      ++counts_.made;
      return matrix_phi(h * A_);
    });
  return by_doubling(
      three_, h, [&](double step) { return phi_by_series(step * A_); }, doubled);
}

std::shared_ptr<const std::vector<Matrix>> PhiFamily::phis(double h) {
  if (symmetric()) return kept_or(six_, h, [&] { return symmetric_phis(V_, h * lambda_, last_of_six); });
  if (!(h * norm_ <= stiff_norm) || A_.rows() == 0 || !keeps_)
    return kept_or(six_, h, [&] {
      ++counts_.made;
      return matrix_phis(h * A_, last_of_six);
    });
  const std::vector<double> inverse = inverse_factorials(last_of_six + series_terms);
  return by_doubling(
      six_, h, [&](double step) { return phis_by_series(step * A_, last_of_six, inverse); },
      [&](const std::vector<Matrix>& p) { return doubled_phis(p, inverse); });
}

}  // namespace bromwich
