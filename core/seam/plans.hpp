#pragma once
// Plans: operations on whole arrays, prepared by a backend. A plan owns its workspace, allocates nothing when it runs,
// and reports its bytes. Operations take effect in the order in which they are called. On a device they may return
// before they have finished; whatever hands a value to the host waits for it.
//
// `first` restricts an operation to the rows j >= first. Rows before it are final (causality makes this exact).
//
// Complementarity problems are submitted and then either finished or collected. A backend that computes at once does
// all of it in `submit`.

#include "../base/plan.hpp"
#include "../lcp/lcp_class.hpp"
#include "../lcp/march_report.hpp"
#include "../lcp/matrix.hpp"
#include "array.hpp"
#include "recurrence.hpp"

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

/// v_j <- r_j + S y_j with the symmetric orthonormal sine matrix S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)); S S = I.
class SineTransform : public Plan {
 public:
  /// out = S in, row by row; with `add`, out = add + S in. `out` must not alias `in`; it may alias `add`.
  virtual void apply(const Array& in, const Array* add, Array& out, Index first) = 0;
};

/// v_j <- Σ_{d=0}^{j-1} W_d y_{j-d} + S_j y_0 for j >= 1 (plus the part of x0 in a recurrence's `initial`), v_0 = 0.
class Convolution : public Plan {
 public:
  /// `v` must not alias `y`. Rows of y and v before `first` must be those of the previous call; those of v may be
  /// written again with the same values.
  virtual void apply(const Array& y, Array& v, Index first) = 0;

  /// Optional, for a modal recurrence with an `initial`: from now on x0 adds Σ_k D_k E_k^j to row j >= 1, mode by mode,
  /// D an array K x n. Empty: another x0 needs another plan.
  std::function<void(const Array& D)> start_from;
};

struct LcpReport {
  LcpCount count;
  double change = 0;      ///< max over the rows solved of |y_new - y_old|_inf / max(1, |y_new|_inf)
  double magnitude = 0;   ///< max |y_new|
  Index settled = 0;      ///< rows 0..settled-1 are solved and changed by no more than the tolerance given
  Index infeasible = -1;  ///< first row whose problem was proven infeasible, or -1
  bool finite = true;     ///< false: a NaN or an infinity was met

  /// Counts and bounds of another batch.
  void add(const LcpReport& other) {
    count += other.count;
    magnitude = std::max(magnitude, other.magnitude);
    finite = finite && other.finite;
  }
};

/// y_j in SOL(M, r_j + v_j) for all rows j >= first at once, warm-started from the y given. The class decides which
/// solution: the only one (P), the least element (Z).
class LcpBatch : public Plan {
 public:
  /// `at_once`: `submit` has finished the work when it returns, and cannot be recorded.
  explicit LcpBatch(bool at_once) : at_once(at_once) {}

  /// Begins a batch. A tolerance >= 0 needs a `finish` for this batch; a negative one leaves it to `collect`.
  virtual void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;
  /// Waits for the batch that was submitted last with these arguments, and solves on the host what it left unsolved.
  virtual LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;
  /// Waits for all batches submitted since the last report, and sums up their counts. Rows left unsolved keep the y
  /// given. `change` and `settled` are not known.
  virtual LcpReport collect() = 0;
  /// max_j ||min(y_j, M y_j + q_j)||_inf / max(1, ||q_j||_inf) with q = r + v (the natural map), without a shift.
  virtual double residual(const Array& r, const Array& v, const Array& y) = 0;

  LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance = 0) {
    submit(r, v, y, first, settle_tolerance);
    return finish(r, v, y, first, settle_tolerance);
  }

  /// Optional. `submit` without a tolerance, with S v in place of v where `v_in_modes`; then y_modes <- S y for the
  /// same rows, unless null. S is a transform of the same backend. Empty where transform, batch, transform is faster.
  std::function<void(SineTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                     Index first)>
      submit_in_modes;

  const bool at_once;
};

/// A batch that `submit` solves.
class ImmediateLcpBatch : public LcpBatch {
 public:
  ImmediateLcpBatch() : LcpBatch(true) {}
  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) final {
    last_ = solve_now(r, v, y, first, settle_tolerance);
    all_.add(last_);
  }
  LcpReport finish(const Array&, const Array&, Array&, Index, double) final {
    all_ = {};
    return last_;
  }
  LcpReport collect() final { return std::exchange(all_, {}); }

 protected:
  virtual LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;

 private:
  LcpReport last_, all_;
};

/// Everything a step-by-step solution of the discrete problem needs: the convolution as a recurrence or, where there is
/// none, as lag weights. What it points to has to outlive the plan. The weights are read when the plan is made; r,
/// drive, start, forcing, sources and what x0 adds to a recurrence are read anew by every run.
struct MarchProblem {
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  const Recurrence* recurrence = nullptr;
  const LagTable* lags = nullptr;  ///< instead of a recurrence: n x n weights, applied in blocks of time
  /// (J+1) x n: what does not depend on y and is not in the recurrence's state.
  const Array* r = nullptr;
  const Array* drive = nullptr;    ///< modal: (J+1) x n, phi with f = B phi, added to y where it drives the state
  const Vector* start = nullptr;   ///< dense: m, what x0 and f_0 add to z_0
  const Array* forcing = nullptr;  ///< dense: (J+1) x m, what f adds to z_j, j >= 1
  /// dense, beside `forcing` where they have few columns: (J+1) x k and m x k, forcing_j = source_input sources_j.
  const RowMatrix* sources = nullptr;
  const Matrix* source_input = nullptr;
  std::function<bool()> interrupted;         ///< polled now and then; true ends the march
  std::function<void(Index step)> progress;  ///< called now and then
};

/// Solves LCP(M + W_0, .) for j = 1..J in order. `y` receives the solution (row 0 must hold y_0), `v` receives
/// v_j = (K * (y + phi))_j including the part of x0 that sits in the recurrence, so that w_j = M y_j + r_j + v_j.
class March : public Plan {
 public:
  /// As for LcpBatch.
  explicit March(bool at_once) : at_once(at_once) {}

  /// Begins a run that `collect` reports.
  virtual void submit(Array& y, Array& v) = 0;
  /// Waits, and sums up the runs submitted since the last report; `stopped` is 0 where one of them failed.
  virtual MarchReport collect() = 0;
  /// A whole run. What a device leaves unsolved is solved on the host.
  virtual MarchReport run(Array& y, Array& v) = 0;

  const bool at_once;
};

/// A march that runs when it is submitted.
class ImmediateMarch : public March {
 public:
  ImmediateMarch() : March(true) {}
  void submit(Array& y, Array& v) final {
    const MarchReport report = run(y, v);
    sum_.count += report.count;
    if (report.stopped >= 0) sum_.stopped = 0;
  }
  MarchReport collect() final { return std::exchange(sum_, {}); }

 private:
  MarchReport sum_;
};

/// max_j |a_j - b_j|_inf / max(1, |a_j|_inf) of pairs of arrays, the measure of LcpReport::change. They are submitted
/// and collected as batches are.
class Differences : public Plan {
 public:
  /// Begins the difference of a and b, to be the value of this slot.
  virtual void submit(std::size_t slot, const Array& a, const Array& b) = 0;
  /// The values of all slots: 0 where nothing was submitted, NaN where a value is not finite.
  virtual const std::vector<double>& collect() = 0;
};

}  // namespace bromwich
