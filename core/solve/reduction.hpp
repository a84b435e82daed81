#pragma once

#include "../result/inner_options.hpp"
#include "../result/result.hpp"
#include "../scene/scene.hpp"

#include <functional>
#include <memory>
#include <optional>

namespace bromwich {

/// A simpler scene, the options of its solve, and the way to and from its results.
struct Reduction {
  Scene scene;
  InnerOptions options;
  std::shared_ptr<RowMatrix> first_iterate = {};  ///< that the options point to, if they do
  /// y, x and N x of the given scene as those of the simpler one. Empty: they are the same.
  std::function<void(Result&)> there = {};
  std::function<void(Result&)> back = {};                   ///< likewise
  std::function<void(LocatedSolution&)> back_located = {};  ///< active sets and switches, with `back` of polynomials
  /// After `back`, of the result of a solve: what is measured and recorded in the given scene.
  std::function<void(Result&)> finish = {};
};

/// The reduction of a scene; nothing where there is nothing to take out. It may refer to both arguments.
using Reduce = std::optional<Reduction> (*)(const Scene&, const InnerOptions&);

}  // namespace bromwich
