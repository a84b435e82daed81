#pragma once
// The seam between the mathematics and the machine. A backend owns memory and prepares *plans*; each plan is one
// operation on whole space-time arrays, never on one time step. Plans own their workspaces, allocate nothing when they
// run, and report their bytes. Operations are done in the order in which they are asked for; on a device they may
// return before they have finished, and what hands something to the host (download, the report of a batch) waits for
// it.
//
// Layout: arrays are row-major, row j = time t_j, J+1 rows. `first` restricts an operation to the rows j >= first; rows
// before it are taken as final (causality makes this exact).

#include "../base/threads.hpp"
#include "../dynamics/dynamics.hpp"
#include "../lcp/matrix.hpp"
#include "lcp_count.hpp"
#include "recurrence.hpp"

#include <algorithm>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

struct StepChainProblem;  // core/seam/step_chain.hpp
class StepChain;
struct AffineChainSizes;  // core/seam/affine_chain.hpp
class AffineChain;

/// Space-time array owned by a backend; zero when made.
class Array {
 public:
  virtual ~Array() = default;
  virtual Index rows() const = 0;
  virtual Index cols() const = 0;
  std::size_t bytes() const { return sizeof(double) * std::size_t(rows()) * std::size_t(cols()); }
};

/// v_j <- r_j + S y_j with the symmetric orthonormal sine matrix S_ik = sqrt(2/(n+1)) sin(pi i k/(n+1)); S S = I.
class SineTransform {
 public:
  virtual ~SineTransform() = default;
  /// out = S in, row by row; with `add`, out = add + S in. `out` must not alias `in`; it may alias `add`.
  virtual void apply(const Array& in, const Array* add, Array& out, Index first) = 0;
  virtual std::size_t bytes() const = 0;
};

/// v_j <- Σ_{d=0}^{j-1} W_d y_{j-d} + S_j y_0 for j >= 1 (plus the part of x0 in a recurrence's `initial`), v_0 = 0.
class Convolution {
 public:
  virtual ~Convolution() = default;
  /// `v` must not alias `y`. Rows of y and v before `first` must be those of the previous call; those of v may be
  /// written again with the same values.
  virtual void apply(const Array& y, Array& v, Index first) = 0;
  /// For a modal recurrence with an `initial`: from now on x0 adds Σ_k D_k E_k^j to row j >= 1, mode by mode, D an
  /// array K x n. False: it stays as it is, and another plan has to be made.
  virtual bool start_from(const Array& /*D*/) { return false; }
  virtual std::size_t bytes() const = 0;
};

struct LcpReport {
  LcpCount count;
  double change = 0;      ///< max over the rows solved of |y_new - y_old|_inf / max(1, |y_new|_inf)
  double magnitude = 0;   ///< max |y_new|
  Index settled = 0;      ///< rows 0..settled-1 are solved and changed by no more than the tolerance given
  Index infeasible = -1;  ///< first row whose problem was proven infeasible, or -1
  bool finite = true;     ///< false: a NaN or an infinity was met
};

/// y_j in SOL(M, r_j + v_j) for all rows j >= first at once, warm-started from the y given. The class decides which
/// solution: the only one (P), the least element (Z).
class LcpBatch {
 public:
  virtual ~LcpBatch() = default;
  virtual LcpReport solve(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) = 0;
  /// `solve` in two parts: what `start` begins, `finish` waits for and completes. Only `start` may be recorded.
  virtual void start(const Array&, const Array&, Array&, Index /*first*/, double /*settle_tolerance*/) {}
  virtual LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) {
    return solve(r, v, y, first, settle_tolerance);
  }
  /// True if `start` is asynchronous: several batches may be in flight before `collect`. False: `finish` does the work.
  virtual bool queues() const { return false; }
  /// If asynchronous: waits, and sums up all that was started since the last report. Rows that were left unsolved keep
  /// the y given; `change` and `settled` are not known.
  virtual LcpReport collect() { return {}; }
  /// Whether the fused kernel transform-solve-transform, `start_in_modes`, is faster here than the three; it is
  /// asynchronous then.
  virtual bool takes_modes() const { return false; }
  /// `start` without a tolerance, with S v in place of v where `v_in_modes`; then y_modes <- S y for the same rows,
  /// unless null. S is a transform of the same backend.
  virtual void start_in_modes(SineTransform& /*S*/, const Array& /*r*/, const Array& /*v*/, bool /*v_in_modes*/,
                              Array& /*y*/, Array* /*y_modes*/, Index /*first*/) {}
  /// max_j ||min(y_j, M y_j + q_j)||_inf / max(1, ||q_j||_inf) with q = r + v (the natural map), without a shift.
  virtual double residual(const Array& r, const Array& v, const Array& y) = 0;
  virtual std::size_t bytes() const = 0;
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

struct MarchReport {
  LcpCount count;
  Index infeasible = -1;   ///< row at which no solution exists, or -1; rows from there on are NaN
  Index stopped = -1;      ///< row at which a problem stayed unsolved or not finite, or -1; rows from there on are NaN
  bool well_posed = true;  ///< the class of the scene or of the matrix of a step determines its solution
  Index jumps = 0;         ///< steps of a StageMarch that were taken by implicit Euler
  bool interrupted = false;
  bool finite = true;
  double lcp_seconds = 0;
};

/// Solves LCP(M + W_0, .) for j = 1..J in order. `y` receives the solution (row 0 must hold y_0), `v` receives
/// v_j = (K * (y + phi))_j including the part of x0 that sits in the recurrence, so that w_j = M y_j + r_j + v_j.
class March {
 public:
  virtual ~March() = default;
  virtual MarchReport run(Array& y, Array& v) = 0;
  /// As for LcpBatch: where it queues, `start` begins a run, and `collect` waits and sums up what was started since it
  /// was last called; `stopped` is 0 where one of the runs failed.
  virtual bool queues() const { return false; }
  virtual void start(Array& /*y*/, Array& /*v*/) {}
  virtual MarchReport collect() { return {}; }
  virtual std::size_t bytes() const = 0;
};

/// y discontinuous from one step to the next, for M that leaves y to the dynamics (M = 0 in the extreme).
///
/// Two stages: the Radau IIA method with nodes c = 1/3, 1, complementarity at both,
///     X_i = x_{j-1} + h Σ_k a_ik (A X_k + B y_k + f_k),   0 <= y_i ⊥ N X_i + M y_i + g_i >= 0,   x_j = X_2,
/// one complex shifted solve a step, since the inverse of (a_ik) has eigenvalues 2 ± i sqrt(2). It is stiffly accurate,
/// so that y has no memory of its own, and algebraically stable, so that passive scenes stay passive. A step in which
/// the state jumps is taken by implicit Euler instead, which puts x_j on the constraint at once; so are
/// all steps where the problem of two stages is neither P nor PSD and that of one stage is. One stage: implicit Euler
/// throughout.
struct StageProblem {
  const Dynamics* dynamics = nullptr;  ///< dense, sparse or supplied
  const LcpMatrix* M = nullptr;
  LcpClass lcp_class = LcpClass::unknown;
  Index stages = 2;               ///< 2 or 1
  double h = 0;                   ///< step
  std::vector<double> lengths;    ///< of the step to row j, at j - 1; empty: all are h
  Vector x0;                      ///< m
  const Array* g = nullptr;       ///< (J+1) x (stages n): row j holds g at the stages of the step to t_j; row 0 is g(0)
  const Array* phi = nullptr;     ///< (J+1) x (stages k): the same of phi with f = F phi; or null
  SparseMatrix F;                 ///< m x k
  std::vector<Index> components;  ///< of the state, to be recorded
  std::function<bool()> interrupted;         ///< polled now and then; true ends the march
  std::function<void(Index step)> progress;  ///< called now and then
};

/// y receives the values at the right ends (row 0 must hold y_0, or NaN where there is none: it then becomes the value
/// at the first stage), impulse the integrals of y over the steps (row 0 is zero), v = N x_j, x the components asked
/// for.
class StageMarch {
 public:
  virtual ~StageMarch() = default;
  virtual MarchReport run(Array& y, Array& impulse, Array& v, Array& x) = 0;
  virtual std::size_t bytes() const = 0;
};

struct DeviceInfo {
  std::string name;
  int threads = 1;
  std::string detail;
  double memory = 0;  ///< bytes free for arrays and plans; 0: they lie in the memory of the machine
};

/// Operations that were recorded, to be run again and again.
class Program {
 public:
  virtual ~Program() = default;
  virtual void run() = 0;
};

class Backend;

/// Differences of arrays (Backend::difference) that are begun now and looked at later. This one is done at once.
class Differences {
 public:
  Differences(Backend& backend, std::size_t slots) : values_(slots, 0), backend_(backend) {}
  virtual ~Differences() = default;
  Differences(const Differences&) = delete;
  Differences& operator=(const Differences&) = delete;

  /// Begins difference(a, b), to be the value of this slot.
  virtual void start(std::size_t slot, const Array& a, const Array& b);
  /// The values of all slots, 0 where nothing was begun; waits for them.
  virtual const std::vector<double>& collect() { return values_; }

 protected:
  std::vector<double> values_;

 private:
  Backend& backend_;
};

class Backend : public HostThreads {
 public:
  ~Backend() override = default;

  virtual std::string name() const = 0;
  virtual DeviceInfo device() const = 0;

  /// Blocks until all queued operations have completed.
  virtual void wait() {}

  /// Records operations for replay; nothing is done yet. Their arrays and plans have to outlive the program. Null where
  /// replay gains nothing: the arrays (`values` numbers each) are so large that launch overhead is negligible, or the
  /// backend has none.
  virtual std::unique_ptr<Program> record(Index values, const std::function<void()>& operations) {
    (void)values, (void)operations;
    return nullptr;
  }

  virtual std::unique_ptr<Array> array(Index rows, Index cols) = 0;
  /// The first rows of `to`, as many as `from` has; the others stay as they are.
  virtual void upload(const RowMatrix& from, Array& to) = 0;
  /// Row j <- shapes a_j for the rows a_j of `amplitudes`: rows x k, cols x k, k >= 1.
  virtual void upload_product(const RowMatrix& amplitudes, const Matrix& shapes, Array& to) {
    upload(amplitudes * shapes.transpose(), to);
  }
  /// to <- P X^T for a table X of the host whose rows lie one after another in `values`: P is k x m, X n x m, `to` k x
  /// n.
  virtual void upload_projection(const Vector& values, const Array& P, Array& to);
  virtual void download(const Array& from, RowMatrix& to) = 0;
  /// The same, and `operations`, which leave `from` as it is, while the values are on their way.
  virtual void download_during(const Array& from, RowMatrix& to, const std::function<void()>& operations) {
    download(from, to);
    operations();
  }
  /// Sizes `to` for a later download and writes NaN: the first touch of fresh memory costs more than a copy, and
  /// needs no device.
  virtual void prepare(RowMatrix& to, Index rows, Index cols) {
    to.setConstant(rows, cols, std::numeric_limits<double>::quiet_NaN());
  }

  /// Row i of `coarse` <- row R i of `fine`, R = (rows of fine - 1) / (rows of coarse - 1) a whole number; R = 1
  /// copies.
  virtual void inject(const Array& fine, Array& coarse) = 0;
  /// fine <- fine + I (coarse - old), I the linear interpolation to R times as many steps; without `old`, fine + I
  /// coarse.
  virtual void interpolate(const Array& coarse, const Array* old, Array& fine) = 0;
  /// The problem of a coarser grid, with R what `inject` takes: coarse_r <- R (r + v) - coarse_v, and coarse_y, old <-
  /// R y.
  virtual void restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                                Array& coarse_y, Array& old) = 0;
  /// a <- b + s c; `a` may be `b` or `c`.
  virtual void add(const Array& b, double s, const Array& c, Array& a) = 0;
  /// max_j |a_j - b_j|_inf / max(1, |a_j|_inf), the measure of LcpReport::change; NaN where a value is not finite.
  virtual double difference(const Array& a, const Array& b) = 0;
  virtual std::unique_ptr<Differences> differences(std::size_t slots) {
    return std::make_unique<Differences>(*this, slots);
  }
  /// Whether some column alternates over `run` consecutive rows: the second difference of each is larger than `part`
  /// times the largest value of the column, and of the sign that the row before has not.
  virtual bool alternates(const Array& y, Index run, double part) = 0;

  virtual std::unique_ptr<SineTransform> sine_transform(Index n, Index rows) = 0;
  virtual std::unique_ptr<Convolution> convolution(const Recurrence&, Index rows) = 0;
  virtual std::unique_ptr<Convolution> convolution(const LagTable&, Index rows) = 0;
  std::unique_ptr<LcpBatch> lcp(const LcpMatrix& M, LcpClass c, Index rows) { return shifted_lcp(M, c, 0, rows); }
  /// y_j in SOL(M + D I, r_j + v_j - D y_j) with the y given on the right (core/multigrid/smoothing.hpp), the class
  /// being that of M + D I. D other than 0: tridiagonal M.
  virtual std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix&, LcpClass, double D, Index rows) = 0;
  virtual std::unique_ptr<March> march(const MarchProblem&, Index rows) = 0;
  virtual std::unique_ptr<StageMarch> stage_march(const StageProblem&, Index rows) = 0;
  /// Linear one-step maps on a grid of any step sizes and their adjoint. Throws Error where the problem is not valid or
  /// the matrix of a step is singular.
  virtual std::unique_ptr<StepChain> step_chain(const StepChainProblem&) = 0;
  /// Affine maps along a chain of intervals, solved in blocks between two ends.
  virtual std::unique_ptr<AffineChain> affine_chain(const AffineChainSizes&) = 0;

  /// The shifted solves of the contour: N (z_p E - A)^{-1} B for all nodes at once. Row p holds the n modal values
  /// (Kronecker sum) or the n x k entries of the block, row by row (others; N and B may have any shape that fits
  /// A). Sparse: one symbolic analysis, the nodes in parallel. Throws Error where a node is an eigenvalue.
  virtual ComplexMatrix resolvent(const Dynamics&, const ComplexVector& nodes) = 0;
};

inline void Differences::start(std::size_t slot, const Array& a, const Array& b) {
  values_[slot] = backend_.difference(a, b);
}

}  // namespace bromwich
