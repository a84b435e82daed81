#pragma once
// Derivatives of the scenes of a batch that share their dynamics and M, side by side in arrays of a backend
// (core/seam/scene_arrays.hpp), as SolutionDerivative has them for one scene.

#include "../core/seam/backend.hpp"
#include "../core/seam/scene_arrays.hpp"
#include "../derivatives/solution_derivative.hpp"
#include "../derivatives/step_direction.hpp"
#include "batch.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// The result of scene k as a single solve would have it. Where y may jump is known by the class of M; that y is the
/// one of continuous steps is checked by the derivative.
Result single_result(const Scene&, const BatchResult&, Index k);

class DerivativesSideBySide {
 public:
  static constexpr Index fewest = 32;  ///< scenes, a warp

  /// Null where the scenes do not share their dynamics, where they are large, few or have a y that may jump, and where
  /// the memory of the backend does not hold them. The backend has to outlive this object and is used by one caller at
  /// a time.
  static std::unique_ptr<DerivativesSideBySide> make(const Batch&, const BatchResult&, Backend&);

  /// Whether scene k is differentiated here. Others, those without a derivative among them, are left to
  /// SolutionDerivative, which says why.
  bool has(Index k) const { return place_[std::size_t(k)] >= 0; }
  DerivativeMargin margin(Index k) const;

  /// Of one change for all scenes, or of one for each scene of the batch. Values of scenes that are not here stay as
  /// they are, and so do those without a derivative in the direction of a jvp, which get a reason.
  void jvp(const std::vector<DataChange>&, std::vector<SolutionChange>& to, std::vector<std::string>& reason) const;
  void vjp(const std::vector<SolutionChange>&, std::vector<DataChange>& to) const;

 private:
  DerivativesSideBySide(const DenseDynamics&, SceneArraysProblem, Backend&, std::vector<Index> scenes, Index of_batch);
  void upload(const Batch&, const BatchResult&);
  Index rows() const { return problem_.J + 1; }
  RowMatrix packed(const std::vector<DataChange>&) const;
  template <class Change, class Table>
  std::unique_ptr<Array> table_of(const std::vector<Change>&, Table Change::*, Index rows, Index cols) const;

  Backend& backend_;
  SceneArraysProblem problem_;
  StepDirections directions_;
  std::vector<Index> scenes_;  ///< of the batch
  std::vector<Index> place_;   ///< of each scene of the batch among those; -1: not here
  std::unique_ptr<SceneArrays> plan_;
  std::unique_ptr<Array> x0_, f_, g_, y_, x_, w_;
  SceneArrays::States states_;
};

}  // namespace bromwich
