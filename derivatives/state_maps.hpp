#pragma once
// The states of a discrete solution as linear maps of x0 and of u = y + phi, with y linear between the time points, and
// the transposed maps. x_j = e^{hA} x_{j-1} + L B u_{j-1} + R B u_j, L = h (phi_1 - phi_2)(hA), R = h phi_2(hA).

#include "../core/base/types.hpp"

#include <utility>

namespace bromwich {

class StateMaps {
 public:
  virtual ~StateMaps() = default;

  /// N e^{A t_j} x0: (J+1) x n.
  virtual RowMatrix seen(const Vector& x0) const = 0;
  /// Σ_j e^{A^T t_j} N^T rho_j: m. Empty where A^T is not known.
  virtual Vector seen_transposed(const RowMatrix& rho) const = 0;
  /// x_j: (J+1) x m. `u`: (J+1) x n.
  virtual RowMatrix states(const Vector& x0, const RowMatrix& u) const = 0;
  /// The gradient of Σ_j of_x_j · x_j with respect to u, (J+1) x n, and x0. Throws Error where A^T is not known.
  virtual std::pair<RowMatrix, Vector> states_transposed(const RowMatrix& of_x) const = 0;
};

}  // namespace bromwich
