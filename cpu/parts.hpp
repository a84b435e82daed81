#pragma once
// Shared by the files of cpu/: the host array, threads and the makers of plans.

#include "core/base/denormals.hpp"
#include "core/base/error.hpp"
#include "core/seam/backend.hpp"
#include "core/seam/linear_march.hpp"
#include "cpu/team.hpp"

#include <chrono>
#include <memory>

namespace bromwich::cpu {

constexpr Index worth_sharing = 1 << 16;  ///< values that are copied: a hundred microseconds from memory

class HostArray final : public Array {
 public:
  /// Zero-filled. The threads that will use the rows touch them first (first-touch page placement).
  HostArray(Index rows, Index cols, Team& team) : HostArray(RowMatrix(rows, cols)) {
    team.each(rows, values.size() > worth_sharing, [&](Index j) { values.row(j).setZero(); });
  }
  HostArray(Index rows, Index cols) : HostArray(RowMatrix(RowMatrix::Zero(rows, cols))) {}

  RowMatrix values;

 private:
  explicit HostArray(RowMatrix&& made) : Array(made.rows(), made.cols(), made.data()), values(std::move(made)) {}
};

inline const RowMatrix& host(const Array& array) { return static_cast<const HostArray&>(array).values; }
inline RowMatrix& host(Array& array) { return static_cast<HostArray&>(array).values; }

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

/// An orthonormal transform of single vectors, for marching.
class VectorTransform {
 public:
  virtual ~VectorTransform() = default;
  virtual void apply(const double* in, double* out) = 0;         ///< `in` is not changed; no aliasing
  virtual std::unique_ptr<VectorTransform> another() const = 0;  ///< a copy for another thread
};
std::unique_ptr<VectorTransform> make_vector_sine(Index n);
/// Between values at the points of a face and the coefficients of its modes.
std::unique_ptr<VectorTransform> make_vector_transform(const FaceBasis&, Way);
/// The same for rows. A side with sine modes takes `make_sine_transform`.
std::unique_ptr<RowTransform> make_face_transform(const FaceBasis&, Index rows, Way, Team& team);

std::unique_ptr<RowTransform> make_sine_transform(Index n, Index rows, Team& team);
std::unique_ptr<Convolution> make_convolution(const ModalRecurrence&, Index rows, Team& team);
std::unique_ptr<Convolution> make_convolution(const DenseRecurrence&, Index rows, Team& team);
std::unique_ptr<Convolution> make_convolution(const LagTable&, Index rows, Team& team);
std::unique_ptr<LcpBatch> make_tridiagonal_lcp(const Tridiagonal&, LcpClass, double shift, Index rows, Team& team);
std::unique_ptr<LcpBatch> make_dense_lcp(const Matrix&, LcpClass, Index rows, Team& team);
std::unique_ptr<LcpBatch> make_sparse_lcp(const SparseMatrix&, LcpClass, double shift, Index rows, Team& team);
std::unique_ptr<LcpBatch> make_projected_sweeps(const ProjectedSweeps&, Index rows, Team& team);
/// `linear`: empty for complementarity problems.
std::unique_ptr<March> make_march(const MarchProblem&, Index rows, Team& team, const LinearStep& linear = {});
std::unique_ptr<March> make_dense_march(const MarchProblem&, const DenseRecurrence&, Index rows, const LinearStep&);
std::unique_ptr<March> make_lag_march(const MarchProblem&, Index rows, Team& team, const LinearStep&);
void write_product(const RowMatrix& amplitudes, const Matrix& shapes, RowMatrix& to, Team& team);
void inject(const RowMatrix& fine, RowMatrix& coarse, Team& team);
void interpolate(const RowMatrix& coarse, const RowMatrix* old, RowMatrix& fine, Team& team);
void restrict_problem(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                      RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, Team& team);
void take_stages(const RowMatrix& stages, RowMatrix& first, RowMatrix& second, Team& team);
void put_stages(const RowMatrix& first, const RowMatrix& second, RowMatrix& stages, Team& team);
void sweep_stages(const StageDivisors&, const RowMatrix& r, const RowMatrix& v, RowMatrix& y, Team& team);
void restrict_stages(const RowMatrix& r, const RowMatrix& v, const RowMatrix& y, const RowMatrix& coarse_v,
                     RowMatrix& coarse_r, RowMatrix& coarse_y, RowMatrix& old, Team& team);
void add(const RowMatrix& b, double s, const RowMatrix& c, RowMatrix& a, Team& team);
std::unique_ptr<Differences> make_differences(std::size_t slots, Team& team);
bool alternates(const RowMatrix& y, Index run, double part, Team& team);

}  // namespace bromwich::cpu
