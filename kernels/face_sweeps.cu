// Sweeps of projected over-relaxation in two colours for complementarity problems on a face, M the same five-point
// stencil at all points of a grid (core/seam/plans.hpp, ProjectedSweeps).

#include "core/lcp/stencil.hpp"
#include "kernels/lcp_batch.hpp"
#include "kernels/parts.hpp"
#include "kernels/sweep_face.cuh"

#include "core/base/error.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr const char* starting = "starting the sweeps of a face";

// The change of a whole batch, for its report.
__global__ void __launch_bounds__(256)
    compare_rows(const double* old, const double* y, int n, int stride, int first, OutcomeTarget target) {
  __shared__ double scratch[32];
  let_next_begin();
  await_previous();
  const int j = first + int(blockIdx.x);
  double change = 0, magnitude = 0;
  for (int i = threadIdx.x; i < n; i += blockDim.x) {
    const long at = long(j) * stride + i;
    change = larger(fabs(y[at] - old[at]), change);
    magnitude = larger(fabs(y[at]), magnitude);
  }
  change = largest_of_block(change, scratch);
  magnitude = largest_of_block(magnitude, scratch);
  Outcomes outcomes(target);
  if (threadIdx.x == 0) outcomes.solved(j, 1, change, magnitude);
  outcomes.finish();
}

// ||min(y, M y + q)||_inf / max(1, ||q||_inf) of each row, without the shift.
__global__ void __launch_bounds__(256)
    face_residual(const double* r, const double* v, const double* y, FaceStencil m, double* of_rows) {
  __shared__ double scratch[32];
  const long row = long(blockIdx.x) * m.stride;
  double gap = 0, size = 0;
  for (int i = threadIdx.x; i < m.lines * m.points; i += blockDim.x) {
    const int line = i / m.points, column = i % m.points;
    const double* const at = y + row + i;
    const double q = r[row + i] + v[row + i];
    const double above = line > 0 ? at[-m.points] : 0, below = line + 1 < m.lines ? at[m.points] : 0;
    const double left = column > 0 ? at[-1] : 0, right = column + 1 < m.points ? at[1] : 0;
    const double w = q + (m.centre - m.shift) * *at + m.across * (above + below) + m.along * (left + right);
    const double least = *at + w != *at + w ? *at + w : fmin(*at, w);
    gap = larger(fabs(least), gap);
    size = larger(fabs(q), size);
  }
  gap = largest_of_block(gap, scratch);
  size = largest_of_block(size, scratch);
  if (threadIdx.x == 0) of_rows[blockIdx.x] = gap / fmax(1.0, size);
}

FaceStencil on_face(const Stencil& s, double shift, double omega) {
  const double centre = s.centre + shift;
  return {int(s.extents[0]),
          int(s.extents[1]),
          int(stride(s.extents[0] * s.extents[1])),
          s.beside[0],
          s.beside[1],
          centre,
          shift,
          1 - omega,
          omega / centre};
}

constexpr Index most_points = 512;  ///< of a line, by the threads of a block

bool fits(const Stencil& s) { return s.extents.size() == 2 && s.extents[1] <= most_points; }

/// The kernel with a number of sweeps.
class SweepKernel {
  using Kernel = void (*)(LcpArrays, FaceStencil, int, OutcomeTarget, double*);

 public:
  SweepKernel(const Device& device, int count, const FaceStencil& m) : device_(device), lines_(m.lines) {
    if (count == 1) use<2>(m.points);
    if (count == 2) use<4>(m.points);
  }

  bool possible() const { return kernel_ != nullptr; }

  void launch(LcpArrays arrays, const FaceStencil& m, Index first, Index rows, OutcomeTarget target,
              double* moved) const {
    const unsigned bands = bands_of(rows);
    if (bands > 1)
      follow(device_, in_bands_, {{unsigned(rows), bands}, threads_, bytes_in_bands_, bands}, starting, arrays, m,
             int(first), target, moved);
    else
      follow(device_, kernel_, {unsigned(rows), threads_, bytes_}, starting, arrays, m, int(first), target, moved);
  }

 private:
  template <int halves>
  void use(Index points) {
    kernel_ = sweep_face<halves, false>;
    in_bands_ = sweep_face<halves, true>;
    const Index half = ((points + 1) / 2 + 31) / 32 * 32;
    threads_ = unsigned(half * halves);
    bytes_ = Window<halves>::bytes(points, 1);
    bytes_in_bands_ = Window<halves>::bytes(points, 2);
    least_lines_ = 2 * halves;
    const auto reserve = [](Kernel kernel, std::size_t bytes) {
      check(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)),
            "reserving shared memory");
    };
    reserve(kernel_, bytes_);
    reserve(in_bands_, bytes_in_bands_);
    int on_each = 0;
    check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&on_each, in_bands_, int(threads_), bytes_in_bands_),
          "counting blocks of a multiprocessor");
    room_ = Index(on_each) * device_.multiprocessors();
  }

  // As many as fill the device once. Shorter bands would have more lines beside them than lines of their own.
  unsigned bands_of(Index rows) const {
    unsigned bands = 1;
    while (device_.has_clusters() && 2 * bands <= most_bands && rows * 2 * bands <= room_ &&
           lines_ >= Index(2 * bands) * least_lines_)
      bands *= 2;
    return bands;
  }

  const Device& device_;
  Kernel kernel_ = nullptr, in_bands_ = nullptr;
  Index lines_, least_lines_ = 0, room_ = 0;
  unsigned threads_ = 0;
  std::size_t bytes_ = 0, bytes_in_bands_ = 0;
};

class FaceSweeps final : public LcpBatch {
 public:
  FaceSweeps(const Device& device, const ProjectedSweeps& sweeps, const Stencil& stencil, Index rows)
      : LcpBatch(false),
        device_(device),
        m_(on_face(stencil, sweeps.shift, sweeps.omega)),
        kernel_(device, sweeps.count, m_),
        outcomes_(device, rows, sweeps.shift),
        residuals_(device, std::size_t(rows)) {}

  bool possible() const { return kernel_.possible(); }

  void submit(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    if (first >= y.rows()) return;
    const OutcomeTarget target = outcomes_.target(y.rows() - first, settle_tolerance, settle_tolerance >= 0);
    kernel_.launch({values(r), values(v), values(y), m_.stride}, m_, first, y.rows() - first, target, nullptr);
  }
  LcpReport collect() override { return outcomes_.collect(); }
  LcpReport finish(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    return outcomes_.report(r, v, y, first, settle_tolerance, []() -> ActiveSetLcp& {
      throw Error("cuda", "sweeps of a face reported an unsolved row", "report it", ErrorKind::internal);
    });
  }
  double residual(const Array& r, const Array& v, const Array& y) override {
    face_residual<<<unsigned(y.rows()), 256, 0, device_.stream()>>>(values(r), values(v), values(y), m_,
                                                                    residuals_.data());
    check(cudaGetLastError(), "starting the residual");
    return largest(device_, residuals_);
  }
  std::size_t bytes() const override { return outcomes_.bytes() + residuals_.bytes(); }

 private:
  const Device& device_;
  FaceStencil m_;
  SweepKernel kernel_;
  BatchOutcomes outcomes_;
  Memory<double> residuals_;
};

// Sweeps until y moves by rounding alone.
class FaceLcp final : public ImmediateLcpBatch {
 public:
  FaceLcp(const Device& device, const Stencil& stencil, Index rows)
      : device_(device),
        m_(on_face(stencil, 0, best_relaxation(stencil))),
        kernel_(device, 2, m_),
        sweeps_(device, rows),
        whole_(device, rows),
        moved_(device, std::size_t(rows)),
        residuals_(device, std::size_t(rows)) {}

  LcpReport solve_now(const Array& r, const Array& v, Array& y, Index first, double settle_tolerance) override {
    LcpReport report;
    report.settled = std::min(first, y.rows());
    if (first >= y.rows()) return report;
    const Index count = y.rows() - first, step = m_.stride;
    Memory<double> old(device_, std::size_t(y.rows() * step));
    check(cudaMemcpyAsync(old.data(), values(y), old.bytes(), cudaMemcpyDeviceToDevice, device_.stream()),
          "copying on the device");
    moved_.clear();
    long rounds = 0;
    double left = INFINITY;
    for (; rounds < most_rounds && left > settled; rounds += together) {
      for (int k = 0; k < together; ++k)
        kernel_.launch({values(r), values(v), values(y), m_.stride}, m_, first, count, sweeps_.target(count, -1, false),
                       moved_.data());
      left = largest(device_, moved_);
      if (!std::isfinite(left)) break;
    }
    sweeps_.collect();
    const OutcomeTarget target = whole_.target(count, settle_tolerance, true);
    follow(device_, compare_rows, {unsigned(count), 256u, 0}, starting, old.data(), values(y), m_.lines * m_.points,
           m_.stride, int(first), target);
    report = whole_.report(r, v, y, first, settle_tolerance, []() -> ActiveSetLcp& {
      throw Error("cuda", "a face reported an unsolved row", "report it", ErrorKind::internal);
    });
    report.count.newton = 2 * rounds * long(count);
    if (!(left <= settled)) {
      report.count.unsolved = long(count);
      report.count.solved = 0;
      report.finite = report.finite && std::isfinite(left);
    }
    return report;
  }
  double residual(const Array& r, const Array& v, const Array& y) override {
    face_residual<<<unsigned(y.rows()), 256, 0, device_.stream()>>>(values(r), values(v), values(y), m_,
                                                                    residuals_.data());
    check(cudaGetLastError(), "starting the residual");
    return largest(device_, residuals_);
  }
  std::size_t bytes() const override { return sweeps_.bytes() + whole_.bytes() + moved_.bytes() + residuals_.bytes(); }

 private:
  static constexpr long most_rounds = 240;
  static constexpr int together = 4;  ///< launches between looks
  static constexpr double settled = 4 * epsilon;

  const Device& device_;
  FaceStencil m_;
  SweepKernel kernel_;
  BatchOutcomes sweeps_, whole_;
  Memory<double> moved_, residuals_;
};

// The extents of a five-point stencil, from the neighbours of its first point.
std::vector<Index> extents_of(const SparseMatrix& M) {
  Index line = 0;
  for (SparseMatrix::InnerIterator a(M, 0); a; ++a)
    if (a.value() != 0 && a.row() > 1) line = std::max<Index>(line, a.row());
  if (line < 2 || M.rows() % line != 0) return {};
  return {M.rows() / line, line};
}

}  // namespace

std::unique_ptr<LcpBatch> make_projected_sweeps(const Device& device, const ProjectedSweeps& sweeps, Index rows) {
  const auto stencil = stencil_of(*sweeps.M, sweeps.face);
  if (!stencil || !fits(*stencil)) return nullptr;
  auto plan = std::make_unique<FaceSweeps>(device, sweeps, *stencil, rows);
  return plan->possible() ? std::move(plan) : nullptr;
}

std::unique_ptr<LcpBatch> make_face_lcp(const Device& device, const SparseMatrix& M, Index rows) {
  const std::vector<Index> extents = extents_of(M);
  if (extents.empty()) return nullptr;
  const auto stencil = stencil_of(M, extents);
  if (!stencil || !fits(*stencil) || !(stencil->centre > 0) || !(stencil->jacobi_radius() < 1)) return nullptr;
  return std::make_unique<FaceLcp>(device, *stencil, rows);
}

}  // namespace bromwich::cuda
