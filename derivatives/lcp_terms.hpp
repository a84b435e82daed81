#pragma once
// Terms of M, and of tables of time points, in derivatives.

#include "../core/base/threads.hpp"
#include "../core/lcp/matrix.hpp"

#include <vector>

namespace bromwich {

LcpMatrix transposed(const LcpMatrix&);
/// |M_ik|.
LcpMatrix absolute(const LcpMatrix&);

/// w += M y, n values each.
void add_product(const LcpMatrix& M, const double* y, double* w);
/// The same for all rows.
void add_products(const LcpMatrix& M, const RowMatrix& y, RowMatrix& w);

/// product += a^T b. Columns of zeros cost nothing.
void add_transposed_product(const Eigen::Ref<const RowMatrix>& a, const Eigen::Ref<const RowMatrix>& b,
                            Eigen::Ref<Matrix> product);
/// rows += y C^T, likewise.
void add_rows_times(const Eigen::Ref<const RowMatrix>& y, const Matrix& C, Eigen::Ref<RowMatrix> rows);
/// a^T b.
Matrix transposed_product(const RowMatrix& a, const RowMatrix& b, const HostThreads& = HostThreads());

/// The i with y_ji > 0.
std::vector<Index> positive_in(const RowMatrix& y, Index j);

/// The weights of y in Σ_j of_j · ∫_0^{t_j} y, y linear between time points at distance h.
RowMatrix integral_transposed(const RowMatrix& of, double h);
/// ∫_0^{t_j} y.
RowMatrix integral_of(const RowMatrix& y, double h);

}  // namespace bromwich
