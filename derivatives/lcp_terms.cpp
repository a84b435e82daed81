#include "derivatives/lcp_terms.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

std::vector<Index> columns_in_use(const Eigen::Ref<const RowMatrix>& rows) {
  Eigen::RowVectorXd sums = Eigen::RowVectorXd::Zero(rows.cols());
  for (Index j = 0; j < rows.rows(); ++j) sums += rows.row(j).cwiseAbs();
  std::vector<Index> found;
  for (Index i = 0; i < rows.cols(); ++i)
    if (sums[i] != 0) found.push_back(i);
  return found;
}

}  // namespace

LcpMatrix transposed(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return Matrix(dense->transpose());
  if (const SparseMatrix* sparse = sparse_of(M)) return SparseLcpMatrix(sparse->transpose());
  auto t = std::get<Tridiagonal>(M);
  for (Index i = 1; i < t.diagonal.size(); ++i) std::swap(t.lower[i], t.upper[i - 1]);
  return t;
}

LcpMatrix absolute(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) return Matrix(dense->cwiseAbs());
  if (const SparseMatrix* sparse = sparse_of(M)) return SparseLcpMatrix(sparse->cwiseAbs());
  auto t = std::get<Tridiagonal>(M);
  for (Vector* part : {&t.diagonal, &t.lower, &t.upper}) *part = part->cwiseAbs();
  return t;
}

void add_product(const LcpMatrix& M, const double* y, double* w) {
  const Index n = size(M);
  const Eigen::Map<const Vector> from(y, n);
  Eigen::Map<Vector> to(w, n);
  if (const auto* dense = std::get_if<Matrix>(&M)) {
    to.noalias() += *dense * from;
  } else if (const SparseMatrix* sparse = sparse_of(M)) {
    to += *sparse * from;
  } else {
    const auto& t = std::get<Tridiagonal>(M);
    to += t.diagonal.cwiseProduct(from);
    to.tail(n - 1) += t.lower.tail(n - 1).cwiseProduct(from.head(n - 1));
    to.head(n - 1) += t.upper.head(n - 1).cwiseProduct(from.tail(n - 1));
  }
}

void add_products(const LcpMatrix& M, const RowMatrix& y, RowMatrix& w) {
  for (Index j = 0; j < y.rows(); ++j) add_product(M, y.row(j).data(), w.row(j).data());
}

void add_transposed_product(const Eigen::Ref<const RowMatrix>& a, const Eigen::Ref<const RowMatrix>& b,
                            Eigen::Ref<Matrix> product) {
  const std::vector<Index> of_a = columns_in_use(a), of_b = columns_in_use(b);
  const Matrix part = a(Eigen::all, of_a).transpose() * b(Eigen::all, of_b);
  product(of_a, of_b) += part;
}

void add_rows_times(const Eigen::Ref<const RowMatrix>& y, const Matrix& C, Eigen::Ref<RowMatrix> rows) {
  const std::vector<Index> used = columns_in_use(y);
  rows.noalias() += RowMatrix(y(Eigen::all, used)) * Matrix(C(Eigen::all, used)).transpose();
}

// Some rows at a time: the copies that a product makes of its factors stay small.
Matrix transposed_product(const RowMatrix& a, const RowMatrix& b, const HostThreads& threads) {
  constexpr Index together = 64, columns = 128;
  Matrix product = Matrix::Zero(a.cols(), b.cols());
  share(threads, a.cols(), columns, [&](Index first, Index last) {
    for (Index j = 0; j < a.rows(); j += together) {
      const Index count = std::min(together, a.rows() - j);
      add_transposed_product(a.block(j, first, count, last - first), b.middleRows(j, count),
                             product.middleRows(first, last - first));
    }
  });
  return product;
}

std::vector<Index> positive_in(const RowMatrix& y, Index j) {
  std::vector<Index> S;
  for (Index i = 0; i < y.cols(); ++i)
    if (y(j, i) > 0) S.push_back(i);
  return S;
}

RowMatrix integral_transposed(const RowMatrix& of, double h) {
  RowMatrix weights(of.rows(), of.cols());
  Vector later = Vector::Zero(of.cols());  // weights of the integrals over [0, t_k], k > j
  for (Index j = of.rows() - 1; j >= 0; --j) {
    weights.row(j) = h / 2 * later.transpose();
    later += of.row(j).transpose();
    if (j > 0) weights.row(j) += h / 2 * later.transpose();
  }
  return weights;
}

RowMatrix integral_of(const RowMatrix& y, double h) {
  RowMatrix sums(y.rows(), y.cols());
  sums.row(0).setZero();
  for (Index j = 1; j < y.rows(); ++j) sums.row(j) = sums.row(j - 1) + (h / 2) * (y.row(j - 1) + y.row(j));
  return sums;
}

}  // namespace bromwich
