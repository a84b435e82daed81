#pragma once
// Sparse dynamics as a linear system, for sparse.cpp and for kinds that know more of their matrices.

#include "dense.hpp"
#include "matrix_system.hpp"
#include "sparse.hpp"
#include "spectrum.hpp"

namespace bromwich {

class SparseSystem : public MatrixSystem<SparseDynamics> {
 public:
  using MatrixSystem::MatrixSystem;

  SparseMatrix inputs() const override { return d.B; }
  SparseMatrix outputs() const override { return d.N; }
  bool has_singular_mass() const override;
  SparseMatrix rates_of_inputs(double h) const override;
  Spectrum spectrum() const override;
  std::unique_ptr<ShiftedSystem<Complex>> at_shift(Complex z) const override;
  std::unique_ptr<ShiftedSystem<double>> at_shift(double z) const override;
  const SparseDynamics* matrices() const override { return &d; }
  std::shared_ptr<const DenseDynamics> dense_form() const override;

 protected:
  ComplexMatrix solve_at(const ComplexVector& nodes, const HostThreads&) const override;
};

}  // namespace bromwich
