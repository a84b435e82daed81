#pragma once
// The exact flow of x' = A x + B y + f over a part of a step, with y linear and f quadratic in time:
//
//     y(s) = y_1 (3 - 3σ)/2 + y_2 (3σ - 1)/2,   f(s) = c_0 + c_1 σ + c_2 σ²,   σ = s/d,
//     x(c d) = e^{cdA} x + ∫_0^{cd} e^{(cd-s)A} (B y(s) + f(s)) ds,   c = 1/3 and 1.
//
// y_1 and y_2 are its values at σ = 1/3 and 1, the nodes of Radau IIA: a march in stages has complementarity there.

#include "../base/types.hpp"
#include "../numerics/matrix_phi.hpp"
#include "parts.hpp"

#include <array>
#include <map>

namespace bromwich {

/// ∫_0^{cd} e^{(cd-s)A} σ^k ds, k = 0, 1, 2: m x m each, for c = 1/3 and 1.
using PartInputs = std::array<std::array<Matrix, 3>, 2>;
PartInputs part_inputs(PhiFamily&, double length);

struct PartWeights {
  std::array<Matrix, 2> decay;   ///< m x m, of x
  std::array<Matrix, 2> drive;   ///< m x 2n, of (y_1, y_2)
  PartInputs input;              ///< of c_0, c_1, c_2; empty without f
  std::array<Vector, 2> answer;  ///< n: what y_i moves w_i by, M included
};

/// Weights by length, made when they are asked for. Few lengths: those of a dyadic tree.
class PartWeightsFamily {
 public:
  PartWeightsFamily(Matrix A, Matrix B, Matrix N, Matrix M, bool has_f);
  const PartWeights& of(double length);

 private:
  PhiFamily phis_;
  Matrix B_, N_, M_;
  bool has_f_;
  std::map<double, PartWeights> kept_;
};

}  // namespace bromwich
