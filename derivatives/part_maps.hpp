#pragma once
// Exact solution of z' = A z + u(t) over a part of a step, u a polynomial:
//
//     z(L) = e^{LA} z(0) + Σ_k Ψ_k u_k,   Ψ_k = ∫_0^L e^{(L-s)A} P_k(s/L) ds = L Σ_j c_kj j! phi_{j+1}(LA),
//
// P_k the Legendre polynomials shifted to [0, 1] and c_kj their coefficients. The phi-functions come from their series
// at A/2^s and s doublings (Skaflestad & Wright, Appl. Numer. Math. 59, 2009):
//
//     phi_k(2z) = 2^{-k} (phi_0(z) phi_k(z) + Σ_{j=1}^k phi_j(z)/(k-j)!).

#include "../core/base/types.hpp"

#include <vector>

namespace bromwich {

struct PartMaps {
  Matrix decay;                ///< e^{LA}
  std::vector<Matrix> inputs;  ///< Ψ_0, ..., Ψ_7
};

PartMaps part_maps(const Matrix& A, double length);

/// Legendre coefficients on [from, from + width] of [0, 1], from those on [0, 1]: 8 x 8.
Matrix restricted(double from, double width);

}  // namespace bromwich
