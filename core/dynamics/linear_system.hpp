#pragma once
// The interface of the linear dynamics E x' = A x + B y, N x. Every kind of dynamics implements it in one file
// (dense.cpp, kronecker.cpp, sparse.cpp, supplied.cpp). Methods use this interface and its capabilities, and do not
// distinguish the kinds.
//
// symbol   shape   meaning
// A, E     m x m   state matrix, regular mass matrix (the identity unless has_mass)
// B, N     m x n, n x m   input of y to the state, output of the state to the constraints

#include "../base/error.hpp"
#include "../base/threads.hpp"
#include "../base/types.hpp"
#include "bromwich/dynamics.hpp"

#include <memory>
#include <utility>

namespace bromwich {

struct Spectrum;

/// A prepared (zE - A)^{-1} for one shift z, real or complex. Used by one thread at a time.
template <class Scalar>
class ShiftedSystem {
 public:
  using Columns = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  using Column = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  virtual ~ShiftedSystem() = default;
  /// (zE - A)^{-1} R for R m x k. Values that are not finite say that zE - A is singular.
  virtual Columns solve(const Columns& R) = 0;
  virtual Column solve(const Column& r) = 0;
  virtual std::size_t bytes() const = 0;
};

class LinearSystem {
 public:
  virtual ~LinearSystem() = default;

  virtual Index states() const = 0;       ///< m
  virtual Index constraints() const = 0;  ///< n
  /// Throws Error naming the first member whose shape or value is wrong. `without_constraints`: n = 0 is allowed.
  virtual void validate(bool without_constraints) const = 0;

  virtual SparseMatrix inputs() const = 0;   ///< B
  virtual SparseMatrix outputs() const = 0;  ///< N
  /// The same A and E with other B and N. Throws Error where B and N are part of the structure.
  virtual std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const = 0;
  /// N x.
  virtual Vector observe(const Vector& x) const = 0;
  /// |N| |x|: the rounding of N x is relative to this.
  virtual Vector observed_terms(const Vector& x) const = 0;

  virtual bool has_mass() const { return false; }
  /// E x.
  virtual Vector times_mass(const Vector& x) const { return x; }
  /// Whether E is known to be singular to rounding; rows and columns of a dense E are made comparable first.
  virtual bool has_singular_mass() const { return false; }
  /// E^{-1} B, the effect of y on x'. By default, with a mass matrix, z (zE - A)^{-1} B for z = 1e6/h.
  virtual SparseMatrix rates_of_inputs(double h) const;

  /// Bounds or estimates of the eigenvalues of E^{-1} A (core/dynamics/spectrum.hpp).
  virtual Spectrum spectrum() const = 0;

  /// N (z_p E - A)^{-1} B for all nodes z_p at once. Row p holds the n modal values (if there are `modes`), or the n x
  /// k entries of the matrix, row by row. Throws SingularShift if a node is an eigenvalue.
  ComplexMatrix shifted_solves(const ComplexVector& nodes, const HostThreads&) const;
  /// Prepares the solves of one shift. Null: zE - A is singular to rounding, or the dynamics have no such solves.
  virtual std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const = 0;
  virtual std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const = 0;

  // ---- capabilities: null where the dynamics do not have them ----

  /// Matrices of a state that is stepped as a whole, by e^{hA} or by products with m x m matrices.
  virtual const DenseDynamics* small_state() const { return nullptr; }
  /// A is diagonal in the sine modes of a Kronecker sum; shifted_solves gives modal values.
  virtual const KroneckerDynamics* modes() const { return nullptr; }
  /// A, B, N and E as sparse matrices.
  virtual const SparseDynamics* matrices() const { return nullptr; }
  /// Whether A is known as one of these three, and not by its solves alone.
  bool has_matrices() const { return small_state() || modes() || matrices(); }

  /// A, B, N and E as dense matrices. Throws Error above 4096 states.
  virtual std::shared_ptr<const DenseDynamics> dense_form() const { return nullptr; }

 private:
  virtual ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads&) const = 0;
};

/// The values of one kind as a LinearSystem: base class of the implementations.
template <class Kind>
class SystemOf : public LinearSystem {
 public:
  explicit SystemOf(Kind values) : d(std::move(values)) {}
  Kind d;
};

/// The error of shifted solves if zE - A is singular.
SingularShift eigenvalue_at(Complex z);

/// Throws Error above 4096 states, where dense matrices take 128 MiB each.
void require_dense_size(Index states);

}  // namespace bromwich
