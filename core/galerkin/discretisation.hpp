#pragma once
// The exponential Galerkin method in time (Wang, Chen, An exponential integrator based discontinuous Galerkin method
// for linear complementarity systems). y is linear on each of N intervals of length h and discontinuous at their ends.
// The complementarity problem is tested with the same functions. On interval k, s = (t - t_{k-1})/h,
//
//     y = (1-s) a_k + s b_k,    z_k = (a_k, b_k) >= 0,    psi = (1-s, s),
//     w_k = (2/h) ∫ psi ⊗ w dt = D z_k + C x_{k-1} + q_k,    0 <= z_k ⊥ w_k >= 0,
//     x_k = E x_{k-1} + H z_k + F_k,                          E0 x_0 + ET x_N = b.
//
// x is exact for this y: with G_j = phi_j(hA),
//
//     E = G_0,   H = h [(G_1 - G_2) B, G_2 B],   C = 2 [N G_2; N (G_1 - G_2)],
//     D = 1/3 [2M, M; M, 2M] + 2h [N (G_3 - G_4) B, N G_4 B; N (G_2 - 2 G_3 + G_4) B, N (G_3 - G_4) B].
//
// Below the diagonal the block for intervals k < k' is C E^{k'-k-1} H: x carries it, and nothing larger than one
// interval is ever formed.
//
// Intervals have one length h, or a few: to have nodes at given times (core/galerkin/location.hpp), the grid consists
// of parts with one length each.
//
// symbol   variable        shape
// z, w, q  RowMatrix       N x 2n, row k-1 for interval k: left end, right end
// x        RowMatrix       (N+1) x m
// F        forcing         N x m

#include "../kernel/shared_dynamics.hpp"
#include "../scene/natural_units.hpp"
#include "../scene/scene.hpp"

namespace bromwich {

struct GalerkinStep {
  Matrix E;  ///< m x m
  Matrix H;  ///< m x 2n
  Matrix C;  ///< 2n x m
  Matrix D;  ///< 2n x 2n
  Matrix M;  ///< 2n x 2n, the part of D without the dynamics
};

/// Intervals of one length, from the end of the previous part, or 0, to `end`.
struct GridPart {
  double end = 0;
  Index intervals = 0;
};

/// Intervals first .. first + count - 1, which share their matrices.
struct GalerkinRun {
  Index first = 0, count = 0;
  GalerkinStep step;
};

/// The whole discrete problem. Initial values are the boundary condition (I, 0, x0).
struct GalerkinProblem {
  Index N = 0;
  Vector t;                       ///< N+1 nodes
  std::vector<GalerkinRun> runs;  ///< one on a uniform grid
  RowMatrix forcing;              ///< N x m
  RowMatrix q;                    ///< N x 2n
  BoundaryCondition boundary;     ///< E0, ET, b
  bool initial_value = false;     ///< x_0 = boundary.b
  Index divided = 0;              ///< intervals on which f and g enter in pieces

  const GalerkinStep& first_step() const { return runs.front().step; }
  bool uniform() const { return runs.size() == 1; }
  Index states() const { return first_step().E.rows(); }
  Index unknowns() const { return first_step().D.rows(); }  ///< of an interval, 2n
};

/// The step of length h: G_0 to G_4 by matrix_phis (core/numerics/matrix_phi.hpp).
GalerkinStep galerkin_step(SharedDynamics&, const Matrix& M, double h);

/// The boundary condition of a scene; initial values as (I, 0, x0).
BoundaryCondition boundary_of(const Scene&);

/// The scene on N intervals, or on parts of which the last ends at T. f and g are replaced on each interval, or on its
/// pieces (core/galerkin/sources.hpp), by the parabola through three Gauss points. Values at the ends are not used:
/// sources may jump there. Dynamics are converted to dense ones. f and g that are not finite give NaN in `forcing` or
/// `q`.
/// `shared`: of the dynamics of the scene; its phi-functions are kept for other grids.
GalerkinProblem galerkin_problem(const Scene&, const std::vector<GridPart>&, SharedDynamics& shared);
GalerkinProblem galerkin_problem(const Scene&, const std::vector<GridPart>&);
GalerkinProblem galerkin_problem(const Scene&, Index N);

/// The same scene on half as many intervals, from F and q of a uniform grid, without a sample of f and g. With 1 and 2
/// the halves of an interval, F = E F_1 + F_2, q_left = (q_1l + q_1r/2 + p_2l/2)/2, q_right = (q_1r/2 + p_2l/2 +
/// p_2r)/2, p_2 = q_2 + C F_1. Precondition: N even.
GalerkinProblem coarser_problem(const Scene&, const GalerkinProblem&, SharedDynamics& shared);
GalerkinProblem coarser_problem(const Scene&, const GalerkinProblem&);

/// The states for given z and the boundary condition: (N+1) x m. Throws Error if it does not determine them.
RowMatrix galerkin_states(const GalerkinProblem&, const RowMatrix& z);

/// w for z and its x: N x 2n.
RowMatrix galerkin_slack(const GalerkinProblem&, const RowMatrix& z, const RowMatrix& x);

/// q + C x alone: N x 2n.
RowMatrix galerkin_known(const GalerkinProblem&, const RowMatrix& x);

/// max over intervals and components of |min(z, w)|, of |w| for the free rows of the scene, relative to
/// max(1, max |C x + q|); in the units of the user if `units` are given.
double natural_residual(const GalerkinProblem&, const RowMatrix& z, const RowMatrix& x,
                        const std::vector<Index>& free_rows = {}, const NaturalUnits* units = nullptr);

/// The linear part of z -> w, boundary term included: O(N (m + n)^2) operations, nothing assembled.
RowMatrix apply_galerkin(const GalerkinProblem&, const RowMatrix& z);

}  // namespace bromwich
