#include "core/scene/mass_matrix.hpp"

#include "core/numerics/equilibration.hpp"
#include "core/scene/descriptor.hpp"

#include <Eigen/LU>

namespace bromwich {

namespace {

// F of f = F phi once E is gone; f per state becomes E^{-1} f.
SparseMatrix source_columns(const Scene& scene) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  SparseMatrix identity(scene.states(), scene.states());
  identity.setIdentity();
  return identity;
}

template <class Solve>
void take_from_sources(Scene& scene, const Solve& solve) {
  if (!scene.f || scene.f_entry == SourceEntry::through_B) return;
  scene.F = solve(source_columns(scene));
  scene.f_entry = SourceEntry::through_F;
}

Scene without(const DenseDynamics& d, Scene scene) {
  const Equilibration e = equilibrate(d.E);
  const Eigen::PartialPivLU<Matrix> lu(scaled(d.E, e));
  const auto solve = [&](const Matrix& right) -> Matrix {
    return e.columns.asDiagonal() * lu.solve(Matrix(e.rows.asDiagonal() * right));
  };
  take_from_sources(scene, [&](const SparseMatrix& F) { return SparseMatrix(solve(Matrix(F)).sparseView(0, 0)); });
  scene.dynamics = DenseDynamics{solve(d.A), solve(d.B), d.N};
  return scene;
}

Scene without_diagonal(const SparseDynamics& d, Scene scene) {
  const Vector inverse = Vector(d.E.diagonal()).cwiseInverse();
  const auto solve = [&](const SparseMatrix& right) { return SparseMatrix(inverse.asDiagonal() * right); };
  if (scene.f && scene.f_entry == SourceEntry::state)
    scene.f = [f = scene.f, inverse](double t, Eigen::Ref<Vector> value) {
      f(t, value);
      value.array() *= inverse.array();
    };
  else
    take_from_sources(scene, solve);
  scene.dynamics = SparseDynamics{solve(d.A), solve(d.B), d.N};
  return scene;
}

}  // namespace

std::optional<Scene> without_mass(const Scene& scene) {
  if (!scene.dynamics->has_mass()) return std::nullopt;
  if (const auto* d = scene.dynamics->small_state()) return without(*d, scene);
  if (const auto* d = scene.dynamics->matrices(); d && is_diagonal(d->E)) return without_diagonal(*d, scene);
  return std::nullopt;
}

}  // namespace bromwich
