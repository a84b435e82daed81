#pragma once

#include "../dynamics/dynamics.hpp"
#include "../host/affine_chain.hpp"
#include "../host/step_chain.hpp"
#include "array.hpp"

#include <functional>
#include <memory>

namespace bromwich {

/// Operations that a backend has beyond the required ones, because one kernel does what several would, or because its
/// device does what the host would. An empty one is replaced (see the members of Backend of the same name).
struct FusedOperations {
  /// Operations recorded for replay; their arrays and plans have to outlive it. Nothing is done yet. Empty where replay
  /// gains nothing: the arrays, of `values` numbers each, are so large that the time to launch is negligible.
  std::function<std::function<void()>(Index values, const std::function<void()>& operations)> record;
  std::function<void(const RowMatrix& amplitudes, const Matrix& shapes, Array& to)> upload_product;
  std::function<void(const Vector& values, const Array& P, Array& to)> upload_projection;
  std::function<void(const Array& from, RowMatrix& to, const std::function<void()>& operations)> download_during;
  std::function<void(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                     Array& coarse_y, Array& old)>
      restrict_problem;
  std::function<bool(const Array& y, Index run, double part)> alternates;
  std::function<std::unique_ptr<StepChain>(const StepChainProblem&)> step_chain;
  std::function<std::unique_ptr<AffineChain>(const AffineChainSizes&)> affine_chain;
  std::function<ComplexMatrix(const Dynamics&, const ComplexVector& nodes)> resolvent;
};

}  // namespace bromwich
