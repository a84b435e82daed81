#pragma once
// One time grid of the dual form: V with its split (core/dual/dual_weights.hpp), and s = -V r for the scene's x0, f and
// g, which enter by implicit Euler like y.

#include "../kernel/time_operator.hpp"
#include "dual_weights.hpp"

#include <memory>
#include <optional>

namespace bromwich {

/// K of implicit Euler on the grid of an operator, and the terms of w without y.
class EulerResponse {
 public:
  /// The operator of the grid must outlive it.
  explicit EulerResponse(TimeOperator&);
  /// r <- g + N x of the state without y; row 0 is N x0 + g(0).
  void respond(const Changes&, Array& r);
  /// v <- K y.
  void apply(const Array& y, Array& v);
  std::size_t bytes() const;

 private:
  MarchData& data();
  std::unique_ptr<SpaceTimeKernel> make_kernel();

  TimeOperator& op_;
  const DiscreteProblem& p_;
  std::optional<MarchData> data_;  ///< made when first needed: of coarse grids, for x0 and f only
  std::unique_ptr<SpaceTimeKernel> kernel_;
  bool responded_ = false;
};

/// s <- -V r with V - P delta in `kernel`; `work` has the same shape. Row 0 of s is 0.
void dual_response(Backend&, const LcpMatrix& P, SpaceTimeKernel& kernel, const Array& r, Array& work, Array& s);

/// rows <- rows P^T.
RowMatrix times_rows(const LcpMatrix& P, const RowMatrix& rows);

}  // namespace bromwich
