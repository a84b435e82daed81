#include "complementarity/checked_lcp.hpp"

#include "core/lcp/sparse_lcp.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// Sizes up to which other matrices than dense ones are written out for a single solve, and infeasibility is proven by a
// monotone problem of twice the size.
constexpr Index largest_written_out = 2048, largest_proof = 128;

SparseMatrix entries_of(const LcpMatrix& M) {
  if (const SparseMatrix* sparse = sparse_of(M)) return *sparse;
  const auto& t = std::get<Tridiagonal>(M);
  std::vector<Eigen::Triplet<double>> entries;
  each_entry(t, [&](Index i, Index j, double value) { entries.emplace_back(int(i), int(j), value); });
  SparseMatrix all(t.diagonal.size(), t.diagonal.size());
  all.setFromTriplets(entries.begin(), entries.end());
  return all;
}

}  // namespace

LcpClass quick_class(const Matrix& M) {
  if (M.rows() <= 8) return classify(M);
  if (is_surely_P(M)) return LcpClass::P;
  if (is_PSD(M)) return LcpClass::PSD;
  return is_Z(M) && M.diagonal().minCoeff() > 0 ? LcpClass::Z : LcpClass::unknown;
}

CheckedLcp::CheckedLcp(const LcpMatrix& M, LcpClass lcp_class) : scale_(equilibrate(M)), class_(lcp_class), given_(M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) {
    original_ = *dense;
    dense_ = scaled(*dense, scale_);
  } else {
    sparse_ = scale_.rows.asDiagonal() * entries_of(M) * scale_.columns.asDiagonal();
  }
}

CheckedLcp::Verdict CheckedLcp::judge(const Vector& q, const Vector& y, Vector& w, SlackTerms& scratch) const {
  const Vector scaled_q = scale_.rows.cwiseProduct(q), scaled_y = y.cwiseQuotient(scale_.columns);
  // Precondition: y is not empty.
  if (sparse_) {
    scratch.w = *sparse_ * scaled_y + scaled_q;
    scratch.terms = sparse_->cwiseAbs() * scaled_y + scaled_q.cwiseAbs();
  } else {
    scratch.evaluate(dense_, scaled_q, scaled_y);
  }
  Verdict verdict;
  verdict.solution = y.allFinite() && y.minCoeff() >= 0 && is_solution(scratch, scaled_q, scaled_y);
  w = scratch.w.cwiseQuotient(scale_.rows);
  verdict.margin = INFINITY;
  for (Index i = 0; i < y.size(); ++i) {
    const double size = std::max(scratch.terms[i], scaled_y[i]);
    const double apart = std::max(scaled_y[i], scratch.w[i]), miss = std::abs(std::min(scaled_y[i], scratch.w[i]));
    if (scratch.terms[i] > 0) verdict.residual = std::max(verdict.residual, miss / scratch.terms[i]);
    verdict.margin = std::min(verdict.margin, size > 0 ? apart / size : 0);
    if (y[i] > 0) w[i] = 0;
  }
  return verdict;
}

LcpStatus CheckedLcp::solve(const Vector& q, const Vector& start, Vector& y, Index& iterations) {
  if (!q.allFinite()) return LcpStatus::nonfinite;
  if (!solver_) {
    if (original_.size() == 0 && size() > largest_written_out) return LcpStatus::unsolved;
    if (original_.size() == 0) original_ = to_dense(given_);
    solver_.emplace(original_, class_);
  }
  if (start.size() > 0)
    solver_->start_from(start);
  else
    solver_->reset();
  const LcpOutcome outcome = solver_->solve(q, y);
  iterations += outcome.newton;
  return outcome.solved ? LcpStatus::solved : without_solution(outcome, q);
}

LcpStatus CheckedLcp::without_solution(const LcpOutcome& outcome, const Vector& q) const {
  if (outcome.infeasible || outcome.exhausted) return LcpStatus::infeasible;
  const bool none = size() <= largest_proof && has_no_feasible_point(original_, q);
  return none ? LcpStatus::infeasible : LcpStatus::unsolved;
}

}  // namespace bromwich
