// Responses with a contour of its own for every time point (core/seam/point_responses.hpp), one kernel for all points
// and columns. A thread has one column of u and four nodes of a time point and sums over the rows of u by Horner's
// rule,
//
//     s <- q s + u_l,   l = j - terms, .., j - 1,
//
// four products a node and row, with one load for four nodes. The threads of a block have the columns of a tile and all
// nodes; then they sum over the nodes. Of dense dynamics a block has all columns, tile by tile, for every row of N.

#include "kernels/launch.cuh"
#include "kernels/parts.hpp"

#include "core/seam/point_responses.hpp"

#include <thrust/complex.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace {

using Number = thrust::complex<double>;

constexpr int nodes_of_thread = 4;
constexpr int most_threads = 256, widest_tile = 32;
constexpr unsigned all_lanes = ~0u;

struct Pair {
  double re, im;
  __device__ Number number() const { return {re, im}; }
};

/// A PointFactor, as it lies in memory.
struct Factor {
  Pair step, first, inner, last;
  long terms;
};
static_assert(sizeof(Factor) == sizeof(PointFactor));

/// Time points of one launch.
struct PointGroup {
  const Factor* factors;
  const long* begin;  ///< of the nodes of each point
  const Number* R;    ///< a column for each value, `nodes` long
  long nodes;
  int first, points;
};

struct Columns {
  int inputs, outputs;  ///< k and n
  int u_step, v_step;   ///< between rows
  int tile;             ///< columns of a block at a time, a power of two
};

// Σ q^{j-1-l} u_l and the rest of the integral, c_p included, for the nodes from `at` on.
__device__ void integrate(const Factor* factors, int count, int j, const double* u, int step, Number* integrals) {
  double re[nodes_of_thread], im[nodes_of_thread], q_re[nodes_of_thread], q_im[nodes_of_thread];
  long terms = 0;
#pragma unroll
  for (int a = 0; a < nodes_of_thread; ++a) {
    const bool there = a < count;
    re[a] = im[a] = 0;
    q_re[a] = there ? factors[a].step.re : 0;
    q_im[a] = there ? factors[a].step.im : 0;
    if (there) terms = max(terms, factors[a].terms);
  }
  const double* row = u + long(j - int(terms)) * step;
#pragma unroll 4
  for (int l = 0; l < int(terms); ++l, row += step) {
    const double value = *row;
#pragma unroll
    for (int a = 0; a < nodes_of_thread; ++a) {
      const double next = q_re[a] * re[a] - q_im[a] * im[a] + value;
      im[a] = q_re[a] * im[a] + q_im[a] * re[a];
      re[a] = next;
    }
  }
  const double now = u[long(j) * step], start = u[0];
#pragma unroll
  for (int a = 0; a < nodes_of_thread; ++a)
    integrals[a] = a < count ? factors[a].inner.number() * Number(re[a], im[a]) + now * factors[a].last.number() +
                                   start * factors[a].first.number()
                             : Number(0);
}

// What the threads of a block share: point, column and first node of each.
struct Place {
  __device__ Place(const PointGroup& g, const Columns& c, int tile)
      : point(g.points - 1 - int(blockIdx.x)),  // the long sums first
        j(g.first + point),
        begin(g.begin[point]),
        count(int(g.begin[point + 1] - begin)),
        lane(int(threadIdx.x) % c.tile),
        part(int(threadIdx.x) / c.tile),
        parts(int(blockDim.x) / c.tile),
        column(tile * c.tile + lane) {}

  int point, j;
  long begin;
  int count;
  int lane, part, parts;  ///< parts: groups of nodes side by side
  int column;
};

__global__ void respond_in_modes(PointGroup g, Columns c, const double* u, double* v) {
  extern __shared__ double sums[];
  let_next_begin();
  await_previous();
  const Place at(g, c, int(blockIdx.y));
  const int column = min(at.column, c.inputs - 1);
  double sum = 0;
  for (int p = at.part * nodes_of_thread; p < at.count; p += at.parts * nodes_of_thread) {
    Number integrals[nodes_of_thread];
    const int count = min(nodes_of_thread, at.count - p);
    integrate(g.factors + at.begin + p, count, at.j, u + column, c.u_step, integrals);
    const Number* R = g.R + column * g.nodes + at.begin + p;
    for (int a = 0; a < count; ++a) sum += R[a].real() * integrals[a].real() - R[a].imag() * integrals[a].imag();
  }
  sums[threadIdx.x] = sum;
  __syncthreads();
  if (at.part > 0 || at.column >= c.inputs) return;
  for (int q = 1; q < at.parts; ++q) sum += sums[q * c.tile + at.lane];
  v[long(at.j) * c.v_step + at.column] = sum;
}

// v += Re Σ_p Σ_k R_p(i, k) integrals(p, k) over the given nodes and columns: a warp for each row i of N.
__device__ void add_outputs(const PointGroup& g, const Columns& c, const Place& at, int node, int nodes, int column,
                            const Number* integrals, double* v) {
  const int lane = int(threadIdx.x) % 32, columns = min(c.tile, c.inputs - column);
  for (int i = int(threadIdx.x) / 32; i < c.outputs; i += int(blockDim.x) / 32) {
    double sum = 0;
    for (int k = 0; k < columns; ++k) {
      const Number* R = g.R + (long(i) * c.inputs + column + k) * g.nodes + at.begin + node;
      for (int p = lane; p < nodes; p += 32) {
        const Number value = integrals[p * c.tile + k];
        sum += R[p].real() * value.real() - R[p].imag() * value.imag();
      }
    }
    for (int apart = 16; apart > 0; apart /= 2) sum += __shfl_down_sync(all_lanes, sum, apart);
    if (lane == 0) v[i] = node == 0 && column == 0 ? sum : v[i] + sum;
  }
}

__global__ void respond_densely(PointGroup g, Columns c, const double* u, double* v) {
  extern __shared__ double shared[];
  Number* const kept = reinterpret_cast<Number*>(shared);  // a row of the tile for each node
  let_next_begin();
  await_previous();
  for (int tile = 0; tile * c.tile < c.inputs; ++tile) {
    const Place at(g, c, tile);
    const int together = at.parts * nodes_of_thread;
    for (int node = 0; node < at.count; node += together) {
      const int p = node + at.part * nodes_of_thread, count = min(nodes_of_thread, at.count - p);
      Number integrals[nodes_of_thread];
      if (count > 0)
        integrate(g.factors + at.begin + p, count, at.j, u + min(at.column, c.inputs - 1), c.u_step, integrals);
      __syncthreads();
      for (int a = 0; a < count; ++a) kept[(at.part * nodes_of_thread + a) * c.tile + at.lane] = integrals[a];
      __syncthreads();
      add_outputs(g, c, at, node, min(together, at.count - node), tile * c.tile, kept, v + long(at.j) * c.v_step);
    }
  }
}

class DevicePointResponses final : public PointResponses {
 public:
  DevicePointResponses(const Device& device, const HostThreads& host, const PointResponseProblem& problem)
      : device_(device), host_(host), p_(problem) {
    while (tile_ < widest_tile && tile_ < p_.inputs) tile_ *= 2;
  }

  void add(const PointContours& contours, ComplexMatrix R) override {
    const std::vector<PointFactor> factors = point_factors(host_, p_.h, contours);
    Kept kept{contours.first,
              contours.points(),
              0,
              Memory<Factor>(device_, factors.size()),
              Memory<long>(device_, contours.begin.size()),
              Memory<Number>(device_, std::size_t(R.size()))};
    for (Index i = 0; i < contours.points(); ++i)
      kept.most_nodes = std::max(kept.most_nodes, contours.begin[std::size_t(i + 1)] - contours.begin[std::size_t(i)]);
    kept.factors.put(reinterpret_cast<const Factor*>(factors.data()));
    kept.begin.put(contours.begin.data());
    kept.R.put(reinterpret_cast<const Number*>(R.data()));
    groups_.push_back(std::move(kept));
  }

  void apply(const Array& u, Array& v) override {
    check(cudaMemsetAsync(values(v), 0, sizeof(double) * std::size_t(p_.outputs), device_.stream()), "clearing a row");
    const Columns columns{int(p_.inputs), int(p_.outputs), int(stride(p_.inputs)), int(stride(p_.outputs)), tile_};
    for (const Kept& kept : groups_) {
      const PointGroup group{kept.factors.data(),       kept.begin.data(), kept.R.data(),
                             long(kept.factors.size()), int(kept.first),   int(kept.points)};
      const Index parts = (kept.most_nodes + nodes_of_thread - 1) / nodes_of_thread;
      const unsigned threads = unsigned(std::min<Index>(most_threads, (parts * tile_ + 31) / 32 * 32)),
                     tiles = unsigned((p_.inputs + tile_ - 1) / tile_);
      const char* const what = "starting the responses of all time points";
      if (p_.modal)
        follow(device_, respond_in_modes, {dim3(unsigned(kept.points), tiles), threads, sizeof(double) * threads}, what,
               group, columns, values(u), values(v));
      else
        follow(device_, respond_densely, {unsigned(kept.points), threads, sizeof(Number) * nodes_of_thread * threads},
               what, group, columns, values(u), values(v));
    }
  }

  std::size_t bytes() const override {
    std::size_t sum = 0;
    for (const Kept& kept : groups_) sum += kept.factors.bytes() + kept.begin.bytes() + kept.R.bytes();
    return sum;
  }

 private:
  struct Kept {
    Index first, points, most_nodes;
    Memory<Factor> factors;
    Memory<long> begin;
    Memory<Number> R;
  };

  const Device& device_;
  const HostThreads& host_;
  PointResponseProblem p_;
  int tile_ = 1;
  std::vector<Kept> groups_;
};

}  // namespace

std::unique_ptr<PointResponses> make_point_responses(const Device& device, const HostThreads& host,
                                                     const PointResponseProblem& problem) {
  return std::make_unique<DevicePointResponses>(device, host, problem);
}

}  // namespace bromwich::cuda
