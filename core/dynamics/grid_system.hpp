#pragma once
// Sparse dynamics that are the sum of one tridiagonal matrix for each direction of a box, such as diffusion with
// constant advection and Neumann or Robin ends. Eigenvectors of the directions beside the lines reduce a shifted solve
// to one tridiagonal solve a mode, where sparse matrices without this structure need an elimination.

#include "kronecker.hpp"
#include "sparse_system.hpp"

#include <memory>
#include <vector>

namespace bromwich {

/// A = X^{-1} (I ⊗ across + face ⊗ I) X, face = V diag(mu) V^{-1}; state index = line * points + position.
struct GridModes {
  Matrix V, inverse;         ///< lines x lines
  Vector mu;                 ///< lines
  Vector before, at, after;  ///< points: the diagonals of `across`; before[0] and after[points-1] are not used

  Index lines() const { return mu.size(); }
  Index points() const { return at.size(); }

  /// `directions`: tridiagonal, the slowest first, the last one across. Null: the eigenvectors of advection are too far
  /// from orthogonal for accurate solves, or there are too many lines.
  static std::shared_ptr<const GridModes> of(const std::vector<SparseMatrix>& directions, double reaction);
};

/// x = X x~, y = Y y~, w = Y w~ with positive diagonals X and Y: y~ and w~ are complementary where y and w are, and the
/// dynamics of x~ are a Kronecker sum, whose directions are symmetric. So is constant advection removed.
struct SymmetricForm {
  KroneckerDynamics modes;
  Vector x, y;  ///< the diagonals
};

class GridSystem final : public SparseSystem {
 public:
  /// X: a factor for each state, or empty. Both pointers may be null.
  GridSystem(SparseDynamics, std::shared_ptr<const GridModes>, Vector X = {},
             std::shared_ptr<const SymmetricForm> = nullptr);

  /// Null: there is none.
  const std::shared_ptr<const SymmetricForm>& symmetric_form() const { return form_; }

  std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const override;
  /// The dynamics of x / unit, with its matrices.
  std::shared_ptr<LinearSystem> in_units(SparseDynamics scaled, const Vector& unit) const;
  /// Whether shifted solves use the modes: y enters, and constraints see, few points of a line.
  bool solves_in_modes() const;

 private:
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads&) const override;

  std::shared_ptr<const GridModes> modes_;
  Vector X_;
  std::shared_ptr<const SymmetricForm> form_;
};

}  // namespace bromwich
