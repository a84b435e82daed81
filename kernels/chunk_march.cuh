#pragma once
// Chunks of time of one scene, side by side (core/seam/chunk_march.hpp). Each chunk has m / 2 threads, which all take
// its steps and carry two columns of its derivative each. The maps of most steps are parameters of the kernel: their
// entries are operands of its instructions, and only the pieces are read.

#include "core/host/affine_pieces.hpp"
#include "core/seam/chunk_packing.hpp"
#include "kernels/chunk_scan.cuh"
#include "kernels/host_plans.hpp"
#include "kernels/parts.hpp"

#include <algorithm>
#include <cstring>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich::cuda {

namespace chunks {

using pieces::End;
using pieces::Maps;
using pieces::Piece;
using pieces::Walk;

inline constexpr int threads = 64;
inline constexpr int most_missed = 512;  // that are told to the host

template <Index m, Index u, bool continuous>
__global__ void __launch_bounds__(threads)
    march(const __grid_constant__ Maps<m, u> main, const __grid_constant__ Work<m, u> w, const int* list, int count) {
  constexpr int columns = 2, lanes = m / columns;
  const int at = int(blockIdx.x * threads + threadIdx.x) / lanes, lane = int(threadIdx.x) % lanes;
  if (at >= count) return;
  const Index c = list ? list[at] : at;
  Walk<m, u, continuous, columns> walk{w.scene};
  walk.start(w.states.s + c * m, w.states.before[c], lane * columns);
  Missed<u> missed;
  const Index first = c * w.steps / w.states.chunks, last = (c + 1) * w.steps / w.states.chunks;
  const bool complete = walk.march(main, first, last, lane == 0, missed);
  for (int k = 0; k < columns; ++k)
    for (int i = 0; i < m; ++i) w.states.D[(c * m + lane * columns + k) * m + i] = walk.D[k][i];
  if (lane > 0) return;
  w.states.began[c] = w.states.before[c];
  w.states.end[c] = walk.end;
  if (complete) return;
  const int place = atomicAdd(&w.found->misses, 1);
  w.missed_list[place] = int(c);
  missed.chunk = c;
  if (place < most_missed) w.missed[place] = missed;
}

template <Index m, Index u, bool continuous>
class DeviceChunks final : public ChunkMarch {
 public:
  DeviceChunks(const Device& device, const ChunkMarchProblem& p)
      : device_(device),
        packing_(p.n, p.continuous),
        memory_(packing_.memory(p)),
        x_(device, p.rows(), p.m),
        y_(device, p.rows(), p.n),
        sources_(device, std::size_t(p.sources.size())),
        kind_of_(device, p.kind_of.size()),
        pieces_(device, p.steps.size() * std::size_t(most_pieces)),
        known_(device, p.steps.size()),
        count_(p.steps.size(), 0),
        s0_(device, std::size_t(m)),
        missed_(device, std::size_t(most_missed)),
        found_(device, 1),
        told_(device, Found()) {
    std::vector<Maps<m, u>> maps;
    for (const ChunkStep& step : p.steps) maps.push_back(packing_.maps(step));
    main_ = maps.front();
    maps_ = cuda::Memory<Maps<m, u>>(device, maps.size());
    maps_.put(maps.data());
    if (p.sources.size() > 0)
      device.fetcher().send(p.sources.data(), sources_.size(), sources_.data(), device.stream());
    kind_of_.put(p.kind_of.data());
    known_.clear();
    std::vector<double> s0(std::size_t(m), 0);
    for (Index i = 0; i < p.m; ++i) s0[std::size_t(i)] = p.s0[i];
    s0_.put(s0.data());
    if (p.wants_impulse) impulse_.emplace(device, p.rows(), p.n);
    Scene<m, u>& g = work_.scene;
    g = packing_.scene(p);
    g.maps = maps_.data(), g.pieces = pieces_.data(), g.known = known_.data();
    g.sources = sources_.data(), g.kind_of = p.kind_of.empty() ? nullptr : kind_of_.data();
    g.x = x_.memory.data(), g.x_apart = stride(p.m);
    g.y = y_.memory.data(), g.y_apart = stride(p.n);
    g.impulse = impulse_ ? impulse_->memory.data() : nullptr;
    work_.steps = p.rows() - 1;
    work_.missed = missed_.data(), work_.found = found_.data();
  }

  void begin(Index chunks) override {
    const std::size_t C = std::size_t(chunks);
    links_count_ = int((chunks + chunks_of_link - 1) / chunks_of_link);
    s_ = {device_, C * m}, D_ = {device_, C * m * m};
    before_ = {device_, C}, began_ = {device_, C}, end_ = {device_, C};
    sets_ = {device_, C}, open_ = {device_, C};
    open_list_ = {device_, C}, missed_list_ = {device_, C}, missed_before_ = {device_, C};
    links_ = {device_, std::size_t(links_count_)}, joined_ = {device_, std::size_t(links_side_by_side)};
    before_link_ = {device_, std::size_t(links_count_)};
    const Index longest = (work_.steps + chunks - 1) / chunks;
    work_.states = {chunks,         pieces::rounding_of(longest),
                    s_.data(),      D_.data(),
                    before_.data(), began_.data(),
                    end_.data(),    sets_.data(),
                    open_.data()};
    work_.open_list = open_list_.data(), work_.missed_list = missed_list_.data();
    work_.links = links_.data(), work_.joined = joined_.data(), work_.before_link = before_link_.data();
    device_.note_work();
    const auto blocks = unsigned((chunks + threads - 1) / threads);
    begin_chunks<m, u><<<blocks, threads, 0, device_.stream()>>>(work_, s0_.data(), memory_);
    check(cudaGetLastError(), "beginning chunks");
    open_chunks_ = int(chunks);
    listed_ = false;
  }

  void add(Index kind, const ChunkPiece& piece) override {
    const Piece<m, u> packed = packing_.piece(piece);
    int& count = count_[std::size_t(kind)];
    copy(packed, pieces_.data() + kind * most_pieces + count);
    ++count;
    copy(count, known_.data() + kind);
  }

  std::vector<ChunkMiss> pass(bool missed_only) override {
    // The misses of the last call are marched from a list that this one does not write.
    if (missed_only) std::swap(missed_before_, missed_list_);
    work_.missed_list = missed_list_.data();
    const int* list = missed_only ? missed_before_.data() : listed_ ? open_list_.data() : nullptr;
    const int count = missed_only ? told_->misses : open_chunks_;
    launch(list, count);
    if (told_->misses == 0) return {};
    std::vector<Missed<u>> missed(std::size_t(std::min(told_->misses, most_missed)));
    check(cudaMemcpyAsync(missed.data(), missed_.data(), missed.size() * sizeof(missed[0]), cudaMemcpyDeviceToHost,
                          device_.stream()),
          "copying steps from the device");
    device_.wait();
    std::vector<ChunkMiss> misses;
    for (const Missed<u>& one : missed) misses.push_back(packing_.miss(one));
    return misses;
  }

  ChunkCorrection correct() override {
    open_chunks_ = told_->open;
    listed_ = true;
    double largest = 0;
    static_assert(sizeof largest == sizeof told_->largest);
    std::memcpy(&largest, &told_->largest, sizeof largest);
    return {told_->open, largest, told_->unknown == 0};
  }

  void download(const Array& from, RowMatrix& to) const override { cuda::download(device_, from, to); }
  const Array& x() const override { return x_; }
  const Array& y() const override { return y_; }
  const Array* impulse() const override { return impulse_ ? &*impulse_ : nullptr; }
  Index jumps() const override { return Index(told_->jumps); }
  std::size_t bytes() const override {
    return x_.memory.bytes() + y_.memory.bytes() + (impulse_ ? impulse_->memory.bytes() : 0) + sources_.bytes() +
           kind_of_.bytes() + pieces_.bytes() + s_.bytes() + D_.bytes() + 2 * before_.bytes() + end_.bytes() +
           links_.bytes() + before_link_.bytes();
  }

 private:
  template <class T>
  void copy(const T& from, T* to) {
    check(cudaMemcpyAsync(to, &from, sizeof from, cudaMemcpyHostToDevice, device_.stream()), "copying to the device");
    device_.wait();
  }

  void launch(const int* list, int count) {
    const cudaStream_t stream = device_.stream();
    device_.note_work();
    constexpr int chunks_of_block = threads / (m / 2);
    const auto blocks_for = [](int needed, int each) { return unsigned((needed + each - 1) / each); };
    found_.clear();
    march<m, u, continuous><<<blocks_for(count, chunks_of_block), threads, 0, stream>>>(main_, work_, list, count);
    link_chunks<m, u><<<blocks_for(links_count_ * (m + 1), 32), 32, 0, stream>>>(work_, links_count_);
    join_links<m, u><<<1, links_side_by_side*(m + 1), 0, stream>>>(work_, links_count_);
    correct_chunks<m, u><<<blocks_for(links_count_, 32), 32, 0, stream>>>(work_, links_count_);
    check(cudaGetLastError(), "marching chunks");
    check(cudaMemcpyAsync(told_.get(), found_.data(), sizeof(Found), cudaMemcpyDeviceToHost, stream),
          "copying from the device");
    device_.wait();
  }

  const Device& device_;
  pieces::Packing<m, u> packing_;
  pieces::Memory<u> memory_;
  DeviceArray x_, y_;
  std::optional<DeviceArray> impulse_;
  cuda::Memory<double> sources_;
  cuda::Memory<unsigned char> kind_of_;
  cuda::Memory<Piece<m, u>> pieces_;
  cuda::Memory<int> known_;
  std::vector<int> count_;
  cuda::Memory<double> s0_;
  cuda::Memory<Missed<u>> missed_;
  cuda::Memory<Found> found_;
  Pinned<Found> told_;
  Maps<m, u> main_;
  cuda::Memory<Maps<m, u>> maps_;
  Work<m, u> work_{};
  cuda::Memory<double> s_, D_;
  cuda::Memory<pieces::Memory<u>> before_, began_;
  cuda::Memory<End<m, u>> end_;
  cuda::Memory<std::uint64_t> sets_;
  cuda::Memory<unsigned char> open_;
  cuda::Memory<int> open_list_, missed_list_, missed_before_;
  cuda::Memory<Link<m, u>> links_, joined_;
  cuda::Memory<Prefix<m, u>> before_link_;
  int links_count_ = 0, open_chunks_ = 0;
  bool listed_ = false;
};

}  // namespace chunks

/// Of one rule and padded number of states, whatever the unknowns.
template <Index m, bool continuous>
std::unique_ptr<ChunkMarch> make_chunks(const Device& device, const ChunkMarchProblem& p) {
  return pieces::with_size(p.unknowns(), [&](auto u) -> std::unique_ptr<ChunkMarch> {
    return std::make_unique<chunks::DeviceChunks<m, decltype(u)::is, continuous>>(device, p);
  });
}

}  // namespace bromwich::cuda
