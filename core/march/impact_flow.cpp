#include "core/march/impact_flow.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double longest = 2;    ///< of a piece, times the rate: terms of the series exceed its sum by e^2 at most
constexpr int most_terms = 100;  ///< 30 are enough for that

double norm(const SparseMatrix& A) {
  const Vector sums = A.cwiseAbs().transpose() * Vector::Ones(A.rows());
  return sums.size() > 0 ? sums.maxCoeff() : 0;
}

double largest(const Matrix& X) { return X.size() > 0 ? X.cwiseAbs().maxCoeff() : 0; }

// Of the polynomial of each entry, beside the largest of its row and of its column.
Matrix significant_terms(const std::vector<Matrix>& coefficients) {
  Matrix size = Matrix::Zero(coefficients[0].rows(), coefficients[0].cols()), terms = size;
  for (const Matrix& c : coefficients) size = size.cwiseMax(c.cwiseAbs());
  const Vector of_row = size.rowwise().maxCoeff(), of_column = size.colwise().maxCoeff();
  for (std::size_t k = 0; k < coefficients.size(); ++k)
    for (Index c = 0; c < size.cols(); ++c)
      for (Index r = 0; r < size.rows(); ++r)
        if (std::abs(coefficients[k](r, c)) > epsilon / 64 * std::min(of_row[r], of_column[c]))
          terms(r, c) = double(k) + 1;
  return terms;
}

// The terms of x are a_k d^k with a_{k+1} = (A a_k + c_k) / (k + 1). `seen`: by C, all of them.
struct SeenTerms {
  const SparseMatrix& C;
  std::vector<Matrix> values;
};

void expand(const SparseMatrix& A, double d, const QuadraticColumns& c, Matrix& X, SeenTerms* seen = nullptr) {
  Matrix term = X, next;
  if (seen) seen->values.assign(1, seen->C * X);
  double power = 1;
  bool small = false;
  for (int k = 0; k < most_terms; ++k) {
    next.noalias() = A * term;
    power *= d;
    next *= d;
    if (k < 3 && c[std::size_t(k)].size() > 0) next += power * c[std::size_t(k)];
    term = next / double(k + 1);
    X += term;
    if (seen) seen->values.push_back(seen->C * term);
    const bool smaller = largest(term) <= epsilon / 8 * largest(X);
    if (k >= 3 && smaller && small) return;  // one term may vanish by itself
    small = smaller;
  }
}

}  // namespace

ImpactFlow::ImpactFlow(const SparseMatrix& A) : A_(A), rate_(std::sqrt(norm(SparseMatrix(A * A)))) {}

Index ImpactFlow::pieces(double d) const {
  return std::max<Index>(1, Index(std::ceil(std::min(1e9, rate_ * d / longest))));
}

void ImpactFlow::advance(double d, const QuadraticColumns& c, Matrix& X) const {
  const Index count = pieces(d);
  const double length = d / double(count);
  expand(A_, length, c, X);
  for (Index k = 1; k < count; ++k) {
    const double s = double(k) * length;
    QuadraticColumns here = c;
    if (c[2].size() > 0) here[1] = (c[1].size() > 0 ? Matrix(c[1] + 2 * s * c[2]) : Matrix(2 * s * c[2]));
    if (c[2].size() > 0) here[0] += s * s * c[2];
    if (c[1].size() > 0) here[0] += s * c[1];
    expand(A_, length, here, X);
  }
}

ImpactResponse::ImpactResponse(const ImpactFlow& flow, const SparseMatrix& B, const SparseMatrix& C, double h)
    : length_(h / double(flow.pieces(h))), outputs_(C.rows()) {
  const QuadraticColumns input{Matrix(B), {}, {}};
  Matrix X = Matrix::Zero(B.rows(), B.cols());
  SeenTerms seen{C, {}};
  for (Index piece = 0; piece < flow.pieces(h); ++piece) {
    expand(flow.matrix(), length_, input, X, &seen);
    Matrix& entries = entries_.emplace_back(Index(seen.values.size()), C.rows() * B.cols());
    for (std::size_t k = 0; k < seen.values.size(); ++k) entries.row(Index(k)) = seen.values[k].reshaped().transpose();
    terms_.push_back(significant_terms(seen.values));
  }
  rows_.resize(std::size_t(B.cols()));
  for (Index c = 0; c < B.cols(); ++c)
    for (Index r = 0; r < outputs_; ++r)
      if (std::any_of(terms_.begin(), terms_.end(), [&](const Matrix& of_piece) { return of_piece(r, c) > 0; }))
        rows_[std::size_t(c)].push_back(r);
}

double ImpactResponse::at(double d, Index row, Index column) const {
  const double pieces = d / length_;
  const std::size_t piece = std::min(std::size_t(pieces), entries_.size() - 1);
  const auto c = entries_[piece].col(column * outputs_ + row);
  const double s = pieces - double(piece);
  double sum = 0;
  for (Index k = Index(terms_[piece](row, column)) - 1; k >= 0; --k) sum = sum * s + c[k];
  return sum / d;
}

}  // namespace bromwich
