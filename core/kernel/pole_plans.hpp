#pragma once
// Plans for weights given by few poles, on the host with any threads, for any backend. A convolution takes J n (n + r)
// multiplications for r rows of the state, two products of matrices for every block of time points; no table over lags
// exists.

#include "../seam/backend.hpp"

#include <memory>

namespace bromwich {

/// h phi2 and h (phi1 - phi2) of the rows of a model, and e^{hs}.
struct PoleFactors {
  Eigen::ArrayXd decay, before, behind;
};
PoleFactors pole_factors(const PoleModel&, double h);

/// W_0 = D + U h phi2(hs) P^T of the constraints, n x n.
Matrix implicit_part(const PoleRecurrence&);
/// W^(-1) = Σ_d W_d (-1)^d.
Matrix at_minus_one(const PoleRecurrence&);

/// U_c ζ + D_c y for all time points, c the components of the model: rows x c.
RowMatrix seen_components(const HostThreads&, const PoleRecurrence&, const RowMatrix& y);
/// K^T u of the constraints, rows as u (core/kernel/transposed_kernel.hpp). The adjoint state runs backwards in time,
///     a_j = e^{hs} a_{j+1} + U^T u_j,   (K^T u)_j = D^T u_j + P (h phi2(hs) a_j + h (phi1 - phi2)(hs) a_{j+1}).
RowMatrix transposed_convolution(const HostThreads&, const PoleRecurrence&, const RowMatrix& u);
/// The contributions of phi and x0 to constraints and components, (J+1) x (n + c); row 0 is zero. phi: J+1 rows or
/// empty. If the sources enter through y (model without sources), phi is n wide.
RowMatrix free_response(const HostThreads&, const PoleRecurrence&, const RowMatrix& phi, Index rows);

std::unique_ptr<Convolution> make_pole_convolution(Backend&, const PoleRecurrence&, Index rows);

/// The convolution of either form of weights.
std::unique_ptr<March> make_march(Backend&, const MarchProblem&, const Weights&, Index rows);

}  // namespace bromwich
