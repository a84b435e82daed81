#pragma once
// The interface between the mathematics and the machine. A backend owns memory and makes plans (plans.hpp). Each plan
// is one operation on whole space-time arrays, never on one time step.
//
// Required of a backend: arrays, copies to and from the host, three operations on arrays, and five kinds of plans.
// Optional operations are in `fused` (fused_operations.hpp).

#include "../base/threads.hpp"
#include "bromwich/backend.hpp"
#include "fused_operations.hpp"
#include "plans.hpp"
#include "traits.hpp"

#include <memory>
#include <string>

namespace bromwich {

struct DeviceInfo {
  std::string name;
  int threads = 1;
  std::string detail;
  double memory = 0;  ///< bytes free for arrays and plans; 0: they use the memory of the host
};

/// Both ways between the points of a face and its modes. With sine modes they are one plan.
struct FaceTransforms {
  std::shared_ptr<RowTransform> to_modes, to_points;

  bool are_one() const { return to_modes == to_points; }
  std::size_t bytes() const { return to_modes->bytes() + (are_one() ? 0 : to_points->bytes()); }
};

class Backend : public HostThreads {
 public:
  explicit Backend(std::string name, const BackendTraits& traits = {}, int ranks = 1)
      : staged_(stages_by_host(*this)), name_(std::move(name)), traits_(traits), ranks_(ranks) {}

  const std::string& name() const { return name_; }
  virtual DeviceInfo device() const = 0;
  const BackendTraits& traits() const { return traits_; }
  const FusedOperations& fused() const { return fused_; }
  /// That share the time points of its arrays; 1: it has all of them.
  int ranks() const { return ranks_; }

  // ---- Required.

  /// Blocks until all operations called so far have finished.
  virtual void wait() {}
  virtual std::unique_ptr<Array> array(Index rows, Index cols) = 0;
  /// Writes the first from.rows() rows of `to`; the others keep their values.
  virtual void upload(const RowMatrix& from, Array& to) = 0;
  virtual void download(const Array& from, RowMatrix& to) = 0;
  /// Row i of `coarse` <- row R i of `fine`. R = (rows of fine - 1) / (rows of coarse - 1) must be an integer; R = 1
  /// copies.
  virtual void inject(const Array& fine, Array& coarse) = 0;
  /// fine <- fine + I (coarse - old) with linear interpolation I to R times as many steps; fine + I coarse if `old` is
  /// null.
  virtual void interpolate(const Array& coarse, const Array* old, Array& fine) = 0;
  /// a <- b + s c; `a` may be `b` or `c`.
  virtual void add(const Array& b, double s, const Array& c, Array& a) = 0;
  virtual std::unique_ptr<Differences> differences(std::size_t slots) = 0;

  virtual std::unique_ptr<RowTransform> sine_transform(Index n, Index rows) = 0;
  /// The weights are read when the plan is made.
  virtual std::unique_ptr<Convolution> convolution(WeightsRef, Index rows) = 0;
  /// Solves y_j in SOL(M + D I, r_j + v_j - D y_j), with the given y on the right side (core/multigrid/smoothing.hpp).
  /// The class is that of M + D I. D != 0 needs a tridiagonal M.
  virtual std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix&, LcpClass, double D, Index rows) = 0;
  virtual std::unique_ptr<March> march(const MarchProblem&, Index rows) = 0;

  // ---- Made of the required ones, or fused.

  std::unique_ptr<Convolution> convolution(const LagTable& table, Index rows) {
    return convolution(weights_ref(table), rows);
  }
  std::unique_ptr<Convolution> convolution(const Recurrence& recurrence, Index rows) {
    return convolution(weights_ref(recurrence), rows);
  }
  std::unique_ptr<LcpBatch> lcp(const LcpMatrix& M, LcpClass c, Index rows) { return shifted_lcp(M, c, 0, rows); }
  /// Row j of `to` <- shapes a_j, a_j the row j of `amplitudes`. amplitudes: rows x k, shapes: cols x k, k >= 1.
  void upload_product(const RowMatrix& amplitudes, const Matrix& shapes, Array& to);
  /// to <- P X^T for a host table X, stored row by row in `values`. P: k x m, X: n x m, `to`: k x n.
  void upload_projection(const Vector& values, const Array& P, Array& to);
  /// `download`, with `operations` run while the values are copied. They must not change `from`.
  void download_during(const Array& from, RowMatrix& to, const std::function<void()>& operations);
  /// Problem of a coarser grid, with R = injection: coarse_r <- R (r + v) - coarse_v; coarse_y, old <- R y.
  void restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                        Array& coarse_y, Array& old);
  /// Row j of `first`, `second` <- rows 2j - 1 and 2j of `stages`, which has 2J + 1 rows. Row 0 of `first` becomes
  /// zero.
  void take_stages(const Array& stages, Array& first, Array& second) { staged_.take_stages(stages, first, second); }
  /// The reverse; row 0 of `first` is not used.
  void put_stages(const Array& first, const Array& second, Array& stages) { staged_.put_stages(first, second, stages); }
  /// A convolution with two stages in each step on arrays of 2J + 1 rows (StageRecurrence): v_a = Σ_b W_ab * y_b with
  /// W_ab in `parts[a][b]`. Row 0 of y is not used, so that weights of y_0 have to be zero; row 0 of v is that of the
  /// second stage, zero.
  std::unique_ptr<Convolution> stage_convolution(StageWeights parts, Index n, Index rows);
  std::unique_ptr<Convolution> stage_convolution(const StageRecurrence&, Index rows);
  /// A projected sweep for 0 <= y ⊥ r + v >= 0 with two stages in each step, the first before the second:
  ///     y_1 <- max(0, y_1 - q_1/d_11),  y_2 <- max(0, y_2 - (q_2 + d_21 (change of y_1))/d_22),   q = r + v.
  void sweep_stages(const StageDivisors& d, const Array& r, const Array& v, Array& y) {
    staged_.sweep_stages(d, r, v, y);
  }
  /// `restrict_problem` from the stages of the fine grid to the ends of the same steps. Where y is zero at both stages
  /// or at none of them, R q is the mean 3/4 q_1 + 1/4 q_2 of q = r + v; elsewhere it is q_2. A solution stays one
  /// then.
  void restrict_stages(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                       Array& coarse_y, Array& old) {
    staged_.restrict_stages(r, v, y, coarse_v, coarse_r, coarse_y, old);
  }
  /// max_j |a_j - b_j|_inf / max(1, |a_j|_inf); NaN where a value is not finite.
  double difference(const Array& a, const Array& b);
  /// Whether some column alternates over `run` consecutive rows: the second differences change sign from row to row,
  /// and each exceeds `part` times the largest value of the column.
  bool alternates(const Array& y, Index run, double part);
  /// Rows, values at the points of a face or coefficients of its modes, times V or V^T: one product for each direction.
  std::unique_ptr<RowTransform> face_transform(const FaceBasis&, Index rows, Way);
  FaceTransforms face_transforms(const FaceBasis&, Index rows);
  /// A batch of `sweeps`, or, where the backend has none, one that solves its problems (shifted_lcp).
  std::unique_ptr<LcpBatch> projected_sweeps(const ProjectedSweeps& sweeps, LcpClass, Index rows);
  /// A replay of the recorded operations, or empty (FusedOperations::record).
  std::function<void()> record(Index values, const std::function<void()>& operations);

  /// Linear one-step maps on a grid with any step sizes, and their adjoint. Throws Error if the problem is not valid or
  /// the matrix of a step is singular.
  std::unique_ptr<StepChain> step_chain(const StepChainProblem&);
  /// Affine maps along a chain of intervals between two boundary conditions, solved in blocks.
  std::unique_ptr<AffineChain> affine_chain(const AffineChainSizes&);
  /// The shifted solves of a contour (LinearSystem::shifted_solves).
  ComplexMatrix resolvent(const Dynamics&, const ComplexVector& nodes);

 protected:
  FusedOperations fused_;
  StageOperations staged_;

 private:
  std::string name_;
  BackendTraits traits_;
  int ranks_;
};

}  // namespace bromwich
