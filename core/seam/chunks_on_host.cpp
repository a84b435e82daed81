// Chunks of time on the threads of the host (core/seam/chunk_march.hpp).

#include "core/base/denormals.hpp"
#include "core/host/affine_pieces.hpp"
#include "core/seam/chunk_packing.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <optional>

namespace bromwich {

namespace pieces {

namespace {

class Rows final : public Array {
 public:
  Rows(Index rows, Index cols) : Rows(std::make_unique<double[]>(std::size_t(rows * cols)), rows, cols) {}

 private:
  Rows(std::unique_ptr<double[]> values, Index rows, Index cols)
      : Array(rows, cols, values.get()), values_(std::move(values)) {}
  std::unique_ptr<double[]> values_;
};

template <Index m, Index u, bool continuous>
class HostChunks final : public ChunkMarch {
 public:
  HostChunks(const HostThreads& threads, const ChunkMarchProblem& p)
      : threads_(threads),
        problem_(p),
        packing_(p.n, p.continuous),
        pieces_(p.steps.size() * std::size_t(most_pieces)),
        known_(p.steps.size(), 0),
        x_(p.rows(), p.m),
        y_(p.rows(), p.n),
        scene_(packing_.scene(p)) {
    for (const ChunkStep& step : p.steps) maps_.push_back(packing_.maps(step));
    if (p.wants_impulse) impulse_ = std::make_unique<Rows>(p.rows(), p.n);
    scene_.maps = maps_.data(), scene_.pieces = pieces_.data(), scene_.known = known_.data();
    scene_.kind_of = problem_.kind_of.empty() ? nullptr : problem_.kind_of.data();
    scene_.sources = problem_.sources.data();
    scene_.x = x_.host_values(), scene_.x_apart = p.m;
    scene_.y = y_.host_values(), scene_.y_apart = p.n;
    if (impulse_) scene_.impulse = impulse_->host_values();
  }

  void begin(Index chunks) override {
    const std::size_t C = std::size_t(chunks);
    s_.assign(C * m, 0);
    D_.assign(C * m * m, 0);
    before_.assign(C, packing_.memory(problem_));
    began_ = before_;
    end_.assign(C, {});
    sets_.assign(C, 0);
    open_.assign(C, 1);
    paused_ = std::vector<Paused<m>>(C);
    for (Index c = 0; c < chunks; ++c)
      for (Index i = 0; i < problem_.m; ++i) s_[std::size_t(c * m + i)] = problem_.s0[i];
    const Index longest = (steps() + chunks - 1) / chunks;
    states_ = {chunks,        rounding_of(longest), s_.data(),    D_.data(),   before_.data(),
               began_.data(), end_.data(),          sets_.data(), open_.data()};
  }

  void add(Index kind, const ChunkPiece& piece) override {
    pieces_[std::size_t(kind * most_pieces + known_[std::size_t(kind)]++)] = packing_.piece(piece);
  }

  std::vector<ChunkMiss> pass(bool missed_only) override {
    std::vector<Index> marched;
    for (Index c = 0; c < states_.chunks; ++c)
      if (open_[std::size_t(c)] && !(missed_only && end_[std::size_t(c)].complete)) marched.push_back(c);
    if (!missed_only) forget_paused();
    std::vector<ChunkMiss> misses;
    std::mutex mutex;
    share_each(threads_, Index(marched.size()), [&](Index k) {
      Missed<u> missed;
      if (march(marched[std::size_t(k)], missed)) return;
      const std::lock_guard lock(mutex);
      misses.push_back(packing_.miss(missed));
    });
    return misses;
  }

  ChunkCorrection correct() override {
    ChunkCorrection result;
    Prefix<m, u> prefix;
    for (Index i = 0; i < u; ++i) prefix.regular[i] = before_.front().regular[i];
    for (Index c = 0; c < states_.chunks; ++c) {
      result.largest = std::max(result.largest, settle(states_, c, prefix));
      result.open += open_[std::size_t(c)];
      result.finite = result.finite && is_known(end_[std::size_t(c)]);
    }
    return result;
  }

  void download(const Array& from, RowMatrix& to) const override {
    to.resize(from.rows(), from.cols());
    constexpr Index block = 4096;
    share(threads_, from.rows(), block, [&](Index begin, Index end) {
      const double* values = from.host_values();
      std::copy(values + begin * from.cols(), values + end * from.cols(), to.data() + begin * from.cols());
    });
  }
  const Array& x() const override { return x_; }
  const Array& y() const override { return y_; }
  const Array* impulse() const override { return impulse_.get(); }
  Index jumps() const override {
    Index sum = 0;
    for (const auto& end : end_) sum += end.jumps;
    return sum;
  }
  std::size_t bytes() const override {
    return x_.bytes() + y_.bytes() + (impulse_ ? impulse_->bytes() : 0) + pieces_.size() * sizeof(pieces_[0]) +
           end_.size() * sizeof(end_[0]) + (s_.size() + D_.size()) * sizeof(double);
  }

 private:
  Index steps() const { return problem_.rows() - 1; }

  // A single chunk needs no derivative.
  bool march(Index c, Missed<u>& missed) { return states_.chunks > 1 ? march<m>(c, missed) : march<0>(c, missed); }

  // From the begin, or from the step that was outside all known pieces.
  template <Index columns>
  bool march(Index c, Missed<u>& missed) {
    const FlushDenormals flush;
    const std::size_t i = std::size_t(c);
    Paused<columns>& paused = paused_at<columns>(i);
    if (!paused.walk) {
      paused.walk.emplace(Walk<m, u, continuous, columns>{scene_});
      paused.row = c * steps() / states_.chunks;
      paused.walk->start(&s_[i * m], before_[i], 0);
      began_[i] = before_[i];
    }
    Walk<m, u, continuous, columns>& walk = *paused.walk;
    const bool complete = walk.march(maps_.front(), paused.row, (c + 1) * steps() / states_.chunks, true, missed);
    missed.chunk = c;
    paused.row = missed.row - 1;
    end_[i] = walk.end;
    if constexpr (columns > 0)
      for (Index k = 0; k < m; ++k) std::copy(walk.D[k], walk.D[k] + m, &D_[(i * m + std::size_t(k)) * m]);
    return complete;
  }

  template <Index columns>
  struct Paused {
    std::optional<Walk<m, u, continuous, columns>> walk;
    Index row = 0;
  };
  template <Index columns>
  Paused<columns>& paused_at(std::size_t c) {
    if constexpr (columns == 0)
      return paused_alone_;
    else
      return paused_[c];
  }
  void forget_paused() {
    for (auto& paused : paused_) paused.walk.reset();
    paused_alone_.walk.reset();
  }

  const HostThreads& threads_;
  const ChunkMarchProblem& problem_;
  Packing<m, u> packing_;
  std::vector<Maps<m, u>> maps_;
  std::vector<Piece<m, u>> pieces_;
  std::vector<int> known_;
  Rows x_, y_;
  std::unique_ptr<Rows> impulse_;
  Scene<m, u> scene_;
  std::vector<double> s_, D_;
  std::vector<Memory<u>> before_, began_;
  std::vector<End<m, u>> end_;
  std::vector<std::uint64_t> sets_;
  std::vector<unsigned char> open_;
  States<m, u> states_;
  std::vector<Paused<m>> paused_;  ///< by chunk
  Paused<0> paused_alone_;         ///< of a single one
};

}  // namespace
}  // namespace pieces

namespace {

constexpr std::size_t most_bytes_of_pieces = std::size_t(1) << 27;

std::size_t bytes_of_pieces(const ChunkMarchProblem& p) {
  return p.steps.size() * std::size_t(ChunkMarch::most_pieces) * pieces::with_sizes(p, [](auto m, auto u, auto) {
           return sizeof(pieces::Piece<decltype(m)::is, decltype(u)::is>);
         });
}

}  // namespace

bool fits_chunk_march(const ChunkMarchProblem& p) {
  return p.m >= 1 && p.m <= pieces::most_states && p.n >= 1 && p.unknowns() <= pieces::most_unknowns &&
         p.sources.cols() <= pieces::most_sources && p.kinds <= 128 && bytes_of_pieces(p) <= most_bytes_of_pieces;
}

std::unique_ptr<ChunkMarch> chunk_march_on_host(const HostThreads& threads, const ChunkMarchProblem& p) {
  return pieces::with_sizes(p, [&](auto m, auto u, auto rule) -> std::unique_ptr<ChunkMarch> {
    return std::make_unique<pieces::HostChunks<decltype(m)::is, decltype(u)::is, decltype(rule)::is>>(threads, p);
  });
}

}  // namespace bromwich
