#pragma once
// A march whose steps are linear problems, for derivatives on given active sets. Optional
// (FusedOperations::linear_march): a backend has it if a step that the host solves costs nothing more.

#include "../base/types.hpp"

#include <functional>

namespace bromwich {

/// y of step j from q, n values each: the solution of a linear problem with q in place of SOL(M + W_0, q).
using LinearStep = std::function<void(Index j, const Vector& q, Vector& y)>;

}  // namespace bromwich
