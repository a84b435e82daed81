#pragma once
// The states of a discrete solution as linear maps of x0 and of u = y + phi, with y linear between the time points, and
// the transposed maps. x_j = e^{hA} x_{j-1} + L B u_{j-1} + R B u_j, L = h (phi_1 - phi_2)(hA), R = h phi_2(hA).

#include "../base/threads.hpp"
#include "../kernel/discrete_problem.hpp"

#include <memory>
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

/// Of the dynamics and the grid of a problem, neither of which may go before this. Dense: by steps. Kronecker sums: in
/// modes. Others: `seen` by the windows of contours that cover all time points, states by steps of one contour.
std::unique_ptr<StateMaps> make_state_maps(const DiscreteProblem&, const HostThreads&);

}  // namespace bromwich
