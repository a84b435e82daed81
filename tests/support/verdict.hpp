#pragma once
// Judges a result of the solver by the oracle's own matrices, step by step: starting from x_{j-1} and y_{j-1} of the
// result, x_j and y_j must solve the step of the discretisation that the result names. A result that passes solves the
// discrete problem up to rounding in every step, however much the scene magnifies it. It is the only solution if the
// matrix of the step is P.

#include "core/solve/solve.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/random_scenes.hpp"

#include <string>

namespace bromwich::oracle {

struct Verdict {
  std::string failure;   ///< of a result that says solved or infeasible; empty: the claim is right
  double violation = 0;  ///< solved: largest violation of a row of complementarity, relative to the terms of its sum
  double residual = 0;   ///< solved: the residual, from y, x and the oracle's matrices
};

/// The discretisation of a result, from its method and description.
Scheme scheme_of(const Result&);

/// For results with status solved or infeasible and all states recorded.
Verdict judge(const DenseScene&, const Result&);

/// One scene by one method.
struct Trial {
  std::string status;  ///< of the result, or "refused" where an Error was thrown
  std::string reason, kernel;
  std::string failure;  ///< silent failure: the result's claim is false
  bool missed = false;  ///< tolerance_not_met, although the remaining steps have solutions
  double violation = 0;
};

Trial try_method(const RandomScene&, const DenseScene&, Method, Backend&);

}  // namespace bromwich::oracle
