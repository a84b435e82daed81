#pragma once
// The linear problems of the active sets of a solution: y_S = -W_SS^{-1} q_S, zero elsewhere, and the transposed ones.
// Sets recur, so each is inverted once; inverses for few constraints are kept as n x n matrices.

#include "../core/base/types.hpp"

#include <Eigen/LU>

#include <map>
#include <vector>

namespace bromwich {

class SetResponses {
 public:
  /// The index of this set, S increasing. `W`: its matrix, whenever the set is new; the same set of another matrix is
  /// asked for with another `kind`.
  Index take(const std::vector<Index>& S, const Matrix& W, int kind = 0);
  /// An estimate of the reciprocal condition of W_SS; 1 for the empty set.
  double condition(Index set) const { return members_[std::size_t(set)].condition; }
  const std::vector<Index>& active(Index set) const { return members_[std::size_t(set)].S; }

  /// y = -W_SS^{-1} q_S on S, zero elsewhere. y and q have n entries and are not the same.
  void solve(Index set, const Vector& q, Vector& y) const;
  /// mu = W_SS^{-T} q_S on S, zero elsewhere.
  void solve_transposed(Index set, const Vector& q, Vector& mu) const;

 private:
  struct Member {
    std::vector<Index> S;
    double condition = 1;
    Matrix response;                 ///< n x n: -W_SS^{-1}, zero elsewhere; empty for large n
    Matrix inverse;                  ///< W_SS^{-1} otherwise; empty for large sets
    Eigen::PartialPivLU<Matrix> lu;  ///< of large ones
  };
  std::map<std::pair<int, std::vector<Index>>, Index> known_;
  std::vector<Member> members_;
  Index last_ = -1;
  int last_kind_ = 0;
};

}  // namespace bromwich
