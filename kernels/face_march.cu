// Marching with contact on a face (core/host/face_lcp.hpp): each step is a fixed sequence of small kernels, recorded as
// a graph of some steps. A counter on the device says which step is due; kernels of steps beyond the last one write
// nothing. At step j
//
//     z <- E z + u_{j-1},   known = S (w1 u_{j-1} + C z + w0 phi_j),   y <- extrapolated from the last two,
//     y <- two sweeps of LCP(M + D I, r_j + known + S (w0 - D) S y)   several times,   u_j = S y + phi_j.
//
// The number of products with W_0 is fixed before a run; if the last change of some step is larger than rounding
// allows, the run is repeated with twice as many.

#include "core/lcp/stencil.hpp"
#include "kernels/face_transform.hpp"
#include "kernels/host_plans.hpp"
#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace bromwich::cuda {

namespace {

constexpr const char* starting = "starting a step of a face";
constexpr int inner = 16, halo = 4, side = inner + 2 * halo;  ///< of a tile: two sweeps are four half-sweeps

/// What the kernels of a step read and write. Vectors have one entry for each mode or point.
struct MarchOnFace {
  int n, exponentials, rows, stride;  ///< stride: between rows of arrays over time
  const double *decay, *output, *w0, *w1, *s1;
  double* z;
  const double *r, *drive;                       ///< (J+1) x n; drive in modes, or null
  double *y, *v;                                 ///< (J+1) x n
  double* input;                                 ///< u_{j-1}
  double *modes, *known, *now, *other, *change;  ///< known: of v_j; change: (W_0 - D) y
  double *last, *before;
  double shift;
  int* step;
  unsigned long long *worst, *largest;
};

__global__ void __launch_bounds__(128) advance(MarchOnFace m) {
  const int l = int(blockIdx.x * blockDim.x + threadIdx.x), j = *m.step;
  if (l >= m.n || j >= m.rows) return;
  const double u = m.input[l];
  double sum = (j == 1 ? m.s1[l] : m.w1[l]) * u;
  for (int k = 0; k < m.exponentials; ++k) {
    const long at = long(k) * m.n + l;
    const double z = j == 1 ? m.z[at] : m.decay[at] * m.z[at] + u;
    m.z[at] = z;
    sum += m.output[at] * z;
  }
  if (m.drive) sum += m.w0[l] * m.drive[long(j) * m.stride + l];
  m.modes[l] = sum;
}

__global__ void __launch_bounds__(256) extrapolate(MarchOnFace m) {
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (i < m.n) m.now[i] = fmax(0.0, 2 * m.last[i] - m.before[i]);
}

/// M + D I, as in face_sweeps.cu.
struct TileStencil {
  int lines, points;
  double across, along, keep, scale;
};

// out <- two sweeps from in. The last ones of a step note how much y moved.
__global__ void __launch_bounds__(side* side)
    relax_tile(MarchOnFace m, TileStencil s, const double* in, double* out, bool last) {
  __shared__ double y[side][side], q[side][side];
  const int a = int(threadIdx.y), b = int(threadIdx.x), j = min(*m.step, m.rows - 1);
  const int line = int(blockIdx.y) * inner - halo + a, column = int(blockIdx.x) * inner - halo + b;
  const bool inside = line >= 0 && line < s.lines && column >= 0 && column < s.points;
  const int at = line * s.points + column;
  const double old = inside ? in[at] : 0;
  y[a][b] = old;
  q[a][b] = inside ? m.r[long(j) * m.stride + at] + m.known[at] + m.change[at] : 0;
  const bool updates = inside && a > 0 && a + 1 < side && b > 0 && b + 1 < side;
  for (int half = 0; half < 4; ++half) {
    __syncthreads();
    if (updates && ((line + column + half) & 1) == 0) {
      const double sum = q[a][b] + s.across * (y[a - 1][b] + y[a + 1][b]) + s.along * (y[a][b - 1] + y[a][b + 1]);
      const double value = s.keep * y[a][b] - s.scale * sum;
      y[a][b] = value <= 0 ? 0 : value;  // keeps a NaN
    }
  }
  if (!inside || a < halo || a >= side - halo || b < halo || b >= side - halo) return;
  const double fresh = y[a][b];
  out[at] = fresh;
  if (!last || *m.step >= m.rows) return;
  const double moved = fabs(fresh - old);
  const unsigned long long bits = (unsigned long long)(__double_as_longlong(moved));
  if (bits > *m.worst) atomicMax(m.worst, bits);
  const unsigned long long size = (unsigned long long)(__double_as_longlong(fabs(fresh)));
  if (size > *m.largest) atomicMax(m.largest, size);
}

// Keeps y_j and v_j. `given`: y before the last sweeps, for which `change` was computed.
__global__ void __launch_bounds__(256) keep_step(MarchOnFace m, const double* found, const double* given) {
  const int i = int(blockIdx.x * blockDim.x + threadIdx.x), j = *m.step;
  if (i >= m.n || j >= m.rows) return;
  m.y[long(j) * m.stride + i] = found[i];
  m.v[long(j) * m.stride + i] = m.known[i] + m.change[i] + m.shift * given[i];
  m.before[i] = m.last[i];
  m.last[i] = found[i];
}

__global__ void __launch_bounds__(256) take_input(MarchOnFace m) {
  const int l = int(blockIdx.x * blockDim.x + threadIdx.x), j = *m.step;
  if (l >= m.n || j >= m.rows) return;
  m.input[l] = m.modes[l] + (m.drive ? m.drive[long(j) * m.stride + l] : 0);
}

__global__ void next_step(int* step) { ++*step; }

// z_0, u_0 and the step 1. On entry `modes` is S y_0.
__global__ void __launch_bounds__(128) begin(MarchOnFace m, const double* start, const double* initial) {
  const int l = int(blockIdx.x * blockDim.x + threadIdx.x);
  if (l == 0) *m.step = 1, *m.worst = 0, *m.largest = 0;
  if (l >= m.n) return;
  const double u = m.modes[l] + (m.drive ? m.drive[l] : 0);
  m.input[l] = u;
  m.last[l] = m.before[l] = m.y[l];
  m.v[l] = 0;
  for (int k = 0; k < m.exponentials; ++k) {
    const long at = long(k) * m.n + l;
    m.z[at] = start[at] * u + (initial ? initial[at] : 0);
  }
}

class FaceMarch final : public ImmediateMarch {
 public:
  FaceMarch(const Device& device, Backend& host, const MarchProblem& problem, const ModalRecurrence& r,
            const Stencil& stencil, const InstantShift& shift, Index rows)
      : device_(device),
        problem_(problem),
        r_(r),
        rows_(rows),
        host_(host),
        shift_(shift),
        transform_(device, r.face.extents()),
        decay_(on_device(device, r.decay)),
        output_(on_device(device, r.output)),
        start_(on_device(device, r.start)),
        z_(device, std::size_t(r.decay.size())),
        w0_(on_device(device, r.w0)),
        w1_(on_device(device, r.w1)),
        s1_(on_device(device, r.s1)),
        factor_(on_device(device, Vector(r.w0.array() - shift.shift))),
        counters_(device, 3) {
    const Stencil shifted = stencil.shifted(shift.shift);
    const double omega = best_relaxation(shifted);
    tile_ = {int(stencil.extents[0]), int(stencil.extents[1]), stencil.beside[0], stencil.beside[1], 1 - omega,
             omega / shifted.centre};
    for (Memory<double>* vector : {&input_, &modes_, &known_, &now_, &other_, &change_, &last_, &before_})
      *vector = Memory<double>(device, std::size_t(stride(r.modes())));
    if (problem.drive) drive_ = std::make_unique<DeviceArray>(device, rows, r.modes());
  }

  MarchReport run(Array& y, Array& v) override {
    Memory<double> initial;
    if (r_.initial.size() > 0) initial = on_device(device_, r_.initial);
    const MarchOnFace m = parts(y, v);
    if (drive_) transform_.apply(values(*problem_.drive), nullptr, nullptr, values(*drive_), values(*drive_), rows_);
    for (int products = first_products_;; products *= 2) {
      MarchReport report = attempt(m, y, initial.size() > 0 ? initial.data() : nullptr, products);
      unsigned long long found[2];
      cudaMemcpyAsync(found, counters_.data(), sizeof found, cudaMemcpyDeviceToHost, device_.stream());
      device_.wait();
      const double moved = std::bit_cast<double>(found[0]), size = std::bit_cast<double>(found[1]);
      if (report.interrupted) return report;
      if (moved <= settled * std::max(1.0, size)) {
        report.count.solved = long(rows_ - 1);
        report.count.newton = long(rows_ - 1) * products;
        return report;
      }
      if (!std::isfinite(moved) || 2 * products > most_products)
        return make_host_march(device_, host_, problem_, rows_)->run(y, v);
      first_products_ = 2 * products;
    }
  }

  std::size_t bytes() const override {
    return 4 * decay_.bytes() + 13 * input_.bytes() + transform_.bytes() +
           (drive_ ? drive_->memory.bytes() : std::size_t(0));
  }

 private:
  static constexpr int most_products = 96, steps_of_graph = 8;
  static constexpr Index polled_every = 64;  ///< graphs
  static constexpr double settled = 1e-12;

  MarchOnFace parts(Array& y, Array& v) {
    MarchOnFace m{};
    m.n = int(r_.modes());
    m.exponentials = int(r_.exponentials());
    m.rows = int(rows_);
    m.stride = int(stride(r_.modes()));
    m.decay = decay_.data(), m.output = output_.data();
    m.w0 = w0_.data(), m.w1 = w1_.data(), m.s1 = s1_.data();
    m.z = z_.data();
    m.r = values(*problem_.r), m.drive = drive_ ? values(*drive_) : nullptr;
    m.y = values(y), m.v = values(v);
    m.input = input_.data(), m.modes = modes_.data(), m.known = known_.data(), m.now = now_.data();
    m.other = other_.data(), m.change = change_.data(), m.last = last_.data(), m.before = before_.data();
    m.shift = shift_.shift;
    m.worst = counters_.data(), m.largest = counters_.data() + 1;
    m.step = reinterpret_cast<int*>(counters_.data() + 2);
    return m;
  }

  unsigned blocks(unsigned threads) const { return unsigned((r_.modes() + threads - 1) / threads); }

  void step(const MarchOnFace& m, int products) const {
    const cudaStream_t stream = device_.stream();
    advance<<<blocks(128), 128, 0, stream>>>(m);
    transform_.apply(m.modes, nullptr, nullptr, m.known, m.known, 1);
    extrapolate<<<blocks(256), 256, 0, stream>>>(m);
    const double* given = m.now;
    double* found = m.other;
    const dim3 tiles(unsigned((tile_.points + inner - 1) / inner), unsigned((tile_.lines + inner - 1) / inner));
    for (int k = 0; k < products; ++k) {
      double* const next = k % 2 == 0 ? m.other : m.now;
      const double* const from = k % 2 == 0 ? m.now : m.other;
      transform_.apply(from, nullptr, factor_.data(), m.modes, m.modes, 1);
      transform_.apply(m.modes, nullptr, nullptr, m.change, m.change, 1);
      relax_tile<<<tiles, dim3(side, side), 0, stream>>>(m, tile_, from, next, k + 1 == products);
      given = from, found = next;
    }
    keep_step<<<blocks(256), 256, 0, stream>>>(m, found, given);
    transform_.apply(found, nullptr, nullptr, m.modes, m.modes, 1);
    take_input<<<blocks(256), 256, 0, stream>>>(m);
    next_step<<<1, 1, 0, stream>>>(m.step);
    check(cudaGetLastError(), starting);
  }

  MarchReport attempt(const MarchOnFace& m, Array& y, const double* initial, int products) {
    MarchReport report;
    transform_.apply(values(y), nullptr, nullptr, m.modes, m.modes, 1);
    begin<<<blocks(128), 128, 0, device_.stream()>>>(m, start_.data(), initial);
    check(cudaGetLastError(), starting);
    cudaGraph_t graph = nullptr;
    cudaGraphExec_t steps = nullptr;
    check(cudaStreamBeginCapture(device_.stream(), cudaStreamCaptureModeThreadLocal), starting);
    for (int k = 0; k < steps_of_graph; ++k) step(m, products);
    check(cudaStreamEndCapture(device_.stream(), &graph), starting);
    check(cudaGraphInstantiate(&steps, graph, 0), starting);
    cudaGraphDestroy(graph);
    Index count = 0;
    for (Index j = 1; j < rows_; j += steps_of_graph, ++count) {
      if (count % polled_every == 0 && count > 0 && problem_.interrupted && problem_.interrupted()) {
        report.interrupted = true;
        report.stopped = j;
        break;
      }
      check(cudaGraphLaunch(steps, device_.stream()), starting);
    }
    device_.note_work();
    device_.wait();
    cudaGraphExecDestroy(steps);
    return report;
  }

  const Device& device_;
  MarchProblem problem_;
  const ModalRecurrence& r_;
  Index rows_;
  Backend& host_;
  InstantShift shift_;
  FaceKernels transform_;
  Memory<double> decay_, output_, start_, z_, w0_, w1_, s1_, factor_;
  Memory<unsigned long long> counters_;  ///< worst, largest, step
  Memory<double> input_, modes_, known_, now_, other_, change_, last_, before_;
  std::unique_ptr<DeviceArray> drive_;
  TileStencil tile_{};
  int first_products_ = 12;
};

}  // namespace

std::unique_ptr<March> make_face_march(const Device& device, Backend& host, const MarchProblem& problem,
                                       const ModalRecurrence& r, Index rows) {
  if (!r.face.is_sine() || !FaceKernels::take(r.face.extents()) || selects_least(problem.lcp_class)) return nullptr;
  const auto stencil = stencil_of(*problem.M, r.face.extents());
  if (!stencil) return nullptr;
  const Vector of_M = stencil->eigenvalues();
  if (!(of_M.minCoeff() > 0) || !((of_M + r.w0).minCoeff() > 0)) return nullptr;
  const InstantShift shift = instant_shift(of_M, r.w0);
  if (!(shift.contraction < 0.5) || !(stencil->shifted(shift.shift).jacobi_radius() < 1)) return nullptr;
  return std::make_unique<FaceMarch>(device, host, problem, r, *stencil, shift, rows);
}

}  // namespace bromwich::cuda
