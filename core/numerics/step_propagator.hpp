#pragma once
// x' = A x + c0 + c1 s/d + c2 (s/d)^2 over any part d <= h of a step of a dense scene, for several columns at once.
//
// For |A| d <= 1 the Taylor series of x is used, from products of A with vectors. Longer parts begin with pieces of
// h/2^k with phi-functions of their own, which are accurate for stiff A; their matrices are computed on first use.

#include "../base/types.hpp"

#include <array>
#include <optional>
#include <vector>

namespace bromwich {

/// Columns of an input that is a polynomial of degree 2 in s/d, 0 <= s <= d.
struct QuadraticInput {
  Matrix c0, c1, c2;  ///< m x columns
};

class StepPropagator {
 public:
  StepPropagator(const Matrix& A, double h);

  /// X <- e^{dA} X + ∫_0^d e^{(d-s)A} u(s) ds, 0 < d <= h.
  void advance(double d, const QuadraticInput& u, Matrix& X);

 private:
  struct Level {
    double length;
    Matrix decay, constant, linear, quadratic;
  };
  const Level& level(std::size_t k);
  void expand(double d, const QuadraticInput& u, Matrix& X);

  const Matrix& A_;
  double h_, norm_;
  std::vector<std::optional<Level>> levels_;
  Matrix term_, sum_;
};

}  // namespace bromwich
