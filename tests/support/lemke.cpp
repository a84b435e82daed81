#include "tests/support/lemke.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <limits>
#include <utility>

namespace bromwich::oracle {
namespace {

using Real = long double;

constexpr double noise = 1e-10;   ///< of scaled values, which are of size 1: below it a value counts as zero
constexpr Index most_tried = 15;  ///< constraints whose sets are all tried
constexpr Real smallest_pivot = 1e-13L;

std::vector<Index> chosen(const std::vector<char>& basis) {
  std::vector<Index> set;
  for (std::size_t i = 0; i < basis.size(); ++i)
    if (basis[i] != 0) set.push_back(Index(i));
  return set;
}

/// Factors of rows and columns after which their largest entries are 1.
std::pair<Vector, Vector> factors(const Matrix& M) {
  const Index n = M.rows();
  Vector rows = Vector::Ones(n), columns = rows;
  for (int sweep = 0; sweep < 12; ++sweep) {
    const Matrix S = (rows.asDiagonal() * M * columns.asDiagonal()).cwiseAbs();
    for (Index i = 0; i < n; ++i) {
      if (S.row(i).maxCoeff() > 0) rows[i] /= std::sqrt(S.row(i).maxCoeff());
      if (S.col(i).maxCoeff() > 0) columns[i] /= std::sqrt(S.col(i).maxCoeff());
    }
  }
  return {rows, columns};
}

bool solves(const Matrix& M, const Vector& q, const std::vector<char>& basis) {
  const Vector y = basic_solution(M, q, basis);
  if (!y.allFinite()) return false;
  const Vector w = M * y + q, terms = M.cwiseAbs() * y.cwiseAbs() + q.cwiseAbs();
  for (Index i = 0; i < q.size(); ++i) {
    if (y[i] < -noise * std::max(1e-30, y.cwiseAbs().maxCoeff()) || w[i] < -noise * terms[i]) return false;
    if (basis[std::size_t(i)] != 0 && std::abs(w[i]) > 1e-6 * terms[i]) return false;  // the basis is singular
  }
  return true;
}

/// Lemke's pivots with the lexicographic rule against cycles. Columns: w, y, the artificial one; then q and I.
std::optional<std::vector<char>> lemke(const Matrix& M, const Vector& q, const Vector& cover) {
  const Index n = q.size();
  // Degenerate problems cancel: long double keeps apart what is zero and what is not.
  Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic> tableau(n, 3 * n + 2);
  tableau << Matrix::Identity(n, n).cast<Real>(), -M.cast<Real>(), -cover.cast<Real>(), q.cast<Real>(),
      Matrix::Identity(n, n).cast<Real>();
  std::vector<Index> basic(std::size_t(n), 0);
  for (Index i = 0; i < n; ++i) basic[std::size_t(i)] = i;
  std::vector<char> basis(std::size_t(n), 0);
  if (q.minCoeff() >= 0) return basis;
  const auto smaller = [&](Index a, Index b, Index column) {  // row a limits the entering variable before row b
    for (Index k = 2 * n + 1; k < 3 * n + 2; ++k) {
      const Real u = tableau(a, k) / tableau(a, column), v = tableau(b, k) / tableau(b, column);
      if (std::abs(u - v) > 1e-16L * (std::abs(u) + std::abs(v))) return u < v;
    }
    return false;
  };
  const auto pivot = [&](Index row, Index column) {
    tableau.row(row) /= Real(tableau(row, column));
    for (Index i = 0; i < n; ++i)
      if (i != row && tableau(i, column) != 0) tableau.row(i) -= Real(tableau(i, column)) * tableau.row(row);
    return std::exchange(basic[std::size_t(row)], column);
  };
  Index row = 0, leaving = 0;
  for (Index i = 1; i < n; ++i)
    if (q[i] * cover[row] < q[row] * cover[i]) row = i;
  leaving = pivot(row, 2 * n);
  for (int count = 0; count < 200 + 20 * n; ++count) {
    if (leaving == 2 * n) {
      for (const Index b : basic)
        if (b >= n && b < 2 * n) basis[std::size_t(b - n)] = 1;
      return basis;
    }
    const Index column = leaving < n ? leaving + n : leaving - n;
    row = -1;
    for (Index i = 0; i < n; ++i) {
      if (tableau(i, column) < smallest_pivot) continue;
      if (row < 0 || smaller(i, row, column)) row = i;
    }
    if (row < 0) return std::nullopt;
    // The artificial variable leaves where it may.
    for (Index i = 0; i < n; ++i)
      if (basic[std::size_t(i)] == 2 * n && tableau(i, column) >= smallest_pivot &&
          tableau(i, 2 * n + 1) / tableau(i, column) <= tableau(row, 2 * n + 1) / tableau(row, column) + 1e-15L)
        row = i;
    leaving = pivot(row, column);
  }
  return std::nullopt;
}

}  // namespace

Vector basic_solution(const Matrix& M, const Vector& q, const std::vector<char>& basis) {
  const std::vector<Index> set = chosen(basis);
  Vector y = Vector::Zero(q.size());
  if (set.empty()) return y;
  // Rows and columns of short steps differ by the square of the step: unscaled ones would count as dependent.
  const Matrix S = M(set, set);
  const auto [rows, columns] = factors(S);
  const Matrix scaled = rows.asDiagonal() * S * columns.asDiagonal();
  const Vector right = -(rows.asDiagonal() * q(set));
  y(set) = columns.asDiagonal() * Eigen::FullPivLU<Matrix>(scaled).solve(right);
  return y;
}

std::optional<std::vector<char>> complementary_basis(const Matrix& M, const Vector& q, const std::vector<char>& first) {
  if (q.size() == 0) return std::vector<char>();
  const auto [rows, columns] = factors(M);
  const Matrix S = rows.asDiagonal() * M * columns.asDiagonal();
  Vector r = rows.asDiagonal() * q;
  if (r.cwiseAbs().maxCoeff() > 0) r /= double(r.cwiseAbs().maxCoeff());
  if (Index(first.size()) == q.size() && solves(S, r, first)) return first;
  // Rows of short steps differ by many decades: another artificial column takes another way.
  for (const double power : {0.0, 1.0, 0.5, 0.25, 0.75}) {
    const Vector cover = r.cwiseAbs().cwiseMax(1e-30).array().pow(power);
    if (auto basis = lemke(S, r, cover); basis && solves(S, r, *basis)) return basis;
  }
  if (q.size() > most_tried) return std::nullopt;
  // Nearly singular sets solve it too, with large y that rounding allows.
  std::optional<std::vector<char>> best;
  double least = INFINITY;
  for (unsigned set = 0; set < 1u << q.size(); ++set) {
    std::vector<char> basis;
    for (Index i = 0; i < q.size(); ++i) basis.push_back(char(set >> i & 1u));
    if (!solves(S, r, basis)) continue;
    const double size = basic_solution(S, r, basis).cwiseAbs().sum();
    if (size < least) least = size, best = std::move(basis);
  }
  return best;
}

}  // namespace bromwich::oracle
