#include "core/lcp.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace bromwich {

namespace {

bool dominant(const Matrix& M) {
  for (Index i = 0; i < M.rows(); ++i)
    if (!(2 * M(i, i) > M.row(i).cwiseAbs().sum())) return false;
  return true;
}

// All principal minors of M positive: M_11 > 0, and the same for M without index 1 and for its Schur complement. A
// pivot at the level of rounding counts as zero.
bool minors_positive(const Matrix& M, double rounding) {
  const Index n = M.rows();
  if (n == 0) return true;
  if (!(M(0, 0) > rounding)) return false;
  const Matrix rest = M.bottomRightCorner(n - 1, n - 1);
  return minors_positive(rest, rounding) &&
         minors_positive(rest - M.col(0).tail(n - 1) * M.row(0).tail(n - 1) / M(0, 0), rounding);
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

// Exchanges before the transform is formed anew: its rounding errors grow with their number.
constexpr int most_updates = 100;

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

bool is_P_exact(const Matrix& M) {
  return minors_positive(M, M.size() > 0 ? 16 * epsilon * M.cwiseAbs().maxCoeff() : 0);
}

LcpClass classify(const LcpMatrix& M) {
  if (is_surely_P(M)) return LcpClass::P;
  if (size(M) <= 16 && is_P_exact(to_dense(M))) return LcpClass::P;
  // With a zero on the diagonal (M = 0 in the extreme) the least element of the static problem is not what is meant:
  // the constraint then acts through N x, and only the user can say Z.
  const bool positive = std::visit(
      [](const auto& m) {
        if constexpr (std::is_same_v<std::decay_t<decltype(m)>, Matrix>)
          return (m.diagonal().array() > 0).all();
        else
          return (m.diagonal.array() > 0).all();
      },
      M);
  return positive && is_Z(M) ? LcpClass::Z : LcpClass::unknown;
}

const char* to_string(LcpClass c) {
  switch (c) {
    case LcpClass::P:
      return "P";
    case LcpClass::Z:
      return "Z";
    case LcpClass::PSD:
      return "PSD";
    case LcpClass::unknown:
      return "unknown";
    case LcpClass::automatic:
      break;
  }
  return "auto";
}

ActiveSetLcp::ActiveSetLcp(const Matrix& M, LcpClass lcp_class, const Matrix* least_of)
    : M_(M), P_(M), least_of_(least_of), class_(lcp_class), active_(std::size_t(M.rows()), 0), value_(M.rows()) {
  for (std::vector<Index>* v : {&support_, &rest_, &flips_}) v->reserve(active_.size());
  w_ = Vector::Zero(M.rows());
  reset();
}

void ActiveSetLcp::reset() {
  std::fill(active_.begin(), active_.end(), 0);
  flips_.clear();
  flip_active_set();
  P_ = M_;
  transform_ = true;
  updates_ = 0;
}

void ActiveSetLcp::start_from(const Vector& y) {
  flips_.clear();
  for (Index i = 0; i < y.size(); ++i)
    if ((y[i] > 0) != (active_[std::size_t(i)] != 0)) flips_.push_back(i);
  if (!flips_.empty() && !exchange_flips()) reset();
}

// A value counts as negative below this: the product E q - P q_S carries rounding of about n eps |q| times the size of
// P's entries, and a flip at that level would only swap two equally good active sets.
double ActiveSetLcp::tolerance(const Vector& q) const { return 16 * epsilon * q.cwiseAbs().maxCoeff(); }

// value_ = (y_S, w_I) for the current active set.
void ActiveSetLcp::evaluate(const Vector& q) {
  value_ = q;
  if (transform_) {
    for (const Index s : support_) value_[s] = 0;
    for (const Index s : support_) value_.noalias() -= P_.col(s) * q[s];
    return;
  }
  const Vector y = -lu_.solve(q(support_));
  for (std::size_t k = 0; k < support_.size(); ++k) value_.noalias() += M_.col(support_[k]) * y[Index(k)];
  value_(support_) = y;
}

// Exchanges the indices in flips_ and sorts all indices into support_ (active) and rest_.
void ActiveSetLcp::flip_active_set() {
  for (const Index i : flips_) active_[std::size_t(i)] ^= 1;
  support_.clear();
  rest_.clear();
  for (Index i = 0; i < M_.rows(); ++i) (active_[std::size_t(i)] ? support_ : rest_).push_back(i);
}

// The principal pivot on the block F = flips_: P_FF inverted, P_RF P_FF^{-1}, -P_FF^{-1} P_FR and the Schur complement.
bool ActiveSetLcp::pivot_on_flips() {
  const Eigen::PartialPivLU<Matrix> block(P_(flips_, flips_));
  if (!(block.rcond() > 1e-13)) return false;
  const Matrix inverse = block.inverse(), rows = P_(flips_, Eigen::all), columns = P_(Eigen::all, flips_) * inverse;
  P_.noalias() -= columns * rows;
  P_(Eigen::all, flips_) = columns;
  P_(flips_, Eigen::all) = -inverse * rows;
  P_(flips_, flips_) = inverse;
  ++updates_;
  flip_active_set();
  return true;
}

// M_SS = LU for the current active set.
bool ActiveSetLcp::factorize() {
  transform_ = false;
  updates_ = 0;
  if (support_.empty()) {
    P_ = M_;
    transform_ = true;
    return true;
  }
  lu_.compute(M_(support_, support_));
  return lu_.rcond() > epsilon;
}

// P(S) from the factorization.
bool ActiveSetLcp::form_transform() {
  const Matrix inverse = lu_.inverse(), right = inverse * M_(support_, rest_), below = M_(rest_, support_);
  P_(support_, support_) = inverse;
  P_(support_, rest_) = -right;
  P_(rest_, support_) = below * inverse;
  P_(rest_, rest_) = M_(rest_, rest_) - below * right;
  transform_ = true;
  updates_ = 0;
  return P_.allFinite();
}

// Updates drift: after many of them, or where many indices change, start again from M.
bool ActiveSetLcp::exchange_flips() {
  if (flips_.size() <= 4 + std::size_t(M_.rows()) / 8 && updates_ <= most_updates) {
    if (!transform_ && !form_transform()) return false;
    if (pivot_on_flips()) return true;
  }
  flip_active_set();
  return factorize();
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
    if (!exchange_flips()) return false;
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
    if (flips_.empty()) return value_.allFinite() && (value_.array() >= -tol).all();
    // For a Z-matrix the pivots met on the way are those of M_SS: one that is not positive has no positive solution.
    const std::vector<Index> added = flips_;
    for (const Index i : added) {
      flips_.assign(1, i);
      if (!(P_(i, i) > 0) || !pivot_on_flips()) {
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
        outcome.solved = exchange_until_complementary(q, least_index_cap, true, outcome) && active_set_is_least();
      }
    }
  }
  accept(q, y);
  return outcome;
}

}  // namespace bromwich
