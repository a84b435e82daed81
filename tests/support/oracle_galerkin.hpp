#pragma once
// An independent oracle for the discontinuous piecewise-linear Galerkin method in time, for few states. The operator
//
//     (L y)(t) = M y(t) + N x_y(t),   x_y = the state driven by y alone, E0 x_y(0) + ET x_y(T) = 0,
//
// is integrated by Gauss quadrature with matrix exponentials, without phi-functions. The complementarity problem of all
// intervals is one dense matrix, solved by Lemke's method.
//
// Unknowns are ordered by interval, end (left, right), constraint: index (2 k + e) n + i, k = 0..J-1, e = 0, 1.

#include "core/scene/scene.hpp"

#include <optional>

namespace bromwich::oracle {

/// The Galerkin equations divided by h/2: row (k, e, i) is the mean of w_i with the weight (2/h) psi_ke, the hat
/// function of that end of the interval.
struct GalerkinSystem {
  Matrix matrix;            ///< 2 J n x 2 J n
  Vector q;                 ///< 2 J n
  std::vector<Index> free;  ///< the rows of Scene::free_rows, every interval and end
};

/// f and g are integrated over each interval by Gauss quadrature; their kinks must lie on nodes.
GalerkinSystem galerkin_system(const Scene&, Index J);

/// y at both ends of the intervals, J x 2n: left values, then right values. Free rows are eliminated first. Empty if
/// Lemke's method ends on a ray.
std::optional<RowMatrix> galerkin_solution(const GalerkinSystem&, Index J);

/// x(t_j) for such a y, (J+1) x m.
RowMatrix galerkin_states(const Scene&, const RowMatrix& y);

/// max |min(y, w)|, and |w| in free rows, of the system.
double galerkin_residual(const GalerkinSystem&, const RowMatrix& y);

/// Smallest eigenvalue of the symmetric part of L on the piecewise-linear functions, in the L2 norm.
double smallest_galerkin_eigenvalue(const GalerkinSystem&, Index J);

/// Lemke's method with the lexicographic ratio test, on LCP(q, M). Empty on a ray.
std::optional<Vector> lemke(const Matrix& M, const Vector& q);

}  // namespace bromwich::oracle
