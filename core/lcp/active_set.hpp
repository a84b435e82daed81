#pragma once
// One linear complementarity problem LCP(q, M): find y with 0 <= y ⊥ w = M y + q >= 0.
//
// symbol  meaning
// S       active set, {i : y_i > 0}; y_S = -M_SS^{-1} q_S, y_i = 0 elsewhere
// P(S)    principal pivot transform of M on S: with (a, b) = (y_S, w_I) and q, (a, b) = E q - P(:,S) q_S, where E keeps
//         q_I. One matrix-vector product solves the problem once S is known, one rank-1 update changes S by an index.
//
// Facts used: P: the solution is unique; semismooth Newton on min(y, w) is an active-set exchange that can cycle,
// Murty's least-index rule always ends (Murty, Linear Algebra Appl. 7, 1974). Z: the least element is reached from the
// empty set by monotone additions, and the problem is infeasible exactly when an added block's solution is not positive
// (Chandrasekaran, Opsearch 7, 1970; Cottle, Pang, Stone, The Linear Complementarity Problem). PSD: the solutions form
// a convex set, so that one that is isolated is the only one; otherwise the one of least norm is taken
// (core/lcp/least_norm.hpp). A matrix that is both PSD and Z is treated as Z: the least element has the least norm.

#include "lcp_class.hpp"
#include "least_norm.hpp"
#include "solution.hpp"

#include <Eigen/LU>

#include <cmath>
#include <cstdint>
#include <vector>

namespace bromwich {

struct LcpOutcome {
  bool solved = false;
  bool infeasible = false;  ///< proven (Z and PSD)
  bool fallback = false;    ///< pivoting, a restart from the empty set or the least-norm solver was needed
  bool exhausted = false;   ///< every active set was tried (n <= 12): no solution exists that may be taken
  int newton = 0;           ///< active sets tried
};

/// Solves problems with one dense matrix and changing q, keeping the active set and its transform from one problem to
/// the next. A problem with unchanged active set costs O(n |S|), an exchange of k indices O(k n^2); after large
/// exchanges M_SS is factorized anew, and the transform is formed again when a small exchange follows. Inside, rows and
/// columns are scaled to comparable size, so that M and q may have any.
class ActiveSetLcp {
 public:
  /// With `least_of`, a solution also has to be the least element of LCP(., *least_of) seen from the fixed rest, that
  /// is (*least_of)_SS has to be an M-matrix (positive pivots). For marching, M + W_0 is solved but M decides.
  ActiveSetLcp(const Matrix& M, LcpClass, const Matrix* least_of = nullptr);

  /// y in SOL(q, M); the active set of the last call is the start. Unsolved: y holds the last iterate.
  LcpOutcome solve(const Vector& q, Vector& y);

  /// w = M y + q of the last solution.
  const Vector& slack() const { return w_; }

  /// Forget the active set.
  void reset();

  /// Start from the active set {y > 0}; what the solver holds of its present one is used where the two are close.
  void start_from(const Vector& y);

 private:
  bool newton(LcpOutcome&);
  bool least_index(LcpOutcome&);
  bool least_element(LcpOutcome&);
  bool least_norm(const Vector& q, LcpOutcome&);
  bool lemke(LcpOutcome&);
  bool enumerate(LcpOutcome&);
  bool fall_back(const Vector& q, LcpOutcome&);
  bool take(const Vector& scaled_y);
  bool may_be_taken(const std::vector<Index>& S) const;
  bool is_confirmed() const;
  bool exchange_flips();
  bool pivot_on_flips(double most_growth = INFINITY);
  bool factorize();
  bool form_transform();
  void flip_active_set();
  void evaluate();
  void refine();
  void look_at_transform();
  bool negative(Index i) const;
  void accept(Vector& y);

  Equilibration scale_;
  Matrix M_;                                ///< R M C
  Matrix original_;                         ///< M as given: PSD only, the least norm depends on the columns' scale
  Matrix P_;                                ///< P(S) where transform_ holds
  Eigen::PartialPivLU<Matrix> lu_;          ///< of M_SS where it does not
  bool transform_ = true, regular_ = true;  ///< regular_: the last M_SS that was factorized
  bool amplifies_ = false;                  ///< P_ has large entries
  int updates_ = 0;                         ///< exchanges since P_ was last formed from M_
  const Matrix* least_of_;
  LcpClass class_;
  std::vector<char> active_;
  std::vector<Index> support_, rest_, flips_;
  std::vector<std::uint64_t> visited_;  ///< hashes of the active sets of this call
  Vector q_, w_, value_;                ///< R q; w; (y_S, w_I) in scaled units
  Vector taken_;                        ///< scaled y found without the active set; empty: value_ holds the solution
  double rounding_ = 0;                 ///< of the largest entry of q_
};

/// The least solution of a monotone problem (core/lcp/least_norm.hpp), regularized problems by ActiveSetLcp.
LeastNorm least_norm_solution(const Matrix& M, const Vector& q);

}  // namespace bromwich
