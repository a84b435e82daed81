#include "core/scene/mass_matrix.hpp"

#include "core/base/text.hpp"
#include "core/numerics/equilibration.hpp"
#include "core/scene/descriptor.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <vector>

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
  for (Memory& memory : scene.memories)
    for (Memory::Mode& mode : memory.modes) {
      if (mode.A.size() > 0) mode.A = solve(mode.A);
      if (mode.B.size() > 0) mode.B = solve(mode.B);
      if (mode.f)
        mode.f = [f = mode.f, inverse = solve(Matrix::Identity(d.E.rows(), d.E.rows()))](double t,
                                                                                         Eigen::Ref<Vector> value) {
          f(t, value);
          value = (inverse * value).eval();
        };
    }
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

namespace {

// The largest entry of each row.
Vector row_sizes(const SparseMatrix& matrix) {
  Vector sizes = Vector::Zero(matrix.rows());
  for (Index j = 0; j < matrix.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(matrix, j); a; ++a)
      sizes[a.row()] = std::max(sizes[a.row()], std::abs(a.value()));
  return sizes;
}

struct EmptyRows {
  std::vector<Index> of_E, of_both;

  EmptyRows(const Vector& E, const Vector& A) {
    for (Index i = 0; i < E.size(); ++i) {
      if (E[i] != 0) continue;
      of_E.push_back(i);
      if (A[i] == 0) of_both.push_back(i);
    }
  }
};

std::string first_of(const std::vector<Index>& rows) {
  const std::string row = "row " + std::to_string(rows.front());
  return rows.size() == 1 ? row : row + text(", the first of %zu,", rows.size());
}

bool is_singular_at(const LinearSystem& system, Complex z) {
  const DenseDynamics* d = system.small_state();
  if (!d) return !system.at_shift(z);
  const ComplexMatrix shifted = z * d->E.cast<Complex>() - d->A.cast<Complex>();
  // Whether a factorization finds a known solution; a condition estimate can miss a pivot that is 0.
  const Equilibration e = equilibrate(Matrix(shifted.cwiseAbs()));
  const ComplexMatrix even = e.rows.cast<Complex>().asDiagonal() * shifted * e.columns.cast<Complex>().asDiagonal();
  const ComplexVector u = ComplexVector::NullaryExpr(even.rows(), [](Index i) { return i % 3 == 0 ? -1.0 : 1.0; });
  const ComplexVector found = Eigen::PartialPivLU<ComplexMatrix>(even).solve(ComplexVector(even * u));
  return !found.allFinite() || (found - u).cwiseAbs().maxCoeff() > 1e-3;
}

// At two shifts that no regular pencil has as eigenvalues by chance.
bool is_singular_pencil(const LinearSystem& system, const Vector& E, const Vector& A) {
  const double size = A.size() > 0 && E.maxCoeff() > 0 ? A.maxCoeff() / E.maxCoeff() : 1;
  return is_singular_at(system, Complex(0.61, 0.83) * size) && is_singular_at(system, Complex(-1.37, 0.29) * size);
}

}  // namespace

std::string describe_singular_mass(const LinearSystem& system) {
  const std::string singular = "the mass matrix E is singular: ";
  const std::string algebraic =
      "eliminate the algebraic equations, as rows with w = 0 and a free y where they are linear";
  Vector E, A;
  if (const auto* sparse = system.matrices())
    E = row_sizes(sparse->E), A = row_sizes(sparse->A);
  else if (const auto* dense = system.small_state())
    E = dense->E.cwiseAbs().rowwise().maxCoeff(), A = dense->A.cwiseAbs().rowwise().maxCoeff();
  else
    return singular + algebraic;
  const EmptyRows empty(E, A);
  if (!empty.of_both.empty())
    return singular + first_of(empty.of_both) +
           " of E and of A is zero, as that of a node that no element has: take it out, or give it a mass";
  if (is_singular_pencil(system, E, A))
    return singular + "so is zE - A for all z, and no solution is determined: look for equations that repeat others";
  if (!empty.of_E.empty())
    return singular + first_of(empty.of_E) + " of E is zero, an algebraic equation: " + algebraic;
  return singular + algebraic;
}

}  // namespace bromwich
