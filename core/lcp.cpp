#include "core/lcp.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

bool dominant(const Matrix& M) {
  for (Index i = 0; i < M.rows(); ++i)
    if (!(2 * M(i, i) > M.row(i).cwiseAbs().sum())) return false;
  return true;
}

// All principal minors of M positive: M_11 > 0, and the same for M without index 1 and for its Schur complement.
bool minors_positive(const Matrix& M) {
  const Index n = M.rows();
  if (n == 0) return true;
  if (!(M(0, 0) > 0)) return false;
  const Matrix rest = M.bottomRightCorner(n - 1, n - 1);
  return minors_positive(rest) &&
         minors_positive(rest - M.col(0).tail(n - 1) * M.row(0).tail(n - 1) / M(0, 0));
}

// Gaussian elimination without exchanges meets positive pivots only. For a Z-matrix: it is a nonsingular M-matrix.
bool pivots_positive(Matrix M) {
  const Index n = M.rows();
  for (Index k = 0; k < n; ++k) {
    if (!(M(k, k) > 0)) return false;
    const Index rest = n - k - 1;
    M.bottomRightCorner(rest, rest) -= M.col(k).tail(rest) * M.row(k).tail(rest) / M(k, k);
  }
  return true;
}

}  // namespace

bool is_Z(const LcpMatrix& M) {
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    const Index n = t->diagonal.size();
    return n <= 1 || ((t->lower.tail(n - 1).array() <= 0).all() && (t->upper.head(n - 1).array() <= 0).all());
  }
  const Matrix& dense = std::get<Matrix>(M);
  for (Index i = 0; i < dense.rows(); ++i)
    for (Index j = 0; j < dense.cols(); ++j)
      if (i != j && dense(i, j) > 0) return false;
  return true;
}

bool is_surely_P(const LcpMatrix& M) {
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
  const Matrix& dense = std::get<Matrix>(M);
  if (dense.rows() == 0 || dominant(dense) || dominant(dense.transpose())) return true;
  const Matrix symmetric = dense + dense.transpose();
  const Eigen::LLT<Matrix> cholesky(symmetric);
  // A rounding margin: a singular positive semidefinite matrix may pass the factorization by accident.
  return cholesky.info() == Eigen::Success && cholesky.rcond() > 1e3 * epsilon;
}

bool is_P_exact(const Matrix& M) { return minors_positive(M); }

LcpClass classify(const LcpMatrix& M) {
  if (is_surely_P(M)) return LcpClass::P;
  if (size(M) <= 16 && is_P_exact(to_dense(M))) return LcpClass::P;
  return is_Z(M) ? LcpClass::Z : LcpClass::unknown;
}

const char* to_string(LcpClass c) {
  switch (c) {
    case LcpClass::P: return "P";
    case LcpClass::Z: return "Z";
    case LcpClass::PSD: return "PSD";
    case LcpClass::unknown: return "unknown";
    case LcpClass::automatic: break;
  }
  return "auto";
}

ActiveSetLcp::ActiveSetLcp(const Matrix& M, LcpClass lcp_class, const Matrix* least_of)
    : M_(M), P_(M), least_of_(least_of), class_(lcp_class), active_(std::size_t(M.rows()), 0) {
  support_.reserve(active_.size());
  flips_.reserve(active_.size());
  value_.resize(M.rows());
  w_ = Vector::Zero(M.rows());
}

void ActiveSetLcp::reset() {
  std::fill(active_.begin(), active_.end(), 0);
  support_.clear();
  P_ = M_;
  updates_ = 0;
}

// A value counts as negative below this: the product E q - P q_S carries rounding of about n eps |q| times the size of
// P's entries, and a flip at that level would only swap two equally good active sets.
double ActiveSetLcp::tolerance(const Vector& q) const { return 16 * epsilon * q.cwiseAbs().maxCoeff(); }

// value_ = (y_S, w_I) for the current active set.
void ActiveSetLcp::evaluate(const Vector& q) {
  value_ = q;
  for (const Index s : support_) value_[s] = 0;
  for (const Index s : support_) value_.noalias() -= P_.col(s) * q[s];
}

// Exchange index i: the principal pivot on P(i,i).
bool ActiveSetLcp::toggle(Index i) {
  const double pivot = P_(i, i);
  if (!(std::abs(pivot) > 1e-14 * P_.row(i).cwiseAbs().maxCoeff())) return false;
  const Vector column = P_.col(i) / pivot;
  const Eigen::RowVectorXd row = P_.row(i);
  P_.noalias() -= column * row;
  P_.col(i) = column;
  P_.row(i) = -row / pivot;
  P_(i, i) = 1 / pivot;
  active_[std::size_t(i)] ^= 1;
  if (active_[std::size_t(i)])
    support_.push_back(i);
  else
    support_.erase(std::find(support_.begin(), support_.end(), i));
  ++updates_;
  return true;
}

// P(S) from M by one factorization of M_SS.
bool ActiveSetLcp::rebuild() {
  updates_ = 0;
  std::vector<Index> inactive;
  for (Index i = 0; i < M_.rows(); ++i)
    if (!active_[std::size_t(i)]) inactive.push_back(i);
  if (support_.empty()) {
    P_ = M_;
    return true;
  }
  const Eigen::PartialPivLU<Matrix> lu(M_(support_, support_));
  if (!(lu.rcond() > epsilon)) return false;
  const Matrix inverse = lu.inverse(), right = inverse * M_(support_, inactive), below = M_(inactive, support_);
  P_(support_, support_) = inverse;
  P_(support_, inactive) = -right;
  P_(inactive, support_) = below * inverse;
  P_(inactive, inactive) = M_(inactive, inactive) - below * right;
  return true;
}

bool ActiveSetLcp::exchange_until_complementary(const Vector& q, int limit, bool least_index, LcpOutcome& outcome) {
  const double tol = tolerance(q);
  for (int sweep = 0; sweep < limit; ++sweep) {
    ++outcome.newton;
    evaluate(q);
    flips_.clear();
    for (Index i = 0; i < q.size() && !(least_index && !flips_.empty()); ++i)
      if (value_[i] < -tol) flips_.push_back(i);
    if (flips_.empty()) return value_.allFinite();
    // Rank-1 updates drift: after enough of them, or where many indices change, start again from M.
    const bool many = Index(flips_.size()) > q.size() / 8 + 4 || updates_ > 64;
    bool good = true;
    if (many) {
      for (const Index i : flips_) active_[std::size_t(i)] ^= 1;
      support_.clear();
      for (Index i = 0; i < q.size(); ++i)
        if (active_[std::size_t(i)]) support_.push_back(i);
      good = rebuild();
    } else {
      for (const Index i : flips_) good = good && toggle(i);
    }
    if (!good) return false;
  }
  return false;
}

bool ActiveSetLcp::least_element(const Vector& q, LcpOutcome& outcome) {
  reset();
  const double tol = tolerance(q);
  for (Index block = 0; block <= q.size(); ++block) {
    ++outcome.newton;
    evaluate(q);
    flips_.clear();
    for (Index i = 0; i < q.size(); ++i)
      if (!active_[std::size_t(i)] && value_[i] < -tol) flips_.push_back(i);
    if (flips_.empty()) return value_.allFinite();
    for (const Index i : flips_) {
      // For a Z-matrix the pivots met on the way are those of M_SS: one that is not positive has no positive solution.
      if (!(P_(i, i) > 0) || !toggle(i)) {
        outcome.infeasible = class_ == LcpClass::Z;
        return false;
      }
    }
  }
  return false;
}

bool ActiveSetLcp::active_set_is_least() const {
  if (least_of_ == nullptr && class_ != LcpClass::Z) return true;
  const Matrix& Z = least_of_ ? *least_of_ : M_;
  return pivots_positive(Z(support_, support_));
}

void ActiveSetLcp::accept(const Vector& q, Vector& y) {
  y.setZero(q.size());
  w_ = value_;
  for (const Index s : support_) {
    y[s] = std::max(value_[s], 0.0);
    w_[s] = 0;
  }
}

LcpOutcome ActiveSetLcp::solve(const Vector& q, Vector& y) {
  LcpOutcome outcome;
  if (!q.allFinite()) return outcome;
  const int cap = 12 + int(std::min<Index>(q.size(), 40));
  outcome.solved = exchange_until_complementary(q, cap, false, outcome) && active_set_is_least();
  if (!outcome.solved) {
    outcome.fallback = true;
    if (class_ == LcpClass::Z) {
      outcome.solved = least_element(q, outcome);
    } else {
      reset();
      outcome.solved = exchange_until_complementary(q, cap, false, outcome) && active_set_is_least();
      if (!outcome.solved && class_ == LcpClass::P) {
        reset();
        const int least_index_cap = q.size() < 16 ? 1 << q.size() : 100000;
        outcome.solved = exchange_until_complementary(q, least_index_cap, true, outcome);
      }
    }
  }
  accept(q, y);
  return outcome;
}

}  // namespace bromwich
