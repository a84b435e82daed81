#pragma once
// Marches whose steps are linear problems, for derivatives on given active sets. A backend that takes a step from the
// host at no cost is derived from this class, too.

#include "plans.hpp"

#include <functional>

namespace bromwich {

/// y of step j from q, n values each: the solution of a linear problem with q in place of SOL(M + W_0, q).
using LinearStep = std::function<void(Index j, const Vector& q, Vector& y)>;

class LinearMarches {
 public:
  virtual ~LinearMarches() = default;
  /// Like Backend::march. The class of M is not used.
  virtual std::unique_ptr<March> linear_march(const MarchProblem&, Index rows, const LinearStep&) = 0;
};

}  // namespace bromwich
