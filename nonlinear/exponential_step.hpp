#pragma once
// Exponential collocation on one step: x' = A x + F(t) with F linear between nodes,
//
//     x(c_i h) = e^{c_i h A} x_0 + s_i + L_i F_0 + Σ_k W_ik F_k,   s_i = ∫_0^{c_i h} e^{(c_i h - s) A} f(t + s) ds.
//
// rule    unknown nodes c   F linear between        order in x
// linear  1                 0 and 1                 2, continuous y
// radau   1/3, 1            1/3 and 1               2, y may jump from step to step

#include "../core/base/types.hpp"

#include <vector>

namespace bromwich {

enum class StepRule { linear, radau };

struct ExponentialStep {
  std::vector<double> nodes;                 ///< c_i
  std::vector<Matrix> propagators;           ///< e^{c_i h A}
  std::vector<Matrix> left;                  ///< L_i; zero but for `linear`
  std::vector<std::vector<Matrix>> weights;  ///< W_ik
};

ExponentialStep make_exponential_step(const Matrix& A, double h, StepRule);

}  // namespace bromwich
