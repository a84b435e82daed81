#include "core/row_products.hpp"

#include <algorithm>

namespace bromwich {
namespace {

constexpr Index panel_rows = 128;
constexpr Index largest_dense_factor = 64;  ///< rows and columns; above, A is multiplied as it is

/// visit(first row, rows, their products) panel by panel.
template <typename Visit>
void each_panel(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A, const Visit& visit) {
  const bool dense = std::max(A.rows(), A.cols()) <= largest_dense_factor;
  const Matrix full = dense ? Matrix(A) : Matrix();
  RowMatrix panel;
  for (Index first = 0; first < x.rows(); first += panel_rows) {
    const Index rows = std::min(panel_rows, x.rows() - first);
    if (dense)
      panel.noalias() = x.middleRows(first, rows) * full;
    else
      panel = x.middleRows(first, rows) * A;
    visit(first, rows, panel);
  }
}

}  // namespace

RowMatrix row_products(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A) {
  RowMatrix product(x.rows(), A.cols());
  each_panel(x, A, [&](Index first, Index rows, const RowMatrix& panel) { product.middleRows(first, rows) = panel; });
  return product;
}

Vector row_forms(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A, const Eigen::Ref<const RowMatrix>& y) {
  Vector forms(x.rows());
  each_panel(x, A, [&](Index first, Index rows, const RowMatrix& panel) {
    forms.segment(first, rows) = panel.cwiseProduct(y.middleRows(first, rows)).rowwise().sum();
  });
  return forms;
}

void add_row_products(const Vector& w, const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A,
                      Eigen::Ref<RowMatrix> to) {
  each_panel(x, A, [&](Index first, Index rows, const RowMatrix& panel) {
    to.middleRows(first, rows) += w.segment(first, rows).asDiagonal() * panel;
  });
}

}  // namespace bromwich
