#pragma once
// The state at rest under constant sources: capacitors open, inductors short.

#include "core/base/types.hpp"

#include <optional>

namespace bromwich::circuits {

/// x with A x + B y + b = 0, 0 <= y ⊥ N x + M y + q >= 0, reached from x = 0 by steps of implicit Euler that grow;
/// empty where they do not come to rest (an ideal inductor across a source) or a step has no solution.
std::optional<Vector> operating_point(const SparseMatrix& A, const SparseMatrix& B, const Vector& b,
                                      const SparseMatrix& N, const SparseMatrix& M, const Vector& q, double T);

}  // namespace bromwich::circuits
