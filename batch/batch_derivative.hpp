#pragma once
// Derivatives of all results of a batch: one a scene, as derivatives/ makes them, with the scenes as leading axis.
// A scene that is not solved, or whose solution is not differentiable, has a reason instead; the other scenes keep
// their derivatives.

#include "../derivatives/switched_derivative.hpp"
#include "batch.hpp"
#include "derivatives_side_by_side.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// The derivatives of each scene. Where it has none, its tables are NaN and its reason says why; otherwise the reason
/// is empty.
template <class Value>
struct PerScene {
  std::vector<Value> value;         ///< K
  std::vector<std::string> reason;  ///< K
};

class BatchDerivative {
 public:
  /// `located`: with located switches (SwitchedDerivative, along some changes), as where rows are those of
  /// Batch::times; otherwise the derivative of the discrete solution where its y is continuous, whose rows are the time
  /// points. Throws Error where the result is not that of this batch. Sources are called by the calling thread alone.
  /// With a backend, scenes that share their dynamics are differentiated side by side in its arrays
  /// (DerivativesSideBySide); it has to outlive this object, and is used by one caller at a time. That pays where
  /// steps_many_scenes (core/seam/scene_arrays.hpp).
  BatchDerivative(const Batch&, const BatchResult&, std::optional<bool> located = {}, Backend* = nullptr);

  Index scenes() const { return Index(reason_.size()); }
  /// K lines: empty, or why there is no derivative.
  const std::vector<std::string>& reason() const { return reason_; }
  /// Scenes that are differentiated side by side.
  Index side_by_side() const;
  /// K booleans: with located switches.
  std::vector<bool> located() const;
  /// Of a scene without a derivative: 0.
  std::vector<DerivativeMargin> margin() const;

  /// One change for all scenes, or K. A direction in which a scene has no derivative is a reason; a wrong number or
  /// shape throws Error.
  PerScene<SolutionChange> jvp(const std::vector<DataChange>&, const HostThreads& = {}) const;
  /// Of one linear function of each scene's y, x, w and integral.
  PerScene<DataChange> vjp(const std::vector<SolutionChange>&, const HostThreads& = {}) const;

 private:
  struct One {
    std::shared_ptr<const SolutionDerivative> discrete;
    std::shared_ptr<const SwitchedDerivative> switched;
  };
  void prepare(Index k, const Scene&, const BatchResult&, std::optional<bool> located);
  template <class Out, class In, class Of>
  PerScene<Out> each(const std::vector<In>&, const HostThreads&, const Out& none, const Of&) const;

  bool has(Index k) const { return together_ && together_->has(k); }

  Index m_, n_, rows_;
  std::shared_ptr<const DerivativesSideBySide> together_;  ///< null: none
  std::vector<One> all_;
  std::vector<std::string> reason_;
};

}  // namespace bromwich
