#include "core/lcp/solution.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

// A number above this level, relative to its terms, is clearly not rounding.
constexpr double clear = 1e-10;

double rounding(Index n) { return 16 * double(n + 4) * epsilon; }

}  // namespace

Tridiagonal plus_identity(Tridiagonal M, double D) {
  M.diagonal.array() += D;
  return M;
}

Equilibration equilibrate(const Tridiagonal& t) {
  const Index n = t.diagonal.size();
  return equilibrate(n, n, [&](const Equilibration& e, Vector& rows, Vector& columns) {
    rows = columns = Vector::Zero(n);
    each_entry(t, [&](Index i, Index j, double value) {
      const double entry = e.rows[i] * std::abs(value) * e.columns[j];
      rows[i] = std::max(rows[i], entry);
      columns[j] = std::max(columns[j], entry);
    });
  });
}

Equilibration equilibrate(const SparseMatrix& M) {
  return equilibrate(M.rows(), M.cols(), [&](const Equilibration& e, Vector& rows, Vector& columns) {
    rows = Vector::Zero(M.rows());
    columns = Vector::Zero(M.cols());
    for (Index j = 0; j < M.outerSize(); ++j)
      for (SparseMatrix::InnerIterator a(M, j); a; ++a) {
        const double entry = e.rows[a.row()] * std::abs(a.value()) * e.columns[j];
        rows[a.row()] = std::max(rows[a.row()], entry);
        columns[j] = std::max(columns[j], entry);
      }
  });
}

Equilibration equilibrate(const SparseLcpMatrix& M) { return equilibrate(*M.entries); }

Equilibration equilibrate(const LcpMatrix& M) {
  return std::visit([](const auto& given) { return equilibrate(given); }, M);
}

Tridiagonal scaled(const Tridiagonal& given, const Equilibration& e) {
  Tridiagonal t = given;
  each_entry(t, [&e](Index i, Index j, double& entry) { entry *= e.rows[i] * e.columns[j]; });
  return t;
}

SparseLcpMatrix scaled(const SparseLcpMatrix& given, const Equilibration& e) {
  return SparseLcpMatrix(e.rows.asDiagonal() * *given.entries * e.columns.asDiagonal());
}

LcpMatrix scaled(const LcpMatrix& M, const Equilibration& e) {
  return std::visit([&e](const auto& given) { return LcpMatrix(scaled(given, e)); }, M);
}

std::vector<Index> support_of(const Eigen::Ref<const Vector>& y) {
  std::vector<Index> S;
  for (Index i = 0; i < y.size(); ++i)
    if (y[i] > 0) S.push_back(i);
  return S;
}

std::vector<Index> members(unsigned set, Index n) {
  std::vector<Index> S;
  for (Index i = 0; i < n; ++i)
    if (set >> i & 1u) S.push_back(i);
  return S;
}

void SlackTerms::evaluate(const Matrix& M, const Vector& q, const Vector& y) {
  w = q;
  terms = q.cwiseAbs();
  for (Index j = 0; j < y.size(); ++j) {
    if (!(y[j] > 0)) continue;
    w += y[j] * M.col(j);
    terms += y[j] * M.col(j).cwiseAbs();
  }
}

bool is_solution(const Matrix& M, const Vector& q, const Vector& y) {
  if (!y.allFinite() || (y.array() < 0).any()) return false;
  SlackTerms slack;
  slack.evaluate(M, q, y);
  return is_solution(slack, q, y);
}

bool is_solution(const SlackTerms& slack, const Vector& q, const Vector& y) {
  if (!y.allFinite()) return false;
  const double largest = q.size() > 0 ? q.cwiseAbs().maxCoeff() : 0;
  for (Index i = 0; i < y.size(); ++i) {
    const double w = slack.w[i], level = rounding(y.size()) * (slack.terms[i] + largest);
    if (!(y[i] > 0) && w > level) continue;  // positive for any rounding
    if (level > 1e-4 * largest) return false;
    if (w < -level || (y[i] > 0 && w > level)) return false;
  }
  return true;
}

bool is_certainly_unique(const Matrix& M, const Vector& q, const Vector& y) {
  SlackTerms slack;
  slack.evaluate(M, q, y);
  return is_clear_of_rounding(M, slack, y) && is_well_conditioned(M, support_of(y));
}

bool is_clear_of_rounding(const Matrix& M, const SlackTerms& slack, const Vector& y) {
  for (Index i = 0; i < y.size(); ++i) {
    const double level = clear * slack.terms[i];
    if (y[i] > 0 ? !((M.col(i).cwiseAbs().array() * y[i] > clear * slack.terms.array()).any()) : !(slack.w[i] > level))
      return false;
  }
  return true;
}

bool is_well_conditioned(const Matrix& M, const std::vector<Index>& S) {
  if (S.empty()) return true;
  const Matrix block = M(S, S);
  const Eigen::PartialPivLU<Matrix> lu(scaled(block, equilibrate(block)));
  return reciprocal_condition(lu) > clear;
}

bool is_certainly_unique(const Tridiagonal& M, const Vector& q, const Vector& y) {
  const Index n = y.size();
  double c = 0;  // eliminated superdiagonal of the previous row, if that is active
  for (Index i = 0; i < n; ++i) {
    const double lower = i > 0 ? M.lower[i] : 0, upper = i + 1 < n ? M.upper[i] : 0;
    const double left = i > 0 ? lower * y[i - 1] : 0, right = i + 1 < n ? upper * y[i + 1] : 0;
    const double own = M.diagonal[i] * y[i];
    const double terms = std::abs(q[i]) + std::abs(left) + std::abs(own) + std::abs(right);
    if (!(y[i] > 0)) {
      if (!(q[i] + left + right > clear * terms)) return false;
      c = 0;
      continue;
    }
    const double pivot = M.diagonal[i] - lower * c;
    if (!(pivot > clear * (std::abs(lower) + M.diagonal[i] + std::abs(upper)))) return false;
    if (!(own > clear * terms)) return false;
    c = upper / pivot;
  }
  return true;
}

}  // namespace bromwich
