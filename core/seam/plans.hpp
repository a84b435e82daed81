#pragma once
// Plans: operations on whole arrays, prepared by a backend. A plan owns its workspace, allocates nothing when it runs,
// and reports its bytes. Operations take effect in the order of the calls. On a device a call may return before its
// operation has finished; calls that return values to the host wait.
//
// `first` restricts an operation to the rows j >= first. Earlier rows are final; this is exact by causality.
//
// Batches, marches and differences are submitted, then finished or collected. A backend that computes at once does all
// the work in `submit`.

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

/// An orthonormal matrix applied to rows. Sine transforms have S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)), S = S^T =
/// S^{-1}.
class RowTransform : public Plan {
 public:
  /// out = S in, row by row; with `add`, out = add + S in. `out` must not alias `in`; it may alias `add`.
  virtual void apply(const Array& in, const Array* add, Array& out, Index first) = 0;
};

/// v_j <- Σ_{d=0}^{j-1} W_d y_{j-d} + S_j y_0 for j >= 1, plus the part of x0 in a recurrence's `initial`; v_0 = 0.
class Convolution : public Plan {
 public:
  /// `v` must not alias `y`. Rows of y and v before `first` must be those of the previous call. The same values may be
  /// written to those rows of v again.
  virtual void apply(const Array& y, Array& v, Index first) = 0;
  /// Whether Backend::record can take it.
  virtual bool recorded() const { return true; }

  /// Optional, for a modal recurrence with an `initial`: from now on x0 contributes Σ_k D_k E_k^j to row j >= 1 of each
  /// mode, D: K x n. Empty: another x0 needs another plan.
  std::function<void(const Array& D)> start_from;

  /// Optional, for a modal recurrence: from now on z_0 = G0 y_0 + z in the modes for which this returns true, z: K x n
  /// values. The others leave z out. Then apply(y, v, first) keeps what was added to rows of v before `first` in the
  /// modes that leave z out.
  std::function<const std::vector<bool>&(const Vector& z)> begin_with;
};

struct LcpReport {
  LcpCount count;
  double change = 0;      ///< max |y_new - y_old|_inf / max(1, |y_new|_inf) over the solved rows
  double magnitude = 0;   ///< max |y_new|
  Index settled = 0;      ///< rows 0..settled-1 are solved and changed by at most the tolerance
  Index infeasible = -1;  ///< first row whose problem is proven infeasible, or -1
  bool finite = true;     ///< false: a NaN or an infinity occurred

  /// Adds the counts and bounds of another batch.
  void add(const LcpReport& other) {
    count += other.count;
    magnitude = std::max(magnitude, other.magnitude);
    finite = finite && other.finite;
  }
};

/// y_j in SOL(M, r_j + v_j) for all rows j >= first at once, warm-started from the given y. The class selects the
/// solution: the unique one (P), the least element (Z).
class LcpBatch : public Plan {
 public:
  /// `at_once`: `submit` returns after the work is finished. `recorded`: Backend::record can take it.
  LcpBatch(bool at_once, bool recorded) : at_once(at_once), recorded(recorded) {}
  explicit LcpBatch(bool at_once) : LcpBatch(at_once, !at_once) {}

  /// Begins a batch. With a tolerance >= 0, `finish` must follow for this batch; a negative one leaves it to `collect`.
  virtual void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;
  /// Waits for the last batch submitted with these arguments, and solves its unsolved rows on the host.
  virtual LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;
  /// Waits for all batches submitted since the last report and sums up their counts. Unsolved rows keep the given y.
  /// `change` and `settled` are not set.
  virtual LcpReport collect() = 0;
  /// Natural map max_j ||min(y_j, M y_j + q_j)||_inf / max(1, ||q_j||_inf), q = r + v, without the shift.
  virtual double residual(const Array& r, const Array& v, const Array& y) = 0;

  LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance = 0) {
    submit(r, v, y, first, settle_tolerance);
    return finish(r, v, y, first, settle_tolerance);
  }

  /// Optional: `submit` without a tolerance, with S v in place of v if `v_in_modes`; then y_modes <- S y for the same
  /// rows if not null. S is a sine transform of this backend. Empty where transform, batch, transform is faster.
  std::function<void(RowTransform& S, const Array& r, const Array& v, bool v_in_modes, Array& y, Array* y_modes,
                     Index first)>
      submit_in_modes;

  const bool at_once, recorded;
};

/// A batch whose `submit` does all the work.
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

/// A batch that makes a fixed number of sweeps of projected successive over-relaxation instead of solving its problems.
/// y <- sweeps(y) for LCP(M + D I, r + v - D y), with the given y on the right side and as the first iterate. Its fixed
/// points are the solutions, whatever D. Batches report no unsolved rows.
struct ProjectedSweeps {
  const SparseMatrix* M = nullptr;  ///< M + D I: positive diagonal, symmetric positive definite or H+
  double shift = 0;                 ///< D
  double omega = 1;
  int count = 2;
  std::vector<Index> face;  ///< extents of the grid of the unknowns, if M is the same stencil at all of its points
};

/// Data of a march: the convolution as a recurrence or as lag weights. Everything pointed to must outlive the plan.
/// Weights are read when the plan is made. r, drive, start, forcing, sources and the recurrence's `initial` are read
/// anew by every run.
struct MarchProblem {
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  const Recurrence* recurrence = nullptr;
  const LagTable* lags = nullptr;  ///< instead of a recurrence: n x n weights, applied in blocks of time
  /// (J+1) x n: the part that does not depend on y and is not in the recurrence's state.
  const Array* r = nullptr;
  const Array* drive = nullptr;    ///< modal: (J+1) x n, phi with f = B phi, an input of the state beside y
  const Vector* start = nullptr;   ///< dense: m, contribution of x0 and f_0 to z_0
  const Array* forcing = nullptr;  ///< dense: (J+1) x m, contribution of f to z_j, j >= 1
  /// dense, beside `forcing` if they have few columns: (J+1) x k and m x k, forcing_j = source_input sources_j.
  const RowMatrix* sources = nullptr;
  const Matrix* source_input = nullptr;
  std::function<bool()> interrupted;         ///< polled from time to time; true ends the march
  std::function<void(Index step)> progress;  ///< called from time to time
};

/// Solves LCP(M + W_0, .) for j = 1..J in order. `y` receives the solution; its row 0 must hold y_0. `v` receives
/// v_j = (K * (y + phi))_j, including the part of x0 in the recurrence, so that w_j = M y_j + r_j + v_j.
class March : public Plan {
 public:
  /// `at_once`: as for LcpBatch.
  explicit March(bool at_once) : at_once(at_once) {}

  /// Begins a run; `collect` reports it.
  virtual void submit(Array& y, Array& v) = 0;
  /// Waits, and sums up the runs submitted since the last report; `stopped` is 0 if one of them failed.
  virtual MarchReport collect() = 0;
  /// A whole run. Steps that a device leaves unsolved are solved on the host.
  virtual MarchReport run(Array& y, Array& v) = 0;

  const bool at_once;
};

/// A march whose `submit` does all the work.
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

/// max_j |a_j - b_j|_inf / max(1, |a_j|_inf) of pairs of arrays, the measure of LcpReport::change. Submitted and
/// collected like batches.
class Differences : public Plan {
 public:
  /// Begins the difference of a and b; its value goes to `slot`.
  virtual void submit(std::size_t slot, const Array& a, const Array& b) = 0;
  /// The values of all slots: 0 where nothing was submitted, NaN where a value is not finite.
  virtual const std::vector<double>& collect() = 0;
};

}  // namespace bromwich
