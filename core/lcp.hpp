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
// (Chandrasekaran, Opsearch 7, 1970; Cottle, Pang, Stone, The Linear Complementarity Problem).

#include "scene.hpp"

#include <Eigen/LU>

#include <vector>

namespace bromwich {

/// Off-diagonal entries all <= 0.
bool is_Z(const LcpMatrix&);

/// Strictly diagonally dominant with positive diagonal in rows or in columns, or positive definite symmetric part: each
/// suffices for a P-matrix.
bool is_surely_P(const LcpMatrix&);

/// All principal minors positive, tested by Schur complements in 2^n steps. Precondition: n <= 16.
bool is_P_exact(const Matrix&);

/// P where a sufficient condition or, for n <= 16, the exact test says so; else Z where the signs say so and the
/// diagonal is positive; else unknown.
LcpClass classify(const LcpMatrix&);

const char* to_string(LcpClass);

struct LcpOutcome {
  bool solved = false;
  bool infeasible = false;  ///< proven (Z only)
  bool fallback = false;    ///< least-index pivoting or a restart from the empty set was needed
  int newton = 0;           ///< active sets tried
};

/// Solves problems with one dense matrix and changing q, keeping the active set and its transform from one problem to
/// the next. A problem with unchanged active set costs O(n |S|), an exchange of k indices O(k n^2); after large
/// exchanges M_SS is factorized anew, and the transform is formed again when a small exchange follows.
class ActiveSetLcp {
 public:
  /// With `least_of`, a solution also has to be the least element of LCP(., *least_of) seen from the fixed rest, that
  /// is
  /// (*least_of)_SS has to be an M-matrix (positive pivots). For marching, M + W_0 is solved but M decides.
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
  bool exchange_until_complementary(const Vector& q, int limit, bool least_index, LcpOutcome&);
  bool least_element(const Vector& q, LcpOutcome&);
  bool active_set_is_least() const;
  bool exchange_flips();
  bool pivot_on_flips();
  bool factorize();
  bool form_transform();
  void flip_active_set();
  void evaluate(const Vector& q);
  double tolerance(const Vector& q) const;
  void accept(const Vector& q, Vector& y);

  Matrix M_;
  Matrix P_;                        ///< P(S) where transform_ holds
  Eigen::PartialPivLU<Matrix> lu_;  ///< of M_SS where it does not
  bool transform_ = true;
  int updates_ = 0;  ///< exchanges since P_ was last formed from M_
  const Matrix* least_of_;
  LcpClass class_;
  std::vector<char> active_;
  std::vector<Index> support_, rest_, flips_;
  Vector w_, value_;
};

}  // namespace bromwich
