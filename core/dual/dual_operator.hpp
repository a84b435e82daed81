#pragma once
// One time grid of the dual form: V with its split (core/dual/dual_weights.hpp), and s = -V r for the scene's x0, f and
// g, which enter by implicit Euler like y.

#include "../kernel/time_operator.hpp"
#include "dual_weights.hpp"

#include <memory>
#include <optional>

namespace bromwich {

/// K on the grid of an operator by the rule of its cycles, and the terms of w without y. With two stages arrays have
/// 2J + 1 rows.
class DualResponse {
 public:
  virtual ~DualResponse() = default;
  /// r <- g + N x of the state without y; row 0 is N x0 + g(0).
  virtual void respond(const Changes&, Array& r) = 0;
  /// Begins the preparation of `apply`, in another thread if the backend has several; `apply` waits for it.
  virtual void prepare() {}
  /// v <- K y.
  virtual void apply(const Array& y, Array& v) = 0;
  virtual std::size_t bytes() const = 0;
};

/// The operator of the grid must outlive it.
std::unique_ptr<DualResponse> make_dual_response(TimeOperator&, Index stages);

/// With at most this many states, all of them are recorded.
inline constexpr Index most_recorded_by_dual = 64;

/// F, m x k, with f = F phi for the values phi of the scene's source.
SparseMatrix entry_of_sources(const Scene&);
/// A source at both stages of Radau IIA: row j holds the values at t_{j-1} + h/3 and at t_j, those of `at_ends`.
RowMatrix stage_values(const DiscreteProblem&, const TimeFunction&, const SampledSource& at_ends);

/// Components of the state at the ends of the steps, (J+1) x components, from y at the stages: 2J + 1 rows of two
/// stages, J + 1 of one.
RowMatrix stage_states(const DiscreteProblem&, Index stages, const RowMatrix& y, const std::vector<Index>& components);

/// Implicit Euler for dense dynamics and Kronecker sums.
class EulerResponse final : public DualResponse {
 public:
  explicit EulerResponse(TimeOperator&);
  void respond(const Changes&, Array& r) override;
  void apply(const Array& y, Array& v) override;
  std::size_t bytes() const override;

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
