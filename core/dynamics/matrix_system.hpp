#pragma once
// Common part of dense and sparse dynamics.

#include "../base/require.hpp"
#include "linear_system.hpp"

namespace bromwich {

template <class Matrices>
class MatrixSystem : public SystemOf<Matrices> {
 public:
  using SystemOf<Matrices>::SystemOf;
  using SystemOf<Matrices>::d;

  Index states() const override { return d.A.rows(); }
  Index constraints() const override { return d.B.cols(); }
  void validate(bool without_constraints) const override {
    const Index m = d.A.rows(), n = d.B.cols();
    require_some("A", m, "rows");
    if (!without_constraints) require_some("B", n, "columns");
    require_shape("A", d.A, m, m, "square, states x states");
    require_shape("B", d.B, m, n, "states x constraints");
    require_shape("N", d.N, n, m, "constraints x states");
    require_finite("A", d.A);
    require_finite("B", d.B);
    require_finite("N", d.N);
    if (d.E.rows() == 0 && d.E.cols() == 0) return;
    require_shape("E", d.E, m, m, "square, states x states");
    require_finite("E", d.E);
  }

  std::shared_ptr<LinearSystem> with_inputs_and_outputs(const SparseMatrix& B, const SparseMatrix& N) const override {
    return linear_system(Matrices{d.A, B, N, d.E});
  }
  Vector observe(const Vector& x) const override { return d.N * x; }
  Vector observed_terms(const Vector& x) const override { return d.N.cwiseAbs() * x.cwiseAbs(); }

  bool has_mass() const override { return d.E.rows() > 0; }
  Vector times_mass(const Vector& x) const override { return has_mass() ? Vector(d.E * x) : x; }
};

}  // namespace bromwich
