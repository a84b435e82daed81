#pragma once
// One method on one grid: which discretisation it stands for on a given scene, and its run.

#include "discrete_problem.hpp"
#include "ringing.hpp"
#include "solve.hpp"
#include "sparse_kernel.hpp"

#include <optional>

namespace bromwich {

/// A scene on a grid with what its methods share, made when first asked for.
class Methods {
 public:
  Methods(const Scene&, Backend&, Index J, const std::vector<Index>& components);

  /// Fills everything of `result` but times of the whole, states included.
  void run(Method, const Options&, Result& result);

  const DiscreteProblem& problem() const { return problem_; }
  /// Whether continuous piecewise-linear y is safe here.
  const BasisChoice& basis();

 private:
  void march(const Options&, Result&);
  void iterate(const Options&, Result&);
  void record_states(Method, Result&);
  const SparseKernel* kernel();

  DiscreteProblem problem_;
  std::optional<BasisChoice> basis_;
  std::optional<std::optional<SparseKernel>> kernel_;
};

}  // namespace bromwich
