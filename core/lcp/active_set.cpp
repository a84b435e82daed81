#include "core/lcp/active_set.hpp"

#include "core/lcp/enumeration.hpp"
#include "core/lcp/least_norm.hpp"
#include "core/lcp/lemke.hpp"
#include "core/lcp/pivots.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// For a larger ratio of row to pivot the update would lose six digits: M_SS is factorized instead.
constexpr double safe_growth = 1e6;

// Solutions are refined if entries of P(S) exceed this, or did since P(S) was computed from M; those of M are about 1.
// Below, an exchange there and one back leave errors of eps times the square.
constexpr double safe_inverse = 1e2;

// Exchanges before the transform is computed again: its rounding errors grow with their number.
constexpr int most_updates = 100;

// A transform with larger entries is not carried on to the next set: that is computed from M.
constexpr double carried_on = 1e3;

// The hash of a set is the sum of the hashes of its members (the finalizer of splitmix64).
std::uint64_t hash(Index i) {
  std::uint64_t z = (std::uint64_t(i) + 1) * 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

// If another matrix selects the solution, there is no solution of least norm to prefer.
LcpClass class_to_solve(const Matrix& M, LcpClass stated, bool judged) {
  const LcpClass c = selection_class(M, stated);
  return selects_least_norm(c) && judged ? LcpClass::unknown : c;
}

}  // namespace

ActiveSetLcp::ActiveSetLcp(const Matrix& M, LcpClass lcp_class, const Matrix* least_of)
    : scale_(equilibrate(M)),
      M_(scaled(M, scale_)),
      P_(M_),
      least_of_(least_of),
      class_(class_to_solve(M, lcp_class, least_of != nullptr)),
      active_(std::size_t(M.rows()), 0),
      value_(M.rows()) {
  if (selects_least_norm(class_)) original_ = M;
  for (std::vector<Index>* v : {&support_, &rest_, &flips_}) v->reserve(active_.size());
  w_ = Vector::Zero(M.rows());
  reset();
}

void ActiveSetLcp::reset() {
  std::fill(active_.begin(), active_.end(), 0);
  flips_.clear();
  flip_active_set();
  P_ = M_;
  amplifies_ = false;
  transform_ = regular_ = true;
  updates_ = 0;
}

void ActiveSetLcp::start_from(const Vector& y) {
  flips_.clear();
  for (Index i = 0; i < y.size(); ++i)
    if ((y[i] > 0) != (active_[std::size_t(i)] != 0)) flips_.push_back(i);
  if (!flips_.empty() && !exchange_flips()) reset();
}

// A value counts as negative only beyond the rounding of its terms and of the largest q: an exchange at that level
// would swap two equally good active sets. The sum of the terms is formed only for the few values that need it.
bool ActiveSetLcp::negative(Index i) const {
  if (!(value_[i] < -rounding_)) return false;
  const bool inactive = !active_[std::size_t(i)];
  double terms = inactive ? std::abs(q_[i]) : 0;
  if (transform_) {
    for (const Index s : support_) terms += std::abs(P_(i, s) * q_[s]);
  } else {
    for (const Index s : support_)
      terms = inactive ? terms + std::abs(M_(i, s) * value_[s]) : std::max(terms, std::abs(value_[s]));
  }
  return value_[i] < -16 * epsilon * terms;
}

// value_ = (y_S, w_I) for the current active set.
void ActiveSetLcp::evaluate() {
  value_ = q_;
  if (transform_) {
    for (const Index s : support_) value_[s] = 0;
    for (const Index s : support_) value_.noalias() -= P_.col(s) * q_[s];
    if (amplifies_) refine();
    return;
  }
  const Vector y = -lu_.solve(q_(support_));
  for (std::size_t k = 0; k < support_.size(); ++k) value_.noalias() += M_.col(support_[k]) * y[Index(k)];
  value_(support_) = y;
}

// One step of iterative refinement: the residual of a product with an inverse grows with the condition of M_SS.
void ActiveSetLcp::refine() {
  Vector y = value_(support_), defect = q_(support_);
  for (std::size_t k = 0; k < support_.size(); ++k)
    for (std::size_t i = 0; i < support_.size(); ++i) defect[Index(i)] += M_(support_[i], support_[k]) * y[Index(k)];
  for (std::size_t k = 0; k < support_.size(); ++k)
    for (std::size_t i = 0; i < support_.size(); ++i) y[Index(i)] -= P_(support_[i], support_[k]) * defect[Index(k)];
  value_ = q_;
  for (std::size_t k = 0; k < support_.size(); ++k) value_.noalias() += M_.col(support_[k]) * y[Index(k)];
  value_(support_) = y;
}

// Whether the transform belongs to an ill-conditioned M_SS, or was made from one that did.
void ActiveSetLcp::look_at_transform() {
  const double largest = P_.size() > 0 ? P_.cwiseAbs().maxCoeff() : 0;
  amplifies_ = (updates_ > 0 && amplifies_) || largest > safe_inverse;
  if (largest > carried_on) updates_ = most_updates + 1;
}

// Exchanges the indices in flips_ and sorts all indices into support_ (active) and rest_.
void ActiveSetLcp::flip_active_set() {
  for (const Index i : flips_) active_[std::size_t(i)] ^= 1;
  support_.clear();
  rest_.clear();
  for (Index i = 0; i < M_.rows(); ++i) (active_[std::size_t(i)] ? support_ : rest_).push_back(i);
}

// The principal pivot on the block F = flips_: P_FF inverted, P_RF P_FF^{-1}, -P_FF^{-1} P_FR and the Schur complement.
bool ActiveSetLcp::pivot_on_flips(double most_growth) {
  const Eigen::PartialPivLU<Matrix> block(P_(flips_, flips_));
  if (!(reciprocal_condition(block) > 1e-13)) return false;
  const Matrix inverse = block.inverse(), rows = P_(flips_, Eigen::all), columns = P_(Eigen::all, flips_) * inverse;
  if (inverse.cwiseAbs().maxCoeff() * rows.cwiseAbs().maxCoeff() > most_growth) return false;
  P_.noalias() -= columns * rows;
  P_(Eigen::all, flips_) = columns;
  P_(flips_, Eigen::all) = -inverse * rows;
  P_(flips_, flips_) = inverse;
  ++updates_;
  look_at_transform();
  flip_active_set();
  return true;
}

// M_SS = LU for the current active set.
bool ActiveSetLcp::factorize() {
  transform_ = false;
  updates_ = 0;
  regular_ = true;
  if (support_.empty()) {
    P_ = M_;
    amplifies_ = false;
    transform_ = true;
    return true;
  }
  lu_.compute(M_(support_, support_));
  regular_ = reciprocal_condition(lu_) > epsilon;
  return regular_;
}

// P(S) from the factorization.
bool ActiveSetLcp::form_transform() {
  if (!regular_) return false;
  const Matrix inverse = lu_.inverse(), right = inverse * M_(support_, rest_), below = M_(rest_, support_);
  P_(support_, support_) = inverse;
  P_(support_, rest_) = -right;
  P_(rest_, support_) = below * inverse;
  P_(rest_, rest_) = M_(rest_, rest_) - below * right;
  transform_ = true;
  updates_ = 0;
  look_at_transform();
  return P_.allFinite();
}

// After many updates (rounding accumulates), or if many indices change, the transform is computed from M. The same if
// the previous set has no transform because its M_SS is singular; the next one may be regular.
bool ActiveSetLcp::exchange_flips() {
  if (flips_.size() <= 4 + std::size_t(M_.rows()) / 8 && (transform_ || form_transform()) && updates_ <= most_updates &&
      pivot_on_flips(safe_growth))
    return true;
  flip_active_set();
  return factorize();
}

// Exchanges all indices with the wrong sign until there are none. A repeated set means a cycle.
bool ActiveSetLcp::newton(LcpOutcome& outcome) {
  visited_.clear();
  std::uint64_t set = 0;
  for (const Index s : support_) set += hash(s);
  const int cap = 12 + int(std::min<Index>(q_.size(), 40));
  for (int sweep = 0; sweep < cap; ++sweep) {
    ++outcome.newton;
    evaluate();
    flips_.clear();
    for (Index i = 0; i < q_.size(); ++i)
      if (negative(i)) flips_.push_back(i);
    if (flips_.empty()) return value_.allFinite() && may_be_taken(support_);
    visited_.push_back(set);
    for (const Index i : flips_) set += active_[std::size_t(i)] ? -hash(i) : hash(i);
    if (std::find(visited_.begin(), visited_.end(), set) != visited_.end()) return false;
    if (!exchange_flips()) return false;
  }
  return false;
}

// Murty's rule: exchanges only the first index with the wrong sign. For a P-matrix it ends after at most 2^n exchanges.
bool ActiveSetLcp::least_index(LcpOutcome& outcome) {
  reset();
  const int cap = q_.size() < 16 ? 1 << q_.size() : 100 * int(q_.size());
  for (int exchange = 0; exchange < cap; ++exchange) {
    ++outcome.newton;
    evaluate();
    Index i = 0;
    while (i < q_.size() && !negative(i)) ++i;
    if (i == q_.size()) return value_.allFinite() && may_be_taken(support_);
    flips_.assign(1, i);
    if (!exchange_flips()) return false;
  }
  return false;
}

bool ActiveSetLcp::least_element(LcpOutcome& outcome) {
  reset();
  for (Index block = 0; block <= q_.size(); ++block) {
    ++outcome.newton;
    evaluate();
    flips_.clear();
    for (Index i = 0; i < q_.size(); ++i)
      if (!active_[std::size_t(i)] && negative(i)) flips_.push_back(i);
    if (flips_.empty()) {
      for (Index i = 0; i < q_.size(); ++i)
        if (negative(i)) return false;
      return value_.allFinite() && may_be_taken(support_);
    }
    // For a Z-matrix these pivots are those of M_SS and do not exceed the diagonal entry. If one is not positive beyond
    // rounding, there is no positive solution.
    const std::vector<Index> added = flips_;
    for (const Index i : added) {
      flips_.assign(1, i);
      if (!(P_(i, i) > 16 * double(q_.size()) * epsilon * std::abs(M_(i, i))) || !pivot_on_flips()) {
        outcome.infeasible = selects_least(class_);
        return false;
      }
    }
  }
  return false;
}

// A solution found without the active set, in scaled units.
bool ActiveSetLcp::take(const Vector& y) {
  if (!is_solution(M_, q_, y) || !may_be_taken(support_of(y))) return false;
  start_from(y);  // if M_SS is singular the next problem starts from the empty set
  taken_ = y;
  return true;
}

bool ActiveSetLcp::least_norm(const Vector& q, LcpOutcome& outcome) {
  const LeastNorm found = bromwich::least_norm_solution(original_, q);
  outcome.newton += found.problems;
  outcome.infeasible = found.infeasible;
  return found.solved && take(found.y.cwiseQuotient(scale_.columns));
}

bool ActiveSetLcp::lemke(LcpOutcome& outcome) {
  const LemkeOutcome found = bromwich::lemke(M_, q_);
  outcome.newton += found.pivots;
  return found.solved && take(found.y);
}

bool ActiveSetLcp::enumerate(LcpOutcome& outcome) {
  if (q_.size() > largest_enumeration) return false;
  const auto y = solve_by_enumeration(M_, q_, [this](const std::vector<Index>& S) { return may_be_taken(S); });
  outcome.newton += 1 << q_.size();
  outcome.exhausted = !y;
  return y && take(*y);
}

// For Z, and if another matrix selects the solution: the active set is that of a least element.
bool ActiveSetLcp::may_be_taken(const std::vector<Index>& S) const {
  if (least_of_ == nullptr && !selects_least(class_)) return true;
  return has_positive_pivots((least_of_ ? *least_of_ : M_)(S, S));
}

// If M_SS is not nearly singular, Newton's method ended at a solution; for P- and Z-matrices this holds. Otherwise the
// residual decides. A monotone problem may have other solutions of smaller norm.
bool ActiveSetLcp::is_confirmed() {
  if (is_continuous(class_)) return true;
  positive_.setZero(q_.size());
  positive_set_.clear();
  for (const Index s : support_) {
    if (!(value_[s] > 0)) continue;
    positive_[s] = value_[s];
    positive_set_.push_back(s);
  }
  slack_terms_.evaluate(M_, q_, positive_);
  if (!is_solution(slack_terms_, q_, positive_)) return false;
  return !selects_least_norm(class_) ||
         (is_clear_of_rounding(M_, slack_terms_, positive_) && is_unique_on(positive_set_));
}

// Whether M_SS is well conditioned. It does not depend on q: a set that comes back is not factorized again.
bool ActiveSetLcp::is_unique_on(const std::vector<Index>& S) {
  auto known = std::find_if(judged_.begin(), judged_.end(), [&](const JudgedSet& set) { return set.S == S; });
  if (known == judged_.end()) {
    if (judged_.size() >= most_judged_) judged_.pop_back();
    known = judged_.insert(judged_.end(), {S, is_well_conditioned(M_, S)});
  }
  std::rotate(judged_.begin(), known, known + 1);
  return judged_.front().well_conditioned;
}

// The fallbacks if Newton's method found no acceptable solution.
bool ActiveSetLcp::fall_back(const Vector& q, LcpOutcome& outcome) {
  outcome.fallback = true;
  if (selects_least_norm(class_)) return least_norm(q, outcome) || (!outcome.infeasible && lemke(outcome));
  if (selects_least(class_)) return least_element(outcome) || (!outcome.infeasible && enumerate(outcome));
  reset();
  if (newton(outcome) && is_confirmed()) return true;
  if (has_one_solution(class_) && least_index(outcome)) return true;
  return lemke(outcome) || enumerate(outcome);
}

void ActiveSetLcp::accept(Vector& y) {
  y.setZero(q_.size());
  if (taken_.size() > 0) {
    y = scale_.columns.cwiseProduct(taken_);
    w_ = (M_ * taken_ + q_).cwiseQuotient(scale_.rows);
    for (Index i = 0; i < y.size(); ++i)
      if (y[i] > 0) w_[i] = 0;
    return;
  }
  w_ = value_.cwiseQuotient(scale_.rows);
  for (const Index s : support_) {
    y[s] = scale_.columns[s] * std::max(value_[s], 0.0);
    w_[s] = 0;
  }
}

LcpOutcome ActiveSetLcp::solve(const Vector& q, Vector& y) {
  LcpOutcome outcome;
  if (!q.allFinite()) return outcome;
  q_ = scale_.rows.cwiseProduct(q);
  rounding_ = 16 * epsilon * (q.size() > 0 ? q_.cwiseAbs().maxCoeff() : 0);
  taken_.resize(0);
  outcome.solved = (newton(outcome) && is_confirmed()) || fall_back(q, outcome);
  accept(y);
  return outcome;
}

bool has_no_feasible_point(const Matrix& M, const Vector& q) {
  const Index n = q.size();
  Matrix K = Matrix::Zero(2 * n, 2 * n);
  K.topRightCorner(n, n) = -M.transpose();
  K.bottomLeftCorner(n, n) = M;
  Vector r = Vector::Zero(2 * n);
  r.tail(n) = q;
  return least_norm_solution(K, r).infeasible;
}

LeastNorm least_norm_solution(const Matrix& M, const Vector& q) {
  return least_norm_solution(M, q, [](const Matrix& P, const Vector& given, Vector& y) {
    const LcpOutcome outcome = ActiveSetLcp(P, LcpClass::P).solve(given, y);
    return std::pair(outcome.solved, outcome.newton);
  });
}

}  // namespace bromwich
