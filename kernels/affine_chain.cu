// Chains of affine maps (core/host/affine_chain.hpp) with up to 32 states. Along a block of intervals: one warp per
// block, one lane per state. Within single intervals: one thread per value.

#include "kernels/parts.hpp"

#include "core/host/affine_chain.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

namespace bromwich::cuda {

namespace {

constexpr int warp = 32, block_threads = 128, warps_of_block = block_threads / warp;
constexpr unsigned whole_warp = ~0u;

/// All maps, concatenated: P, G, X, Q, column-major.
struct Maps {
  const double* matrices;
  const std::uint64_t* active;
  const int* map_of;
  int N, m, n, words;

  __device__ const double* P(int k) const { return matrices + long(map_of[k]) * long(m + n) * (m + n); }
  __device__ const double* G(int k) const { return P(k) + m * m; }
  __device__ const double* X(int k) const { return G(k) + m * n; }
  __device__ const double* Q(int k) const { return X(k) + n * m; }
  __device__ bool is_active(int k, int i) const {
    return (active[long(map_of[k]) * words + i / 64] >> (i % 64) & 1) != 0;
  }
};

// p = F - G q.
__global__ void make_inputs(Maps maps, const double* __restrict__ F, const double* __restrict__ q,
                            double* __restrict__ p) {
  const long at = long(blockIdx.x) * block_threads + threadIdx.x;
  const int k = int(at / maps.m), i = int(at % maps.m);
  if (k >= maps.N) return;
  const double *G = maps.G(k), *row = q + long(k) * maps.n;
  double sum = 0;
  for (int j = 0; j < maps.n; ++j) sum += G[j * maps.m + i] * row[j];
  p[at] = F[at] - sum;
}

// (P state)_lane; with `absolute`, of absolute values.
template <bool absolute>
__device__ double times_state(const double* P, int m, int lane, double state) {
  double sum = 0;
  for (int j = 0; j < m; ++j) {
    const double other = __shfl_sync(whole_warp, state, j), entry = lane < m ? __ldg(P + j * m + lane) : 0;
    sum += (absolute ? fabs(entry) : entry) * other;
  }
  return sum;
}

/// The vector that a warp of `condense` propagates through a block: one column of Phi, or phi (column -1).
struct Carried {
  int block, column;
};

__global__ void condense_blocks(Maps maps, const double* __restrict__ p, int length, const Carried* __restrict__ what,
                                int count, double* __restrict__ out) {
  const int item = blockIdx.x * warps_of_block + threadIdx.x / warp, lane = threadIdx.x % warp, m = maps.m;
  if (item >= count) return;
  const Carried mine = what[item];
  const int first = mine.block * length, last = min(maps.N, first + length);
  double state = lane == mine.column ? 1 : 0;
  for (int k = first; k < last; ++k) {
    const double add = mine.column < 0 && lane < m ? p[long(k) * m + lane] : 0;
    state = add + times_state<false>(maps.P(k), m, lane, state);
  }
  if (lane < m) out[long(item) * m + lane] = state;
}

// ends: for each block its last state, the rounding bound and the largest values, m each.
__global__ void expand_blocks(Maps maps, const double* __restrict__ p, int length, int blocks,
                              const double* __restrict__ starts, double* __restrict__ x, double* __restrict__ ends) {
  const int b = blockIdx.x * warps_of_block + threadIdx.x / warp, lane = threadIdx.x % warp, m = maps.m;
  if (b >= blocks) return;
  const int first = b * length, last = min(maps.N, first + length);
  const bool mine = lane < m;
  double state = mine ? starts[long(b) * m + lane] : 0, error = epsilon * fabs(state), largest = fabs(state);
  if (mine) x[long(first) * m + lane] = state;
  for (int k = first; k < last; ++k) {
    const double* P = maps.P(k);
    const double add = mine ? p[long(k) * m + lane] : 0;
    error = times_state<true>(P, m, lane, error + epsilon * fabs(state)) + epsilon * fabs(add);
    state = add + times_state<false>(P, m, lane, state);
    largest = fmax(largest, fabs(state));
    if (mine && k + 1 < last) x[long(k + 1) * m + lane] = state;
  }
  if (mine) {
    double* end = ends + 3L * b * m;
    end[lane] = state;
    end[m + lane] = error;
    end[2 * m + lane] = largest;
  }
}

/// Largest absolute values of v as bits, which are ordered alike.
struct Sizes {
  unsigned long long active, inactive;
  int not_finite;
};

__global__ void evaluate_intervals(Maps maps, const double* __restrict__ x, const double* __restrict__ q,
                                   double* __restrict__ v, Sizes* sizes) {
  __shared__ Sizes own;
  if (threadIdx.x == 0) own = {0, 0, 0};
  __syncthreads();
  const int m = maps.m, n = maps.n;
  const long at = long(blockIdx.x) * block_threads + threadIdx.x;
  const int k = int(at / n), i = int(at % n);
  if (k < maps.N) {
    const double *X = maps.X(k), *Q = maps.Q(k), *state = x + long(k) * m, *row = q + long(k) * n;
    double sum = 0, inputs = 0;
    bool finite = true;
    for (int j = 0; j < m; ++j) {
      sum += X[j * n + i] * state[j];
      finite = finite && isfinite(state[j]);
    }
    for (int j = 0; j < n; ++j) inputs += Q[j * n + i] * row[j];
    sum += inputs;
    v[at] = sum;
    if (!finite || !isfinite(sum))
      own.not_finite = 1;
    else
      atomicMax(maps.is_active(k, i) ? &own.active : &own.inactive,
                static_cast<unsigned long long>(__double_as_longlong(fabs(sum))));
  }
  __syncthreads();
  if (threadIdx.x > 0) return;
  atomicMax(&sizes->active, own.active);
  atomicMax(&sizes->inactive, own.inactive);
  if (own.not_finite) sizes->not_finite = 1;
}

__global__ void find_wrong_signs(Maps maps, const double* __restrict__ v, double active_zero, double inactive_zero,
                                 std::uint64_t* __restrict__ wrong) {
  const long at = long(blockIdx.x) * block_threads + threadIdx.x;
  const int k = int(at / maps.words), word = int(at % maps.words);
  if (k >= maps.N) return;
  std::uint64_t bits = 0;
  for (int i = 64 * word; i < min(maps.n, 64 * (word + 1)); ++i)
    if (v[long(k) * maps.n + i] < -(maps.is_active(k, i) ? active_zero : inactive_zero))
      bits |= std::uint64_t(1) << (i % 64);
  wrong[at] = bits;
}

unsigned blocks_for(Index count, int of_one) { return unsigned((count + of_one - 1) / of_one); }

class DeviceAffineChain final : public AffineChain {
 public:
  DeviceAffineChain(const Device& device, const AffineChainSizes& sizes)
      : device_(device),
        N_(sizes.intervals),
        m_(sizes.states),
        n_(sizes.components),
        words_(words_of_set(n_)),
        F_(device, std::size_t(N_ * m_)),
        q_(device, std::size_t(N_ * n_)),
        p_(device, std::size_t(N_ * m_)),
        x_(device, std::size_t((N_ + 1) * m_)),
        v_(device, std::size_t(N_ * n_)),
        map_of_(device, std::size_t(N_)),
        wrong_(device, std::size_t(N_ * words_)),
        sizes_(device, 1) {}

  void set_sources(const RowMatrix& F, const RowMatrix& q) override {
    F_.put(F.data());
    q_.put(q.data());
  }

  void set_maps(const std::vector<const AffineMap*>& maps, const std::vector<int>& map_of) override {
    std::vector<double> matrices;
    SetWords active;
    const auto append = [&](const Matrix& part) {
      matrices.insert(matrices.end(), part.data(), part.data() + part.size());
    };
    for (const AffineMap* map : maps) {
      append(map->P);
      append(map->G);
      append(map->X);
      append(map->Q);
      active.insert(active.end(), map->active.begin(), map->active.end());
    }
    map_of_host_ = map_of;
    kinds_ = maps.size();
    matrices_ = Memory<double>(device_, matrices.size());
    active_ = Memory<std::uint64_t>(device_, active.size());
    matrices_.put(matrices.data());
    active_.put(active.data());
    map_of_.put(map_of.data());
    make_inputs<<<blocks_for(N_ * m_, block_threads), block_threads, 0, device_.stream()>>>(maps_on_device(), F_.data(),
                                                                                            q_.data(), p_.data());
    check(cudaGetLastError(), "starting the inputs of a chain");
  }

  void condense(Index length, Blocks& blocks) override {
    const BlockProducts shared(map_of_host_, kinds_, length);
    const Index count = count_blocks(N_, length), products = Index(shared.block_of.size());
    std::vector<Carried> what;
    for (Index b = 0; b < count; ++b) what.push_back({int(b), -1});
    for (const Index b : shared.block_of)
      for (int column = 0; column < int(m_); ++column) what.push_back({int(b), column});
    Memory<Carried> items(device_, what.size());
    Memory<double> out(device_, what.size() * std::size_t(m_));
    items.put(what.data());
    condense_blocks<<<blocks_for(Index(what.size()), warps_of_block), block_threads, 0, device_.stream()>>>(
        maps_on_device(), p_.data(), int(length), items.data(), int(what.size()), out.data());
    check(cudaGetLastError(), "condensing a chain");
    std::vector<double> values(out.size());
    out.get(values.data());
    blocks.phi = Eigen::Map<const RowMatrix>(values.data(), count, m_);
    blocks.products.resize(std::size_t(products));
    for (Index i = 0; i < products; ++i)
      blocks.products[std::size_t(i)] = Eigen::Map<const Matrix>(values.data() + (count + i * m_) * m_, m_, m_);
    blocks.Phi.clear();
    for (const Index product : shared.product_of) blocks.Phi.push_back(&blocks.products[std::size_t(product)]);
  }

  BlockEnds expand(Index length, const RowMatrix& starts) override {
    const Index count = count_blocks(N_, length);
    Memory<double> begin(device_, std::size_t(starts.size())), end(device_, std::size_t(3 * count * m_));
    begin.put(starts.data());
    expand_blocks<<<blocks_for(count, warps_of_block), block_threads, 0, device_.stream()>>>(
        maps_on_device(), p_.data(), int(length), int(count), begin.data(), x_.data(), end.data());
    check(cudaGetLastError(), "expanding a chain");
    check(cudaMemcpyAsync(x_.data() + N_ * m_, begin.data() + count * m_, sizeof(double) * std::size_t(m_),
                          cudaMemcpyDeviceToDevice, device_.stream()),
          "copying the last state");
    RowMatrix values(count, 3 * m_);
    end.get(values.data());
    BlockEnds ends(count, m_);
    ends.state = values.leftCols(m_);
    ends.error = values.middleCols(m_, m_);
    ends.largest = values.rightCols(m_);
    return ends;
  }

  ActiveSizes evaluate() override {
    sizes_.clear();
    evaluate_intervals<<<blocks_for(N_ * n_, block_threads), block_threads, 0, device_.stream()>>>(
        maps_on_device(), x_.data(), q_.data(), v_.data(), sizes_.data());
    check(cudaGetLastError(), "evaluating a chain");
    Sizes sizes{};
    sizes_.get(&sizes);
    const auto value = [](unsigned long long bits) { return std::bit_cast<double>(bits); };
    return {value(sizes.active), value(sizes.inactive), sizes.not_finite == 0};
  }

  void wrong_signs(double active_zero, double inactive_zero, SetWords& wrong) override {
    find_wrong_signs<<<blocks_for(N_ * words_, block_threads), block_threads, 0, device_.stream()>>>(
        maps_on_device(), v_.data(), active_zero, inactive_zero, wrong_.data());
    check(cudaGetLastError(), "looking at the signs of a chain");
    wrong.resize(wrong_.size());
    wrong_.get(wrong.data());
  }

  void download(RowMatrix& x, RowMatrix& v) override {
    x.resize(N_ + 1, m_);
    v.resize(N_, n_);
    x_.get(x.data());
    v_.get(v.data());
  }

  std::size_t bytes() const override {
    return F_.bytes() + q_.bytes() + p_.bytes() + x_.bytes() + v_.bytes() + map_of_.bytes() + wrong_.bytes() +
           matrices_.bytes() + active_.bytes();
  }

 private:
  Maps maps_on_device() const {
    return {matrices_.data(), active_.data(), map_of_.data(), int(N_), int(m_), int(n_), int(words_)};
  }

  const Device& device_;
  Index N_, m_, n_, words_;
  Memory<double> F_, q_, p_, x_, v_, matrices_;
  Memory<std::uint64_t> active_;
  Memory<int> map_of_;
  Memory<std::uint64_t> wrong_;
  Memory<Sizes> sizes_;
  std::vector<int> map_of_host_;
  std::size_t kinds_ = 0;
};

}  // namespace

std::unique_ptr<AffineChain> make_affine_chain(const Device& device, const AffineChainSizes& sizes) {
  const bool fits = sizes.states >= 1 && sizes.states <= warp && sizes.components >= 1 &&
                    sizes.intervals * std::max(sizes.states, sizes.components) < 2'000'000'000;
  return fits ? std::make_unique<DeviceAffineChain>(device, sizes) : nullptr;
}

}  // namespace bromwich::cuda
