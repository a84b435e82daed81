#pragma once
// What the files of this room share: the host array, threads and the makers of each plan.

#include "core/base/error.hpp"
#include "core/seam/backend.hpp"

#include <chrono>
#include <memory>
#include <mutex>

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace bromwich::cpu {

class HostArray final : public Array {
 public:
  /// Zero. The threads that will work on the rows touch them first, which spreads the cost of fresh pages.
  HostArray(Index rows, Index cols, int threads = 1) : values(rows, cols) {
#pragma omp parallel for num_threads(threads) schedule(static) if (threads > 1 && values.size() > 1 << 16)
    for (Index j = 0; j < rows; ++j) values.row(j).setZero();
  }
  Index rows() const override { return values.rows(); }
  Index cols() const override { return values.cols(); }

  RowMatrix values;
};

inline const RowMatrix& host(const Array& array) { return static_cast<const HostArray&>(array).values; }
inline RowMatrix& host(Array& array) { return static_cast<HostArray&>(array).values; }

/// Decaying exponentials end in denormal numbers, which cost a hundred cycles each: while this lives, the calling
/// thread treats them as zero.
class FlushDenormals {
 public:
#if defined(__SSE2__)
  FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040); }
  ~FlushDenormals() { _mm_setcsr(saved_); }
#else
  FlushDenormals() {}
#endif
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  [[maybe_unused]] unsigned saved_ = 0;
};

/// FFTW plans are made under one lock; executing them needs none.
std::mutex& fftw_planner();

/// The smallest 2^a 3^b 5^c >= n.
Index fast_fft_length(Index n);

/// product = M y; no aliasing.
inline void multiply(const Tridiagonal& M, const double* y, double* product) {
  const Index n = M.diagonal.size();
  const double *lower = M.lower.data(), *diagonal = M.diagonal.data(), *upper = M.upper.data();
  for (Index i = 0; i < n; ++i) product[i] = diagonal[i] * y[i];
  for (Index i = 1; i < n; ++i) product[i] += lower[i] * y[i - 1];
  for (Index i = 0; i + 1 < n; ++i) product[i] += upper[i] * y[i + 1];
}

/// The orthonormal sine transform of single vectors, for marching.
class VectorSine {
 public:
  virtual ~VectorSine() = default;
  virtual void apply(const double* in, double* out) = 0;    ///< `in` is not changed; no aliasing
  virtual std::unique_ptr<VectorSine> another() const = 0;  ///< for another thread
};
std::unique_ptr<VectorSine> make_vector_sine(Index n);

std::unique_ptr<SineTransform> make_sine_transform(Index n, Index rows, int threads);
std::unique_ptr<Convolution> make_convolution(const ModalRecurrence&, Index rows, int threads);
std::unique_ptr<Convolution> make_convolution(const DenseRecurrence&, Index rows, int threads);
std::unique_ptr<Convolution> make_fft_convolution(const LagTable&, Index rows, int threads);
std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Tridiagonal&, LcpClass, double shift, Index rows, int threads);
std::unique_ptr<LcpBatch> make_dense_lcp(const Matrix&, LcpClass, Index rows, int threads);
std::unique_ptr<March> make_march(const MarchProblem&, Index rows, int threads);
std::unique_ptr<March> make_dense_march(const MarchProblem&, const DenseRecurrence&, Index rows);
std::unique_ptr<March> make_lag_march(const MarchProblem&, Index rows, int threads);
std::unique_ptr<StageMarch> make_stage_march(const StageProblem&, Index rows, int threads);
std::unique_ptr<StepChain> make_step_chain(const StepChainProblem&, int threads);
std::unique_ptr<AffineChain> make_affine_chain(const AffineChainSizes&, int threads);
void write_product(const RowMatrix& amplitudes, const Matrix& shapes, RowMatrix& to, int threads);
void inject(const RowMatrix& fine, RowMatrix& coarse, int threads);
void interpolate(const RowMatrix& coarse, const RowMatrix* old, RowMatrix& fine, int threads);
void restrict_problem(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                      RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, int threads);
void add(const RowMatrix& b, double s, const RowMatrix& c, RowMatrix& a, int threads);
double difference(const RowMatrix& a, const RowMatrix& b, int threads);
bool alternates(const RowMatrix& y, Index run, double part, int threads);
ComplexMatrix resolvent(const Dynamics&, const ComplexVector& nodes, int threads);
ComplexMatrix sparse_resolvent(const SparseDynamics&, const ComplexVector& nodes, int threads);

}  // namespace bromwich::cpu
