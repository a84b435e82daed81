// Sweeps of projected over-relaxation in two colours for complementarity problems on a face, M the same five-point
// stencil at all points of a grid (core/seam/plans.hpp, ProjectedSweeps).
//
// A block walks once down lines of the grid of a time point with a few of them in shared memory, and makes all
// half-sweeps on the way. When half-sweep 0 is at line t, half-sweep s is at line t - 2 s, line t + 2 arrives from
// memory, and the load of line t + 3 begins. Half-sweep s of a line needs half-sweep s - 1 of its two neighbours, which
// is done by then, so that one barrier a step is enough, and r, v and y are read and written once for all sweeps.
//
// Where time points are too few for all multiprocessors, a cluster of blocks divides the lines into bands. A block
// walks down its band and as many lines on both sides of it as there are half-sweeps: what is wrong at the ends of
// these does not reach the band, which is the same to the last bit.

#include "core/lcp/stencil.hpp"
#include "kernels/launch.cuh"
#include "kernels/lcp_batch.hpp"
#include "kernels/lcp_outcome.cuh"
#include "kernels/parts.hpp"

#include "core/base/error.hpp"

#include <cooperative_groups.h>

#include <algorithm>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr const char* starting = "starting the sweeps of a face";

/// M + D I on lines x points.
struct FaceStencil {
  int lines, points, stride;
  double across, along;  ///< neighbours on other lines, on the same line
  double centre, shift, keep, scale;
};

__device__ inline double largest_of_block(double mine, double* shared) {
  const int lane = int(threadIdx.x) % 32, warp = int(threadIdx.x) / 32, warps = (int(blockDim.x) + 31) / 32;
  for (int far = 16; far > 0; far /= 2) mine = larger(__shfl_xor_sync(~0u, mine, far), mine);
  __syncthreads();
  if (lane == 0) shared[warp] = mine;
  __syncthreads();
  double all = 0;
  for (int w = 0; w < warps; ++w) all = larger(shared[w], all);
  return all;
}

template <int halves>
struct Window {
  static constexpr int of_y = 2 * halves + 2, of_q = 2 * halves + 1;  ///< lines kept
  static std::size_t bytes(Index points, unsigned bands) {
    return sizeof(double) *
           (std::size_t((of_y + of_q) * (points + 2)) + (bands > 1 ? std::size_t(2 * halves * points) : 0));
  }
};

/// The lines of a block: [begin, end) are its own, [from, to) are those that it needs for them.
struct Band {
  int begin, end, from, to;

  /// All lines.
  __device__ explicit Band(int lines) : begin(0), end(lines), from(0), to(lines) {}
  /// Those of this block of its cluster.
  __device__ Band(int lines, int beside)
      : begin(int(long(lines) * blockIdx.y / gridDim.y)),
        end(int(long(lines) * (blockIdx.y + 1) / gridDim.y)),
        from(max(0, begin - beside)),
        to(min(lines, end + beside)) {}

  __device__ bool owns(int line) const { return line >= begin && line < end; }
  __device__ int others() const { return begin - from + to - end; }
  /// Lines of other blocks, counted from 0.
  __device__ int other(int k) const { return k < begin - from ? from + k : end + k - (begin - from); }
  __device__ int number(int line) const { return line < begin ? line - from : begin - from + line - end; }
};

__device__ inline void await_cluster() {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  cooperative_groups::this_cluster().sync();
#endif
}

/// Writes the value to the same place of the first block of the cluster.
__device__ inline void give_first_block(double* shared, double value) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  *cooperative_groups::this_cluster().map_shared_rank(shared, 0) = value;
#endif
}

constexpr unsigned most_bands = 8;  ///< a cluster may have as many on all devices

// The largest values of all blocks of the cluster, in the first one.
__device__ inline void largest_of_cluster(double& change, double& magnitude) {
  __shared__ double of_bands[2][most_bands];
  if (threadIdx.x == 0) {
    give_first_block(&of_bands[0][blockIdx.y], change);
    give_first_block(&of_bands[1][blockIdx.y], magnitude);
  }
  await_cluster();
  for (unsigned b = 0; b < gridDim.y && blockIdx.y == 0; ++b) {
    change = larger(of_bands[0][b], change);
    magnitude = larger(of_bands[1][b], magnitude);
  }
}

// `moved`: per row the largest change by the last sweep, relative to the largest value of 1 and y; null if not wanted.
template <int halves, bool in_bands>
__global__ void __launch_bounds__(1024, 2)
    sweep_face(LcpArrays arrays, FaceStencil m, int first, OutcomeTarget target, double* moved) {
  extern __shared__ double shared[];
  __shared__ double scratch[32];
  using Kept = Window<halves>;
  const int width = m.points + 2, me = int(threadIdx.x), all = int(blockDim.x), half = all / halves;
  const int s = me / half, i = me % half, j = first + int(blockIdx.x);
  const Band band = in_bands ? Band(m.lines, halves) : Band(m.lines);
  double *const ys = shared, *const qs = ys + Kept::of_y * width, *const of_others = qs + Kept::of_q * width;
  let_next_begin();
  for (int a = me; a < (Kept::of_y + Kept::of_q) * width; a += all) shared[a] = 0;
  await_previous();
  const double *const r = arrays.r + long(j) * m.stride, *const v = arrays.v + long(j) * m.stride;
  double* const y = arrays.y + long(j) * m.stride;
  if constexpr (in_bands) {  // before their blocks change them
    for (int a = me; a < band.others() * m.points; a += all)
      of_others[a] = y[band.other(a / m.points) * m.points + a % m.points];
    await_cluster();
  }
  __syncthreads();
  const bool loads = me < m.points;
  const auto old_y = [&](int line) {
    if constexpr (in_bands)
      if (!band.owns(line)) return of_others[band.number(line) * m.points + me];
    return y[line * m.points + me];
  };
  const auto put = [&](int line, double value, double q) {
    ys[line % Kept::of_y * width + 1 + me] = value;
    qs[line % Kept::of_q * width + 1 + me] = q - m.shift * value;
  };
  for (int line = band.from; line < min(band.from + 2, band.to); ++line)
    if (loads) {
      const int at = line * m.points + me;
      put(line, old_y(line), r[at] + v[at]);
    }
  __syncthreads();
  double change = 0, magnitude = 0;
  double next = 0, r_next = 0, v_next = 0, later = 0, r_later = 0, v_later = 0;  // lines t + 2 and t + 3
  if (loads && band.from + 2 < band.to) {
    const int at = (band.from + 2) * m.points + me;
    next = old_y(band.from + 2), r_next = r[at], v_next = v[at];
  }
  for (int t = band.from; t < band.to + 2 * halves - 1; ++t) {
    const int coming = t + 2, gone = t - 2 * halves + 1, line = t - 2 * s;
    const bool fetches = loads && coming < band.to;
    if (loads && coming + 1 < band.to) {
      const int at = (coming + 1) * m.points + me;
      later = old_y(coming + 1), r_later = r[at], v_later = v[at];
    }
    const int column = 2 * i + (line + s & 1);
    if (line >= band.from && line < band.to && column < m.points) {
      double* const at = ys + line % Kept::of_y * width + 1 + column;
      const double above = line > 0 ? ys[(line - 1) % Kept::of_y * width + 1 + column] : 0;
      const double below = line + 1 < m.lines ? ys[(line + 1) % Kept::of_y * width + 1 + column] : 0;
      const double sum =
          qs[line % Kept::of_q * width + 1 + column] + m.across * (above + below) + m.along * (at[-1] + at[1]);
      const double old = *at, value = m.keep * old - m.scale * sum, fresh = value <= 0 ? 0 : value;  // keeps a NaN
      *at = fresh;
      if (s >= halves - 2 && (!in_bands || band.owns(line))) {
        change = larger(fabs(fresh - old), change);
        magnitude = larger(fabs(fresh), magnitude);
      }
    }
    if (loads && band.owns(gone)) y[gone * m.points + me] = ys[gone % Kept::of_y * width + 1 + me];
    if (fetches) put(coming, next, r_next + v_next);
    next = later, r_next = r_later, v_next = v_later;
    __syncthreads();
  }
  change = largest_of_block(change, scratch);
  magnitude = largest_of_block(magnitude, scratch);
  if constexpr (in_bands) {
    largest_of_cluster(change, magnitude);
    if (blockIdx.y > 0) return;
  }
  Outcomes outcomes(target);
  if (me == 0) {
    outcomes.solved(j, halves / 2, change, magnitude);
    if (moved) moved[blockIdx.x] = change / fmax(1.0, magnitude);
  }
  outcomes.finish();
}

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
  const auto stencil = stencil_of(SparseLcpMatrix(*sweeps.M), sweeps.face);
  if (!stencil || !fits(*stencil)) return nullptr;
  auto plan = std::make_unique<FaceSweeps>(device, sweeps, *stencil, rows);
  return plan->possible() ? std::move(plan) : nullptr;
}

std::unique_ptr<LcpBatch> make_face_lcp(const Device& device, const SparseMatrix& M, Index rows) {
  const std::vector<Index> extents = extents_of(M);
  if (extents.empty()) return nullptr;
  const auto stencil = stencil_of(SparseLcpMatrix(M), extents);
  if (!stencil || !fits(*stencil) || !(stencil->centre > 0) || !(stencil->jacobi_radius() < 1)) return nullptr;
  return std::make_unique<FaceLcp>(device, *stencil, rows);
}

}  // namespace bromwich::cuda
