#pragma once
// Derivatives of all results of a batch by parameters of its scenes, as ParameterDerivative finds them. A scene that is
// not solved, or not differentiable, has a reason in their place.

#include "../core/base/threads.hpp"
#include "../derivatives/parameter_derivative.hpp"
#include "batch.hpp"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

struct BatchJacobian {
  std::vector<std::vector<SolutionChange>> by;  ///< parameters x K; without rows where the scene has a reason
  std::vector<std::string> reason;              ///< K
  std::vector<DerivativeMargin> margin;         ///< K; 0 where there is no derivative
};

/// The parameters of scene k, as many for all scenes.
using ParametersOfScene = std::function<std::vector<VariedParameter>(Index k)>;

/// `located`: as in BatchDerivative. Scenes are made, and `parameters` is called, by the calling thread alone;
/// `threads` share what is left, and call sources. Throws Error where the result is not that of this batch.
BatchJacobian jacobian_of(const Batch&, const BatchResult&, const ParametersOfScene&, Backend&,
                          std::optional<bool> located = {}, const HostThreads& threads = {});

}  // namespace bromwich
