#include "core/kernel/ringing.hpp"

#include "core/lcp/active_set.hpp"
#include "core/lcp/entries.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <cmath>

namespace bromwich {

namespace {

constexpr double margin = 1, ringing_margin = 0.1;  ///< delta
constexpr Index most_sets_n = 12;                   ///< active sets are enumerated up to this size

// Sign of the determinant; 0 if the matrix is singular to rounding after equilibration.
int determinant_sign(Matrix matrix) {
  for (Index i = 0; i < matrix.rows(); ++i) matrix.row(i) /= std::max(matrix.row(i).cwiseAbs().maxCoeff(), 1e-300);
  for (Index i = 0; i < matrix.cols(); ++i) matrix.col(i) /= std::max(matrix.col(i).cwiseAbs().maxCoeff(), 1e-300);
  const Eigen::PartialPivLU<Matrix> lu(matrix);
  if (!(lu.rcond() > 1e3 * epsilon)) return 0;
  const double d = lu.permutationP().determinant() * lu.matrixLU().diagonal().array().sign().prod();
  return d > 0 ? 1 : -1;
}

// Whether the symmetric part is larger than a part of M: each block M_SS is then far from a singular one, with a
// positive determinant.
bool is_clearly_definite(const Matrix& M) {
  constexpr double part = 1e-4;
  Matrix symmetric = 0.5 * (M + M.transpose());
  symmetric.diagonal().array() -= part * M.cwiseAbs().rowwise().sum().maxCoeff();
  return Eigen::LLT<Matrix>(symmetric).info() == Eigen::Success;
}

bool same_minors(const Matrix& a, const Matrix& b) {
  const Index n = a.rows();
  if (is_clearly_definite(a) && is_clearly_definite(b)) return true;
  for (unsigned set = 1; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    const int sign = determinant_sign(a(S, S));
    if (sign == 0 || sign != determinant_sign(b(S, S))) return false;
  }
  return true;
}

// For the active sets with a regular M_SS alone. More than most_sets_n constraints: those of one.
bool same_minors_where_regular(const Matrix& M, const Matrix& a, const Matrix& b) {
  const Index n = M.rows();
  if (n > most_sets_n) {
    for (Index i = 0; i < n; ++i)
      if (M(i, i) > 0 && !(a(i, i) > 0 && b(i, i) > 0)) return false;
    return true;
  }
  for (unsigned set = 1; set < 1u << n; ++set) {
    const std::vector<Index> S = members(set, n);
    if (determinant_sign(M(S, S)) == 0) continue;
    const int sign = determinant_sign(a(S, S));
    if (sign == 0 || sign != determinant_sign(b(S, S))) return false;
  }
  return true;
}

// Where M is semidefinite, with what B or N does outside its range.
BasisChoice discontinuous(const std::string& reason, bool rings, const RangeOfM& of_M) {
  BasisChoice choice{false, rings, reason};
  if (of_M.why.empty()) return choice;
  choice.reason += " (" + of_M.why + ")";
  if (of_M.moves_only_outputs) choice.refusal = "sweeps may meet problems without a solution";
  return choice;
}

// at_minus_one = W^(-1).
BasisChoice decide(const LcpMatrix& M, LcpClass lcp_class, const Matrix& w0, const Matrix& at_minus_one,
                   const RangeOfM& of_M) {
  const BasisChoice without = choose_basis(M, lcp_class, of_M);
  if (selects_least(lcp_class)) return without;
  if (!at_minus_one.allFinite()) return discontinuous("the step meets an oscillation of the scene", true, {});
  const std::string reason = "M leaves y to the dynamics at this step";
  const Matrix dense = to_dense(M);
  const auto keeps_its_kind = [&](double delta) -> bool {
    const Matrix damped = dense + at_minus_one - delta * w0;
    if (of_M.range && of_M.range->holds_outputs)
      return of_M.range->holds_definite(dense + w0) && of_M.range->holds_definite(damped);
    if (of_M.range) return same_minors_where_regular(dense, dense + w0, damped);
    // Larger ones: principal minors of size one only. For other P-matrices the solution is checked (ringing_from).
    return dense.rows() <= most_sets_n ? same_minors(dense + w0, damped) : (damped.diagonal().array() > 0).all();
  };
  if (dense.rows() > most_sets_n && !has_one_solution(lcp_class) && !of_M.range) return without;
  if (keeps_its_kind(margin)) return without;
  return discontinuous(reason, !keeps_its_kind(ringing_margin), of_M);
}

}  // namespace

BasisChoice choose_basis(const LcpMatrix& M, LcpClass lcp_class, const Matrix& w0, const Matrix& at_minus_one,
                         const RangeOfM& of_M) {
  return decide(M, lcp_class, w0, at_minus_one, of_M);
}

BasisChoice choose_basis(const LcpMatrix& M, LcpClass lcp_class, const RangeOfM& of_M) {
  if (has_one_solution(lcp_class) || of_M.range) {
    BasisChoice choice;
    choice.only_in_sweeps = of_M.range && !of_M.range->holds_outputs;
    if (choice.only_in_sweeps) choice.reason = "N x leaves the range of M + M^T";
    return choice;
  }
  if (selects_least(lcp_class) && (diagonal(M).array() != 0).any()) return {};
  return !selects_least_norm(lcp_class) && is_regular(M) ? BasisChoice{}
                                                         : discontinuous("M leaves y to the dynamics", true, of_M);
}

BasisChoice choose_basis(const LcpMatrix& M, LcpClass lcp_class, const DenseRecurrence& r, const RangeOfM& of_M) {
  const Index m = r.decay.rows();
  // Σ_{d>=1} (-1)^d C E^{d-1} G = -C (I + E)^{-1} G.
  const Matrix sum = Matrix::Identity(m, m) + r.decay;
  const Equilibration e = equilibrate(sum);
  const Eigen::PartialPivLU<Matrix> lu(e.rows.asDiagonal() * sum * e.columns.asDiagonal());
  const bool regular = lu.rcond() > epsilon;
  const Matrix at = r.w0 - (r.output * e.columns.asDiagonal()) * lu.solve(e.rows.asDiagonal() * r.input);
  return decide(M, lcp_class, r.w0, regular ? at : Matrix::Constant(at.rows(), at.cols(), NAN), of_M);
}

BasisChoice choose_basis(const LcpMatrix& M, LcpClass lcp_class, const LagTable& table, const RangeOfM& of_M) {
  const Index n = table.outputs;
  RowMatrix sum = table.W.row(0), last = sum;
  for (Index d = 1; d < table.W.rows(); ++d) {
    last = sum;
    sum += (d % 2 == 0 ? 1 : -1) * table.W.row(d);
  }
  const RowMatrix mean = 0.5 * (sum + last);  // consecutive partial sums of a slowly
                                              // changing alternating series bracket it
  const auto square = [n](const RowMatrix& row) { return Matrix(Eigen::Map<const RowMatrix>(row.data(), n, n)); };
  return decide(M, lcp_class, square(table.W.row(0)), square(mean), of_M);
}

Index ringing_from(const RowMatrix& y) {
  const Index n = y.cols();
  Vector largest = Vector::Zero(n);
  largest_of_columns(y, 0, y.rows(), largest);
  if (!alternates(y, 0, y.rows(), ringing_part * largest, ringing_run)) return -1;
  using Row = Eigen::Array<double, 1, Eigen::Dynamic>;
  const Row scale = ringing_part * largest.transpose().array();
  Row before = Row::Zero(n), first = before, length = before, bend(n), size(n);
  for (Index j = 1; j + 1 < y.rows(); ++j) {
    bend = y.row(j - 1).array() - 2 * y.row(j).array() + y.row(j + 1).array();
    size = bend.abs();
    length = (size > scale && bend * before < 0).select(length + 1, 0);
    first = (length == 0).select(size, first);
    before = bend;
    if (n == 0 || !(length.maxCoeff() >= double(ringing_run))) continue;
    for (Index i = 0; i < n; ++i)
      if (length[i] >= double(ringing_run) && size[i] > 0.3 * first[i]) return j - Index(length[i]);
  }
  return -1;
}

}  // namespace bromwich
