#pragma once

#include "../dynamics/dynamics.hpp"
#include "../host/affine_chain.hpp"
#include "../host/step_chain.hpp"
#include "array.hpp"
#include "linear_march.hpp"
#include "recurrence.hpp"
#include "slab_operations.hpp"

#include <functional>
#include <memory>
#include <vector>

namespace bromwich {

class March;
struct MarchProblem;
class SceneArrays;
struct SceneArraysProblem;
class SceneMarch;
struct SceneMarchProblem;

/// Optional operations of a backend: one kernel replaces several operations, or the device replaces the host. An empty
/// one is replaced by required operations or by core/host (see the members of Backend of the same name), scene_march by
/// batch/.
struct FusedOperations {
  /// Records operations without running them, and returns their replay. Their arrays and plans must outlive it. Returns
  /// an empty function if replay gains nothing: arrays of `values` numbers make the launch overhead negligible.
  std::function<std::function<void()>(Index values, const std::function<void()>& operations)> record;
  std::function<void(const RowMatrix& amplitudes, const Matrix& shapes, Array& to)> upload_product;
  std::function<void(const Vector& values, const Array& P, Array& to)> upload_projection;
  std::function<void(const Array& from, RowMatrix& to, const std::function<void()>& operations)> download_during;
  std::function<void(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                     Array& coarse_y, Array& old)>
      restrict_problem;
  std::function<bool(const Array& y, Index run, double part)> alternates;
  /// These two may return null, for bases and stencils that they do not take.
  std::function<std::unique_ptr<RowTransform>(const FaceBasis&, Index rows, Way)> face_transform;
  std::function<std::unique_ptr<LcpBatch>(const ProjectedSweeps&, Index rows)> projected_sweeps;
  std::function<std::unique_ptr<StepChain>(const StepChainProblem&)> step_chain;
  std::function<std::unique_ptr<AffineChain>(const AffineChainSizes&)> affine_chain;
  std::function<ComplexMatrix(const Dynamics&, const ComplexVector& nodes)> resolvent;
  /// For at most so many scenes at a time (scene_march.hpp). Returns null for problems that it does not take.
  std::function<std::unique_ptr<SceneMarch>(const SceneMarchProblem&, Index scenes)> scene_march;
  /// Solutions and derivatives of scenes whose tables are arrays of the backend (scene_arrays.hpp). Likewise.
  std::function<std::unique_ptr<SceneArrays>(const SceneArraysProblem&, Index scenes)> scene_arrays;
  /// Like Backend::march. The class of M is not used.
  std::function<std::unique_ptr<March>(const MarchProblem&, Index rows, const LinearStep&)> linear_march;
  SlabOperations slabs;
};

/// Weights from stage b to stage a, at [a][b].
using StageWeights = const Weights* const (&)[2][2];

/// The lower triangular matrix that a sweep over both stages of a step divides by (Backend::sweep_stages).
struct StageDivisors {
  double first = 0, second_by_first = 0, second = 0;
};

/// The same for arrays with two stages in each step (the members of Backend of the same name). A backend has all but
/// the last two, on the host where it gives none of its own (stages_by_host).
struct StageOperations {
  std::function<void(const Array& stages, Array& first, Array& second)> take_stages;
  std::function<void(const Array& first, const Array& second, Array& stages)> put_stages;
  std::function<void(const StageDivisors&, const Array& r, const Array& v, Array& y)> sweep_stages;
  std::function<void(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                     Array& coarse_y, Array& old)>
      restrict_stages;
  /// These may return null: four convolutions take their place.
  std::function<std::unique_ptr<Convolution>(const StageRecurrence&, Index rows)> stage_convolution;
  std::function<std::unique_ptr<Convolution>(StageWeights, Index n, Index rows)> stage_tables;
};

class Backend;
/// The first four, by copies to the host and back.
StageOperations stages_by_host(Backend&);

}  // namespace bromwich
