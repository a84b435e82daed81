#pragma once
// The seam between the mathematics and the machine. A backend owns memory and prepares plans (plans.hpp); each plan is
// one operation on whole space-time arrays, never on one time step.
//
// Required of a backend: arrays, the copies between them and the host, four operations on arrays, and six plans. What
// else it can do is in `fused` (fused_operations.hpp).

#include "../base/threads.hpp"
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
  double memory = 0;  ///< bytes free for arrays and plans; 0: they lie in the memory of the machine
};

class Backend : public HostThreads {
 public:
  explicit Backend(std::string name, const BackendTraits& traits = {}) : name_(std::move(name)), traits_(traits) {}

  const std::string& name() const { return name_; }
  virtual DeviceInfo device() const = 0;
  const BackendTraits& traits() const { return traits_; }
  const FusedOperations& fused() const { return fused_; }

  // ---- Required.

  /// Blocks until all operations called so far have finished.
  virtual void wait() {}
  virtual std::unique_ptr<Array> array(Index rows, Index cols) = 0;
  /// The first rows of `to`, as many as `from` has; the others stay as they are.
  virtual void upload(const RowMatrix& from, Array& to) = 0;
  virtual void download(const Array& from, RowMatrix& to) = 0;
  /// Row i of `coarse` <- row R i of `fine`, R = (rows of fine - 1) / (rows of coarse - 1) a whole number; R = 1
  /// copies.
  virtual void inject(const Array& fine, Array& coarse) = 0;
  /// fine <- fine + I (coarse - old), I the linear interpolation to R times as many steps; without `old`, fine + I
  /// coarse.
  virtual void interpolate(const Array& coarse, const Array* old, Array& fine) = 0;
  /// a <- b + s c; `a` may be `b` or `c`.
  virtual void add(const Array& b, double s, const Array& c, Array& a) = 0;
  virtual std::unique_ptr<Differences> differences(std::size_t slots) = 0;

  virtual std::unique_ptr<SineTransform> sine_transform(Index n, Index rows) = 0;
  /// The weights are read when the plan is made.
  virtual std::unique_ptr<Convolution> convolution(WeightsRef, Index rows) = 0;
  /// y_j in SOL(M + D I, r_j + v_j - D y_j) with the y given on the right (core/multigrid/smoothing.hpp), the class
  /// being that of M + D I. D other than 0: tridiagonal M.
  virtual std::unique_ptr<LcpBatch> shifted_lcp(const LcpMatrix&, LcpClass, double D, Index rows) = 0;
  virtual std::unique_ptr<March> march(const MarchProblem&, Index rows) = 0;

  // ---- From the required ones, or fused.

  std::unique_ptr<Convolution> convolution(const LagTable& table, Index rows) {
    return convolution(weights_ref(table), rows);
  }
  std::unique_ptr<Convolution> convolution(const Recurrence& recurrence, Index rows) {
    return convolution(weights_ref(recurrence), rows);
  }
  std::unique_ptr<LcpBatch> lcp(const LcpMatrix& M, LcpClass c, Index rows) { return shifted_lcp(M, c, 0, rows); }
  /// Row j <- shapes a_j for the rows a_j of `amplitudes`: rows x k, cols x k, k >= 1.
  void upload_product(const RowMatrix& amplitudes, const Matrix& shapes, Array& to);
  /// to <- P X^T for a table X of the host whose rows lie one after another in `values`: P is k x m, X n x m, `to` k x
  /// n.
  void upload_projection(const Vector& values, const Array& P, Array& to);
  /// `download`, and `operations`, which leave `from` as it is, while the values are on their way.
  void download_during(const Array& from, RowMatrix& to, const std::function<void()>& operations);
  /// Sizes `to` for a later download and writes NaN: the first touch of fresh memory costs more than a copy, and
  /// needs no device.
  void prepare(RowMatrix& to, Index rows, Index cols) const;
  /// The problem of a coarser grid, with R what `inject` takes: coarse_r <- R (r + v) - coarse_v, and coarse_y, old <-
  /// R y.
  void restrict_problem(const Array& r, const Array& v, const Array& y, const Array& coarse_v, Array& coarse_r,
                        Array& coarse_y, Array& old);
  /// max_j |a_j - b_j|_inf / max(1, |a_j|_inf); NaN where a value is not finite.
  double difference(const Array& a, const Array& b);
  /// Whether some column alternates over `run` consecutive rows: the second difference of each is larger than `part`
  /// times the largest value of the column, and of the sign that the row before has not.
  bool alternates(const Array& y, Index run, double part);
  /// The operations recorded, or empty (FusedOperations::record).
  std::function<void()> record(Index values, const std::function<void()>& operations);

  /// Linear one-step maps on a grid of any step sizes and their adjoint. Throws Error where the problem is not valid or
  /// the matrix of a step is singular.
  std::unique_ptr<StepChain> step_chain(const StepChainProblem&);
  /// Affine maps along a chain of intervals, solved in blocks between two ends.
  std::unique_ptr<AffineChain> affine_chain(const AffineChainSizes&);
  /// The shifted solves of a contour (core/host/shifted_solves.hpp).
  ComplexMatrix resolvent(const Dynamics&, const ComplexVector& nodes);

 protected:
  FusedOperations fused_;

 private:
  std::string name_;
  BackendTraits traits_;
};

}  // namespace bromwich
