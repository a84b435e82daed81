// symbol  meaning
// B       basis, n columns of (I, -M, -d); variables 0..n-1 are w, n..2n-1 are y, 2n is y_0
// T       B^{-1} (q, I): the lexicographic order compares rows divided by their entry of the entering column

#include "core/lcp/lemke.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

template <class Scalar>
class Tableau {
 public:
  using ScalarMatrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  using ScalarVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;

  Tableau(const Matrix& M, const Vector& q, const ScalarVector& d)
      : M_(M.cast<Scalar>()), d_(d), n_(q.size()), T_(n_, n_ + 1), basis_(std::size_t(n_)) {
    T_.col(0) = q.cast<Scalar>();
    T_.rightCols(n_).setIdentity();
    for (Index i = 0; i < n_; ++i) basis_[std::size_t(i)] = i;
  }

  ScalarVector column(Index variable) const {
    const auto inverse = T_.rightCols(n_);
    if (variable < n_) return inverse.col(variable);
    return variable < 2 * n_ ? ScalarVector(-inverse * M_.col(variable - n_)) : ScalarVector(-inverse * d_);
  }

  /// The row that leaves: lexicographically least T_i / by_i over by_i > least; y_0 if it ties in the first entry. -1
  /// if there is none.
  Index leaving(const ScalarVector& by, Scalar least) const {
    Index best = -1;
    for (Index i = 0; i < n_; ++i)
      if (by[i] > least && (best < 0 || before(i, best, by))) best = i;
    if (best < 0) return best;
    for (Index i = 0; i < n_; ++i)
      if (basis_[std::size_t(i)] == 2 * n_ && by[i] > least && compare(T_(i, 0) / by[i], T_(best, 0) / by[best]) <= 0)
        return i;
    return best;
  }

  /// The variable that leaves.
  Index pivot(Index row, Index entering, const ScalarVector& column) {
    T_.row(row) /= column[row];
    for (Index i = 0; i < n_; ++i)
      if (i != row) T_.row(i) -= column[i] * T_.row(row);
    std::swap(basis_[std::size_t(row)], entering);
    return entering;
  }

  /// y from the values of the basic variables.
  Vector y_part(const ScalarVector& values) const {
    Vector y = Vector::Zero(n_);
    for (Index i = 0; i < n_; ++i)
      if (const Index v = basis_[std::size_t(i)]; v >= n_ && v < 2 * n_) y[v - n_] = double(values[i]);
    return y;
  }

  std::vector<Index> basis_of_y() const {
    std::vector<Index> S;
    for (const Index v : basis_)
      if (v >= n_) S.push_back(v - n_);
    std::sort(S.begin(), S.end());
    return S;
  }

 private:
  // -1, 0, 1; equal up to rounding.
  static int compare(Scalar a, Scalar b) {
    if (std::abs(a - b) <= 64 * epsilon * (std::abs(a) + std::abs(b))) return 0;
    return a < b ? -1 : 1;
  }

  bool before(Index i, Index j, const ScalarVector& by) const {
    for (Index k = 0; k <= n_; ++k)
      if (const int order = compare(T_(i, k) / by[i], T_(j, k) / by[j])) return order < 0;
    return false;
  }

  const ScalarMatrix M_;
  const ScalarVector d_;
  Index n_;
  ScalarMatrix T_;
  std::vector<Index> basis_;
};

// y from the basis itself: y_S = -M_SS^{-1} q_S without the rounding of the pivots.
Vector solution_of(const Matrix& M, const Vector& q, const std::vector<Index>& S) {
  Vector y = Vector::Zero(q.size());
  if (!S.empty()) y(S) = Vector(Eigen::PartialPivLU<Matrix>(M(S, S)).solve(-q(S)));
  return y.cwiseMax(0);
}

template <class Scalar>
LemkeOutcome pivots(const Matrix& M, const Vector& q, const Vector& cover) {
  using ScalarVector = typename Tableau<Scalar>::ScalarVector;
  const Index n = q.size();
  LemkeOutcome outcome;
  outcome.y = outcome.direction = Vector::Zero(n);
  const ScalarVector d = cover.cast<Scalar>();
  Tableau<Scalar> tableau(M, q / q.cwiseAbs().maxCoeff(), d);
  Index entering = 2 * n;
  ScalarVector column = tableau.column(entering);
  Index row = tableau.leaving(d, 0);
  const int cap = 1000 + 50 * int(n);  // pivots: exponential in the worst case, a few n in practice
  for (; outcome.pivots < cap; ++outcome.pivots) {
    const Index left = tableau.pivot(row, entering, column);
    if (left == 2 * n) {
      outcome.basis = tableau.basis_of_y();
      outcome.y = solution_of(M, q, outcome.basis);
      outcome.solved = outcome.y.allFinite();
      return outcome;
    }
    entering = left < n ? left + n : left - n;
    column = tableau.column(entering);
    row = tableau.leaving(column, 1e-11 * column.cwiseAbs().maxCoeff());
    if (row >= 0) continue;
    outcome.ray = true;
    outcome.direction = tableau.y_part(-column);
    if (entering >= n) outcome.direction[entering - n] = 1;
    return outcome;
  }
  return outcome;
}

}  // namespace

LemkeOutcome lemke(const Matrix& M, const Vector& q, const Vector& cover) {
  if (q.size() > 0 && q.minCoeff() < 0)
    return cover.size() > 0 ? pivots<long double>(M, q, cover) : pivots<double>(M, q, Vector::Ones(q.size()));
  LemkeOutcome outcome;
  outcome.solved = true;
  outcome.y = outcome.direction = Vector::Zero(q.size());
  return outcome;
}

}  // namespace bromwich
