#include "core/lcp/lcp_class.hpp"

#include "core/base/text.hpp"
#include "core/lcp/comparison.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

struct PositiveEntry {
  Index row, column;
  double value;
};

// The first positive entry off the diagonal.
std::optional<PositiveEntry> positive_off_diagonal(const LcpMatrix& M) {
  std::optional<PositiveEntry> found;
  const auto look_at = [&found](Index i, Index j, double value) {
    if (!found && i != j && value > 0) found = {i, j, value};
  };
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    each_entry(*t, look_at);
    return found;
  }
  if (const auto* sparse = sparse_of(M)) {
    for (Index j = 0; j < sparse->outerSize(); ++j)
      for (SparseMatrix::InnerIterator a(*sparse, j); a; ++a) look_at(a.row(), j, a.value());
    return found;
  }
  const Matrix& dense = std::get<Matrix>(M);
  for (Index i = 0; i < dense.rows() && !found; ++i)
    for (Index j = 0; j < dense.cols(); ++j) look_at(i, j, dense(i, j));
  return found;
}

bool strictly_dominant(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    const Index n = t->diagonal.size();
    bool rows = true, columns = true;
    for (Index i = 0; i < n; ++i) {
      const double left = i > 0 ? std::abs(t->lower[i]) : 0, right = i + 1 < n ? std::abs(t->upper[i]) : 0;
      const double above = i > 0 ? std::abs(t->upper[i - 1]) : 0, below = i + 1 < n ? std::abs(t->lower[i + 1]) : 0;
      rows = rows && t->diagonal[i] > left + right;
      columns = columns && t->diagonal[i] > above + below;
    }
    return rows || columns;
  }
  if (const auto* sparse = sparse_of(M)) {
    const SparseMatrix size = sparse->cwiseAbs();
    const Vector ones = Vector::Ones(size.rows()), twice = 2 * sparse->diagonal();
    return (twice.array() > (size * ones).array()).all() || (twice.array() > (size.transpose() * ones).array()).all();
  }
  const Matrix& dense = std::get<Matrix>(M);
  const Vector twice = 2 * dense.diagonal();
  return (twice.array() > dense.cwiseAbs().rowwise().sum().array()).all() ||
         (twice.array() > dense.cwiseAbs().colwise().sum().transpose().array()).all();
}

// D M D with the largest entry of every row of |M| + |M|^T about one: the same definiteness, with comparable rounding.
LcpMatrix congruent(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    const Index n = t->diagonal.size();
    Tridiagonal sizes = *t;
    sizes.diagonal = t->diagonal.cwiseAbs();
    for (Index i = 0; i + 1 < n; ++i)
      sizes.upper[i] = sizes.lower[i + 1] = std::max(std::abs(t->upper[i]), std::abs(t->lower[i + 1]));
    const Vector d = equilibrate(sizes).rows;
    return scaled(M, {d, d});
  }
  if (const auto* sparse = sparse_of(M)) {
    const SparseMatrix size = sparse->cwiseAbs(), transposed = size.transpose();
    const Vector d = equilibrate(SparseMatrix(size + transposed)).rows;
    return scaled(M, {d, d});
  }
  const Matrix& dense = std::get<Matrix>(M);
  const Vector d = equilibrate(Matrix(dense.cwiseAbs().cwiseMax(dense.transpose().cwiseAbs()))).rows;
  return scaled(M, {d, d});
}

// Definiteness of S = M + M^T for any rounding of the entries of M: rounding moves the eigenvalues of S by at most
// those of E = diag(c eps Σ_j |m_ij| + |m_ji|). S + E or S - E is scaled to a unit diagonal, which preserves signs.
constexpr double entry_rounding = 4 * epsilon;

// Whether the Cholesky factorization of the scaled matrix with `margin` added to the diagonal succeeds. Its rounding is
// below 32 n eps for a unit diagonal.
bool definite(const Matrix& M, double sign) {
  const Index n = M.rows();
  Matrix S = M + M.transpose();
  const Vector E = entry_rounding * (M.cwiseAbs().rowwise().sum() + M.cwiseAbs().colwise().sum().transpose());
  S.diagonal() += sign * E;
  Vector scale(n);
  for (Index i = 0; i < n; ++i) {
    if (S(i, i) < 0 || (sign < 0 && S(i, i) == 0)) return false;
    scale[i] = S(i, i) > 0 ? 1 / std::sqrt(S(i, i)) : 1;  // with E, S_ii = 0 only if row and column are zero
  }
  S = scale.asDiagonal() * S * scale.asDiagonal();
  S.diagonal().setConstant(1 + sign * 32 * double(n) * epsilon);
  return Eigen::LLT<Matrix>(S).info() == Eigen::Success;
}

// The same by a sparse factorization; its rounding is no larger.
bool definite(const SparseMatrix& M, double sign) {
  const Index n = M.rows();
  const SparseMatrix transposed = M.transpose(), size = M.cwiseAbs() + transposed.cwiseAbs();
  SparseMatrix S = M + transposed;
  Vector d = S.diagonal() + sign * entry_rounding * (size * Vector::Ones(n)), scale(n);
  for (Index i = 0; i < n; ++i) {
    if (d[i] < 0 || (sign < 0 && d[i] == 0)) return false;
    scale[i] = d[i] > 0 ? 1 / std::sqrt(d[i]) : 1;
  }
  S = scale.asDiagonal() * S * scale.asDiagonal();
  SparseMatrix margin(n, n);
  margin.setIdentity();
  d = Vector::Constant(n, 1 + sign * 32 * double(n) * epsilon) - S.diagonal();
  S += SparseMatrix(margin * d.asDiagonal());
  return Eigen::SimplicialLLT<SparseMatrix>(S).info() == Eigen::Success;
}

bool definite(const SparseLcpMatrix& M, double sign) { return definite(*M.entries, sign); }

// The same by the pivots of the symmetric tridiagonal matrix.
bool definite(const Tridiagonal& t, double sign) {
  const Index n = t.diagonal.size();
  double pivot = 1, last = 1;
  for (Index i = 0; i < n; ++i) {
    const double off = i > 0 ? t.lower[i] + t.upper[i - 1] : 0;
    double row = 2 * std::abs(t.diagonal[i]);
    if (i > 0) row += std::abs(t.lower[i]) + std::abs(t.upper[i - 1]);
    if (i + 1 < n) row += std::abs(t.upper[i]) + std::abs(t.lower[i + 1]);
    double s = 2 * t.diagonal[i] + sign * entry_rounding * row;
    if (s < 0 || (sign < 0 && s == 0)) return false;
    if (s == 0) s = 1;
    pivot = 1 + sign * 32 * epsilon - (i > 0 ? off * off / (s * last * pivot) : 0);
    if (!(pivot > 0)) return false;
    last = s;
  }
  return true;
}

bool is_positive_definite(const LcpMatrix& M) {
  return std::visit([](const auto& m) { return definite(m, -1); }, congruent(M));
}

// Principal minors by elimination: m_11 > 0, and recursively M without index 1 and its Schur complement. `error` bounds
// the rounding of each entry (running error analysis), so the result does not depend on the scaling of rows.
struct Minors {
  enum class Wanted { positive_beyond_rounding, positive_as_computed };
  Wanted wanted;
  std::vector<Index> rows{};  ///< of the last minor that was not positive

  bool positive(const Matrix& M, const Matrix& error, std::vector<Index>& eliminated, Index first) {
    const Index n = M.rows() - 1;
    if (n < 0) return true;
    const double pivot = M(0, 0), doubt = wanted == Wanted::positive_beyond_rounding ? error(0, 0) : 0;
    if (!(pivot > doubt)) {
      rows = eliminated;
      rows.push_back(first);
      return false;
    }
    if (!positive(M.bottomRightCorner(n, n), error.bottomRightCorner(n, n), eliminated, first + 1)) return false;
    const Vector column = M.col(0).tail(n) / pivot, column_error = error.col(0).tail(n) / pivot;
    const auto row = M.row(0).tail(n), row_error = error.row(0).tail(n);
    const Matrix product = column * row, size = product.cwiseAbs();
    Matrix next = error.bottomRightCorner(n, n) + column_error * row.cwiseAbs() + column.cwiseAbs() * row_error;
    next += (error(0, 0) / pivot + 3 * epsilon) * size;
    const Matrix complement = M.bottomRightCorner(n, n) - product;
    eliminated.push_back(first);
    const bool all = positive(complement, next, eliminated, first + 1);
    eliminated.pop_back();
    return all;
  }

  bool positive(const Matrix& M) {
    std::vector<Index> none;
    return positive(M, entry_rounding * M.cwiseAbs(), none, 0);
  }
};

constexpr Index largest_exact_P = 16;

std::string entry(Index i, Index j, double value) { return text("M(%td,%td) = %.6g", i, j, value); }

std::optional<std::string> contradicts_P(const LcpMatrix& M) {
  const Vector d = diagonal(M);
  for (Index i = 0; i < d.size(); ++i)
    if (!(d[i] > 0)) return "M has the diagonal entry " + entry(i, i, d[i]) + ", not positive";
  if (size(M) > largest_exact_P || is_surely_P(M)) return std::nullopt;
  Minors minors{Minors::Wanted::positive_as_computed};
  if (minors.positive(to_dense(M))) return std::nullopt;
  std::string rows;
  for (const Index i : minors.rows) rows += (rows.empty() ? "" : ", ") + std::to_string(i);
  return "the principal minor of M with rows " + rows + " is not positive";
}

std::optional<std::string> contradicts_PSD(const LcpMatrix& M) {
  if (is_PSD(M)) return std::nullopt;
  return "the symmetric part of M has a negative eigenvalue";
}

std::optional<std::string> contradicts_Z(const LcpMatrix& M) {
  const auto found = positive_off_diagonal(M);
  if (!found) return std::nullopt;
  return "M has a positive entry off its diagonal, " + entry(found->row, found->column, found->value);
}

bool has_positive_minors(const LcpMatrix& M) { return size(M) <= largest_exact_P && is_P_exact(to_dense(M)); }

/// The tests of one class: whether M certainly belongs to it, and why it certainly does not.
struct ClassTest {
  LcpClass lcp_class;
  bool (*holds)(const LcpMatrix&);
  std::optional<std::string> (*contradiction)(const LcpMatrix&);
};

// `classify` takes the first that holds.
constexpr ClassTest tests_in_order[] = {
    {LcpClass::P, [](const LcpMatrix& M) { return is_surely_P(M) || has_positive_minors(M); }, contradicts_P},
    {LcpClass::PSD, is_PSD, contradicts_PSD},
    {LcpClass::Z, [](const LcpMatrix& M) { return is_Z(M) && (diagonal(M).array() > 0).all(); }, contradicts_Z},
};

}  // namespace

bool is_Z(const LcpMatrix& M) { return !positive_off_diagonal(M); }

bool is_H_plus(const LcpMatrix& M) { return (diagonal(M).array() > 0).all() && Comparison(M).is_M_matrix(); }

bool is_surely_P(const LcpMatrix& M) { return strictly_dominant(M) || is_H_plus(M) || is_positive_definite(M); }

bool is_P_exact(const Matrix& M) { return Minors{Minors::Wanted::positive_beyond_rounding}.positive(M); }

bool is_PSD(const LcpMatrix& M) {
  return std::visit([](const auto& m) { return definite(m, 1); }, congruent(M));
}

LcpClass classify(const LcpMatrix& M) {
  for (const ClassTest& test : tests_in_order)
    if (test.holds(M)) return test.lcp_class;
  return LcpClass::unknown;
}

LcpClass known_class(const LcpMatrix& M, LcpClass stated) { return is_stated(stated) ? stated : classify(M); }

LcpClass selection_class(const LcpMatrix& M, LcpClass stated) {
  const LcpClass c = known_class(M, stated);
  return selects_least_norm(c) && is_Z(M) ? LcpClass::Z : c;
}

std::vector<std::string> lcp_class_names() {
  std::vector<std::string> names;
  for (const LcpClassTraits& t : lcp_class_table)
    if (lcp_class_named(t.name)) names.emplace_back(t.name);
  return names;
}

std::string describe_class(const LcpMatrix& M, LcpClass c) {
  if (c != LcpClass::P) return to_string(c);
  if (strictly_dominant(M)) return "P (strictly diagonally dominant)";
  if (is_H_plus(M)) return "P (H+)";
  if (is_positive_definite(M)) return "P (positive definite)";
  return has_positive_minors(M) ? "P (all principal minors)" : "P (as stated)";
}

std::optional<std::string> contradiction(const LcpMatrix& M, LcpClass stated) {
  for (const ClassTest& test : tests_in_order)
    if (test.lcp_class == stated) return test.contradiction(M);
  return std::nullopt;
}

}  // namespace bromwich
