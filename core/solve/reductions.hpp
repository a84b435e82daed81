#pragma once
// A scene in its simplest form: what no method needs is taken out of it before one sees it, once.

#include "reduction.hpp"

#include <deque>
#include <vector>

namespace bromwich {

/// The reductions of a scene that apply, one after the other. Given scene and options have to outlive the object.
class Reductions {
 public:
  Reductions(const Scene& scene, const InnerOptions& options, const std::vector<Reduce>& list);

  const Scene& scene() const { return made_.empty() ? scene_ : made_.back().scene; }
  const InnerOptions& options() const { return made_.empty() ? options_ : made_.back().options; }

  /// y, x and N x of a result of the given scene as those of the reduced one.
  void there(Result&) const;
  void back(Result&) const;  ///< likewise
  /// The result of a solve of the reduced scene as that of the given one.
  Result of_solve(Result) const;

 private:
  const Scene& scene_;
  const InnerOptions& options_;
  std::deque<Reduction> made_;
  double spent_ = 0;
};

/// Before a method is chosen: memories, columns F, mass matrix, symmetric form, natural units, an idle constraint,
/// dense matrices.
const std::vector<Reduce>& reductions_of_scene();

/// Before one grid is solved: symmetric form, free rows.
const std::vector<Reduce>& reductions_of_grid();

/// Whether sparse dynamics are so small that dense matrices are faster.
bool becomes_dense(const Scene&, const InnerOptions&);

/// Whether method galerkin solves it: by its name, or since no other method of given steps does.
bool needs_galerkin(const Scene&, const InnerOptions&);

}  // namespace bromwich
