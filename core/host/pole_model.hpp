#pragma once
// Linear dynamics known by few real poles. With outputs [N; I] (N x and chosen components of x),
//
//     H(z) = [N; I] (zE - A)^{-1} [B F E x0] ≈ D + Σ_k R_k / (z - s_k),   s_k < 0.
//
// A direction of y whose response has decayed by a time t needs no pole slower than about 1/t. In a basis P of such
// directions, the slowest first, R_k = X_k P_k^T has the first r_k columns of P only. As a state with one number for
// each pole and direction,
//
//     ζ_i' = s_i ζ_i + u_i,   u = (P^T y)_d for row i of direction d, a value of phi, or 0 with ζ_i(0) = 1 (x0),
//     (N x, components) = U ζ + D (y, phi).

#include "../base/types.hpp"

#include <vector>

namespace bromwich {

struct PoleModel {
  Index n = 0, sources = 0, components = 0;  ///< lengths of y and phi, number of components of x
  Index driven = 0, forced = 0;              ///< rows of ζ driven by y come first, then those driven by phi, then x0's
  Vector poles;                              ///< s_i of every row
  std::vector<Index> direction;              ///< of the first driven + forced rows: column of P, or index in phi
  Matrix basis;                              ///< P, n x n, orthonormal
  Matrix output;                             ///< U, (n + components) x rows
  Matrix direct;                             ///< D, (n + components) x (n + sources)
  Index distinct = 0;                        ///< number of different poles
  double error = 0;                          ///< largest at nodes that the fit has not seen, see pole_fit.hpp

  Index rows() const { return poles.size(); }
  std::size_t bytes() const {
    return sizeof(double) * std::size_t(2 * poles.size() + basis.size() + output.size() + direct.size());
  }
};

}  // namespace bromwich
