#pragma once
// Derivatives of a discrete solution with a continuous y over all time points at once, on any backend: with respect to
// x0, to sources that enter through B, to g and to M. With the active sets held (derivatives/held_sets.hpp) the
// changes of a solution are
//
//     (M dy + K dy + dr)_S = 0,      dr = N e^{At} dx0 + K dphi + dg + dM y,      dw = M dy + K dy + dr,
//
// and a linear function Σ ȳ·dy + w̄·dw of them has the gradient
//
//     ((M + K)^T mu)_S = (ȳ + (M + K)^T w̄)_S,      rho = w̄ - mu,
//     ḡ = rho,   M̄ = rho^T y,   φ̄ = K^T rho,   x̄0 = Σ_j e^{A^T t_j} N^T rho_j,
//
// where K^T runs backwards in time. Both are solved by the method of the solution: marched, swept or in cycles.
// Marching a Kronecker sum on the host is stepping in modes (derivatives/modal_derivative.hpp).

#include "../core/seam/backend.hpp"
#include "held_sets.hpp"
#include "modal_derivative.hpp"
#include "set_responses.hpp"
#include "solution_derivative.hpp"
#include "state_maps.hpp"

#include <memory>
#include <vector>

namespace bromwich {

class SpaceTimeDerivative {
 public:
  /// The result must be of this scene, on a grid of equal steps, by march, contour or multigrid; its method solves the
  /// linear problems, too. The backend need not be the one that solved the scene, and has to outlive this object.
  /// Throws Error as SolutionDerivative does, and for sources of the state that do not enter through B, free rows,
  /// dense dynamics with a mass matrix, and sparse dynamics whose lag weights would take too much memory.
  SpaceTimeDerivative(const Scene&, const Result&, Backend&);
  ~SpaceTimeDerivative();

  Index steps() const { return J_; }
  const DerivativeMargin& margin() const { return margin_; }
  /// That solves the linear problems: march where another did not converge.
  Method method() const { return stepped_ ? Method::march : forward_->method(); }

  /// Members x0 (m), f ((J+1) x n, through B), g ((J+1) x n) and M (n x n); others throw Error. x of what is returned
  /// is empty, or (J+1) x m with `states`. Uses the plans and arrays of this object.
  SolutionChange jvp(const DataChange&, bool states = false);
  /// x of the function may be empty or (J+1) x m. The gradient has the members f through B, g and M, and x0 where A is
  /// known as a matrix. Without `by_x0` it is left out: for sparse A it costs more than all others.
  DataChange vjp(const SolutionChange&, bool by_x0 = true);

 private:
  void hold_sets(Method);
  SetRounding follow(const Vector& t);
  const StateMaps& maps();
  HeldSets& backward();
  TransposedKernel& backward_kernel();

  Scene scene_;
  Backend& backend_;
  GridFamily family_;
  Index J_ = 0, n_ = 0;
  double h_ = 0;
  RowMatrix y_, w_, active_;
  RowMatrix eta_;  ///< of vjp, kept: memory for a moment costs more than what is written to it
  LcpMatrix transposed_M_;
  std::unique_ptr<ModalDerivative> stepped_;           ///< takes all products, or null
  std::unique_ptr<HeldSets> forward_, backward_;       ///< the second is made by the first vjp
  std::unique_ptr<TransposedKernel> backward_kernel_;  ///< likewise, where K^T is not left by the march
  std::unique_ptr<StateMaps> maps_;                    ///< made on first use
  SetResponses at_zero_;                               ///< of M
  Index set_at_zero_ = 0;
  std::vector<Index> undecided_;  ///< undecided_at_start
  DerivativeMargin margin_;
};

/// Whether the derivatives of this result take less time on this backend over all time points than step by step on the
/// host, by what the backend says of its costs.
bool space_time_pays(const Backend&, const Scene&, const Result&);

}  // namespace bromwich
