#pragma once
// Solves one scene after the other. What the last one has prepared serves the next one where only x0 and the sources
// may differ, as with a Solver, which need not be made for that.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"
#include "../seam/backend.hpp"

#include <memory>

namespace bromwich {

/// Initial values of scenes that differ in x0, f and g at most. Dense dynamics are compared by their values, others by
/// their handles.
bool share_preparation(const Scene&, const Scene&);

/// Keeps the data of one scene at most: a large Kronecker sum or sparse matrices with initial values. The backend has
/// to outlive it. For one thread at a time.
class KeptSolver {
 public:
  explicit KeptSolver(Backend&);
  ~KeptSolver();

  /// As bromwich::solve, with the same result to rounding.
  Result solve(const Scene&, const Options&);
  void forget();

 private:
  struct Kept;

  Backend& backend_;
  std::unique_ptr<Kept> kept_;
};

}  // namespace bromwich
