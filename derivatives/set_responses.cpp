#include "derivatives/set_responses.hpp"

#include <utility>

namespace bromwich {

namespace {

constexpr Index most_inverted = 16;     ///< n: a product with n x n zeros costs less than calls of a factorization
constexpr Index largest_inverse = 128;  ///< sets: a product costs less than two triangular solves, again and again

using SetVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, largest_inverse, 1>;  // no memory of the heap

}  // namespace

Index SetResponses::take(const std::vector<Index>& S, const Matrix& W, int kind) {
  if (last_ >= 0 && kind == last_kind_ && members_[std::size_t(last_)].S == S) return last_;
  const auto [place, added] = known_.try_emplace({kind, S}, Index(members_.size()));
  last_ = place->second;
  last_kind_ = kind;
  if (!added) return last_;
  Member& made = members_.emplace_back();
  made.S = S;
  const Index n = W.rows();
  if (n <= most_inverted) made.response = Matrix::Zero(n, n);
  if (S.empty()) return last_;
  made.lu.compute(W(S, S));
  made.condition = made.lu.rcond();
  if (Index(S.size()) > largest_inverse) return last_;
  Matrix inverse = made.lu.inverse();
  if (n <= most_inverted)
    made.response(S, S) = -inverse;
  else
    made.inverse = std::move(inverse);
  made.lu = {};
  return last_;
}

void SetResponses::solve(Index set, const Vector& q, Vector& y) const {
  const Member& m = members_[std::size_t(set)];
  if (m.response.size() > 0) {
    y.noalias() = m.response * q;
    return;
  }
  y.setZero(q.size());
  if (m.S.empty()) return;
  if (m.inverse.size() > 0) {
    const SetVector given = q(m.S), of_set = -(m.inverse * given);
    y(m.S) = of_set;
    return;
  }
  const Vector of_set = m.lu.solve(Vector(q(m.S)));
  y(m.S) = -of_set;
}

void SetResponses::solve_transposed(Index set, const Vector& q, Vector& mu) const {
  const Member& m = members_[std::size_t(set)];
  if (m.response.size() > 0) {
    mu.noalias() = -(m.response.transpose() * q);
    return;
  }
  mu.setZero(q.size());
  if (m.S.empty()) return;
  if (m.inverse.size() > 0) {
    const SetVector given = q(m.S), of_set = m.inverse.transpose() * given;
    mu(m.S) = of_set;
    return;
  }
  const Vector of_set = m.lu.transpose().solve(Vector(q(m.S)));
  mu(m.S) = of_set;
}

}  // namespace bromwich
