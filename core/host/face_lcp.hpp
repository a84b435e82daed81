#pragma once
// The complementarity problem of a marching step on a face, 0 <= y  ⊥  (M + W_0) y + q >= 0, M a stencil and W_0 = S
// diag(w0) S in sine modes:
//
//     y <- sweeps of LCP(M + D I, q + W_0 y - D y),
//
// a few sweeps of projected over-relaxation in two colours for each product with W_0, until y moves by rounding alone.
// With D from w0 the iteration contracts by max_l |w0_l - D| / (M_l + D), 0.03 for typical steps; it begins at the
// extrapolation of the last two solutions. Nothing of size n x n is formed.

#include "../lcp/active_set.hpp"
#include "../lcp/stencil.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich::host {

class FaceLcp {
 public:
  /// out = S in, for n values each.
  using Transform = std::function<void(const double* in, double* out)>;

  /// Nothing where M is no stencil on the grid, M + W_0 is not positive definite, or the iteration contracts slowly.
  static std::unique_ptr<FaceLcp> make(const LcpMatrix& M, const std::vector<Index>& extents, const Vector& w0,
                                       Transform transform);

  void start_from(const Vector& y);
  LcpOutcome solve(const Vector& q, Vector& y);
  std::size_t bytes() const;

 private:
  FaceLcp(const Stencil&, const Vector& w0, const InstantShift&, Transform);
  void relax(int colour);
  void to_padded(const Vector& values, Vector& padded) const;

  /// A line of points of the fastest direction: its first point in padded arrays and in others, and its colour.
  struct Line {
    Index padded, first;
    int colour;
  };

  Index n_, length_;
  Vector w0_;
  double shift_, centre_, omega_;
  std::vector<double> beside_;
  std::vector<Index> strides_;  ///< of padded arrays
  std::vector<Line> lines_;
  Transform transform_;
  Vector y_, q_;  ///< padded by zeros
  Vector last_, before_, now_, right_, modes_;
};

}  // namespace bromwich::host
