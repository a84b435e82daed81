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
// empty set by monotone additions. The problem is infeasible exactly when the solution of an added block is not
// positive (Chandrasekaran, Opsearch 7, 1970; Cottle, Pang, Stone, The Linear Complementarity Problem). PSD: the
// solutions form a convex set, so that an isolated solution is unique; otherwise the one of least norm is returned
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
  bool exhausted = false;   ///< every active set was tried (n <= 12): no acceptable solution exists
  int newton = 0;           ///< active sets tried
};

/// Solves problems with one dense matrix and changing q; the active set and its transform are kept from one problem to
/// the next. A problem with unchanged active set costs O(n |S|), an exchange of k indices O(k n^2). After large
/// exchanges M_SS is factorized, and the transform is computed again when a small exchange follows. Rows and columns
/// are scaled internally, so M and q may have any scale.
class ActiveSetLcp {
 public:
  /// With `least_of`, a solution is accepted only if (*least_of)_SS is an M-matrix (positive pivots): it is then the
  /// least element for this matrix. In marching, the matrix is M + W_0 and `least_of` is M.
  ActiveSetLcp(const Matrix& M, LcpClass, const Matrix* least_of = nullptr);

  /// y in SOL(q, M), starting from the active set of the last call. If not solved, y is the last iterate.
  LcpOutcome solve(const Vector& q, Vector& y);

  /// w = M y + q of the last solution.
  const Vector& slack() const { return w_; }

  /// Start the next call from the empty active set.
  void reset();

  /// Start from the active set {y > 0}. The stored transform is updated if the two active sets differ little.
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
  bool is_confirmed();
  bool is_unique_on(const std::vector<Index>& S);
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
  Matrix M_;                        ///< R M C
  Matrix original_;                 ///< M as given; PSD only, since the least norm depends on the scale of the columns
  Matrix P_;                        ///< P(S) if transform_
  Eigen::PartialPivLU<Matrix> lu_;  ///< of M_SS otherwise
  bool transform_ = true, regular_ = true;  ///< regular_: of the last factorized M_SS
  bool amplifies_ = false;                  ///< P_ has large entries
  int updates_ = 0;                         ///< exchanges since P_ was computed from M_
  const Matrix* least_of_;
  LcpClass class_;
  std::vector<char> active_;
  std::vector<Index> support_, rest_, flips_;
  std::vector<std::uint64_t> visited_;  ///< hashes of the active sets of this call
  Vector q_, w_, value_;                ///< R q; w; (y_S, w_I) in scaled units
  Vector taken_;                        ///< scaled y found without the active set; empty: value_ holds the solution
  double rounding_ = 0;                 ///< of the largest entry of q_

  struct JudgedSet {
    std::vector<Index> S;
    bool well_conditioned;
  };
  static constexpr std::size_t most_judged_ = 16;  ///< a march alternates between few sets
  std::vector<JudgedSet> judged_;                  ///< PSD: the last sets whose M_SS was examined; the latest first
  Vector positive_;                                ///< y >= 0 in scaled units, of is_confirmed
  std::vector<Index> positive_set_;
  SlackTerms slack_terms_;
};

/// The least-norm solution of a monotone problem (core/lcp/least_norm.hpp); ActiveSetLcp solves the regularized
/// problems.
LeastNorm least_norm_solution(const Matrix& M, const Vector& q);

/// Whether {y >= 0, M y + q >= 0} is proven empty, for any M; then LCP(q, M) has no solution. The conditions of the
/// linear program min 0 on this set are a monotone problem with a skew matrix, of twice the size.
bool has_no_feasible_point(const Matrix& M, const Vector& q);

}  // namespace bromwich
