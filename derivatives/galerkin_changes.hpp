#pragma once
// Changes of the discrete problem of method galerkin with the data of its scene, and the transposed maps. See
// derivatives/galerkin_derivative.hpp.
//
// Changes of A, B, N and of F in f = F phi are those of one larger problem of the same form. With the states (dx, x),
//
//     A' = [A dA; 0 A],   B' = [dB; B],   N' = [N dN],   F' = [dF; F],
//
// the upper halves of E', H' and F' and the right half of C' are the changes of E, H, F and C, and D' is that of D.
// Gradients with respect to A are the same maps of A^T (Higham, Functions of Matrices, theorem 3.6).
//
// symbol                 variable   shape
// dF_k                   F          N x m, with dE x_{k-1} + dH z_k
// dq_k                   q          N x 2n, with dD z_k + dC x_{k-1}
// db - dE0 x_0 - dET x_N b          m
// dg + dM y + dN x       direct     (N+1) x n, at the time points: the change of w with x and y held

#include "../core/galerkin/discretisation.hpp"

#include <vector>

namespace bromwich {

/// A change of the discrete problem, or what multiplies one.
struct GalerkinChange {
  RowMatrix F, q;
  Vector b;
  RowMatrix direct;
};

/// The sum of the products of all entries.
double product(const GalerkinChange&, const GalerkinChange&);

/// A discrete problem with its solution. `y`: at the right ends, in row 0 at the left end of the first interval.
struct GalerkinState {
  const Scene& scene;  ///< dense, E = I, f = F phi
  const GalerkinProblem& problem;
  const RowMatrix &z, &x, &y;
};

/// The change with A, B, N and F. Empty: no change.
void add_matrix_changes(const GalerkinState&, const Matrix& dA, const Matrix& dB, const Matrix& dN, const Matrix& dF,
                        GalerkinChange& to);

/// The gradients with respect to these. Precondition: no interval has divided sources.
struct MatrixGradients {
  Matrix A, B, N, F;
};
MatrixGradients matrix_gradients(const GalerkinState&, const GalerkinChange& of);

/// f and g of both ends of an interval in F and q, for each run.
struct GalerkinEntry {
  Matrix F[2], q_of_f[2];  ///< m x m, 2n x m
};
std::vector<GalerkinEntry> galerkin_entries(const GalerkinProblem&, SharedDynamics&);

/// The change with f ((N+1) x m) and g ((N+1) x n), linear between the time points, and with M. Empty: no change.
void add_source_changes(const GalerkinState&, const std::vector<GalerkinEntry>&, const RowMatrix& f, const RowMatrix& g,
                        const Matrix& M, GalerkinChange& to);
/// The gradients with respect to these.
struct SourceGradients {
  RowMatrix f, g;
  Matrix M;
};
SourceGradients source_gradients(const GalerkinState&, const std::vector<GalerkinEntry>&, const GalerkinChange& of);

}  // namespace bromwich
