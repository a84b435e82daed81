#pragma once
// K of a scene as one matrix over all time points, from one step of the written-out state.

#include "core/dynamics/dynamics.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/scene/scene.hpp"

namespace bromwich {

// (J+1)n x (J+1)n: row block j, column block i.
inline Matrix dense_kernel(const Scene& scene, Index J) {
  const DenseDynamics d = to_dense(scene.dynamics);
  const Index n = scene.constraints();
  const LagTable table = lag_table(Recurrence(dense_recurrence(d, Rule::exponential, scene.T / double(J))), J);
  Matrix K = Matrix::Zero((J + 1) * n, (J + 1) * n);
  for (Index j = 1; j <= J; ++j)
    for (Index i = 0; i <= j; ++i) {
      const RowMatrix& weights = i == 0 ? table.S : table.W;
      K.block(j * n, i * n, n, n) = Eigen::Map<const RowMatrix>(weights.row(j - i).data(), n, n);
    }
  return K;
}

inline Vector stacked(const RowMatrix& v) { return Eigen::Map<const Vector>(v.data(), v.size()); }

}  // namespace bromwich
