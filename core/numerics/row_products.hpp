#pragma once
// Products of many rows with one small or sparse matrix, in panels that fit into the cache: arrays over time are long,
// and a temporary of their size costs more than the arithmetic.

#include "../base/types.hpp"

namespace bromwich {

/// x A
RowMatrix row_products(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A);
/// (x A) · x, row by row
Vector row_forms(const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A);
/// to += diag(w) x A
void add_row_products(const Vector& w, const Eigen::Ref<const RowMatrix>& x, const SparseMatrix& A,
                      Eigen::Ref<RowMatrix> to);

}  // namespace bromwich
