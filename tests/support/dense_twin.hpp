#pragma once
// A scene with all matrices dense and f as an m-vector.

#include "core/scene/scene.hpp"

namespace bromwich {

inline Scene dense_twin(const Scene& scene) {
  Scene twin = scene;
  const auto* sparse = get_if<SparseDynamics>(&scene.dynamics);
  const DenseDynamics dense = to_dense(scene.dynamics);
  twin.dynamics = dense;
  if (!scene.f || scene.f_entry == SourceEntry::state) return twin;
  const Matrix F = sparse && scene.f_entry != SourceEntry::through_B ? Matrix(scene.F) : dense.B;
  twin.f = [F, phi = scene.f](double t, Eigen::Ref<Vector> f) {
    Vector values = Vector::Zero(F.cols());
    phi(t, values);
    f = F * values;
  };
  twin.f_entry = SourceEntry::state;
  twin.F = SparseMatrix();
  return twin;
}

}  // namespace bromwich
