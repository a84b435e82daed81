// Causal convolution along time with one scalar kernel per mode, eight modes at a time. Modes with a short memory use
// the direct sum over lags, the others a scan of exponentials.
//
// A thread processes one tile of rows for a bunch of neighbouring blocks of modes. Rows of direct sums are independent;
// scans run from tile to tile. Where one scan exceeds a thread's share of the work, it becomes a chunked scan:
// (1) accumulate: the state that each chunk adds to zero; (2) carry: z at the start of chunk c+1 = E^length z at the
// start of c + what c adds; (3) apply.

#include "core/kernel/memory_length.hpp"
#include "cpu/convolution_direct.hpp"
#include "cpu/convolution_scan.hpp"
#include "cpu/mode_blocks.hpp"
#include "cpu/parts.hpp"

#include <algorithm>
#include <memory>
#include <vector>

namespace bromwich::cpu {

namespace {

constexpr Index most_together = 8;  ///< blocks per bunch: 512 bytes of a row
constexpr Index page = 4096 / sizeof(Lanes);
constexpr Index tile = ScanBlock::tile;
constexpr Index stride = tile + 1;  ///< between the columns of a bunch; odd, to avoid cache set conflicts

template <typename Block>
struct Bunch {
  ModeBlocks modes;
  std::vector<Block> blocks;
};

// Memory length of each block, in lags.
std::vector<Index> remembered(const ModalRecurrence& r, Index rows) {
  const std::vector<Index> of_modes = memory_lengths(r, rows - 1);
  std::vector<Index> lags(std::size_t(blocks(r.modes())), 0);
  for (std::size_t l = 0; l < of_modes.size(); ++l) lags[l / lanes] = std::max(lags[l / lanes], of_modes[l]);
  return lags;
}

class ModalConvolution final : public Convolution {
 public:
  ModalConvolution(const ModalRecurrence& r, Index rows, Team& team)
      : rows_(rows),
        team_(team),
        tiles_(ScanBlock::tiles(rows)),
        exponentials_(r.exponentials()),
        scanned_(std::size_t(r.modes())) {
    const FlushDenormals flush;
    const std::vector<Index> lags = remembered(r, rows);
    const double scan = ScanBlock::cost(r);
    const auto direct = [&](Index D) { return DirectBlock::cost(D, rows, r.exponentials()); };
    double work = 0;
    Index scans = 0;
    for (const Index D : lags) {
      scans += direct(D) >= scan;
      work += std::min(direct(D), scan);
    }
    chunks_ = std::clamp<Index>(Index(double(team.threads()) * scan / std::max(work, scan)), 1, tiles_);
    const Index count = Index(lags.size());
    const Index scans_together = shared(scans), sums_together = shared((count - scans) * tiles_);
    for (Index b = 0; b < count; ++b) {
      const Index D = lags[std::size_t(b)];
      if (direct(D) < scan)
        place(sums_, b, sums_together).emplace_back(r, b, D);
      else
        place(scans_, b, scans_together).emplace_back(r, b, rows);
      for (Index l = b * lanes; l < std::min(r.modes(), (b + 1) * lanes); ++l)
        scanned_[std::size_t(l)] = !(direct(D) < scan);
    }
    for (const auto& bunch : sums_)
      for (const DirectBlock& block : bunch.blocks) past_ = std::max(past_, block.past(rows));
    begin_with = [this](const Vector& z) -> const std::vector<bool>& { return take_state(z); };
    if (sums_.empty()) start_from = [this](const Array& D) { take_start(D); };  // x0 is in the tables of sums
  }

  void apply(const Array& y_array, Array& v_array, Index first) override {
    const RowMatrix& y = host(y_array);
    RowMatrix& v = host(v_array);
    if (first == 0) v.row(0).setZero();
    first = std::max<Index>(first, 1);
    if (first >= rows_) return;
    const Index from = (first - 1) / tile, chunk = (tiles_ - from + chunks_ - 1) / chunks_;
    const Index scans = Index(scans_.size()), sums = Index(sums_.size());
    if (chunks_ > 1) {
      team_.share(scans * (chunks_ - 1), [&](Index i, int) {
        const FlushDenormals flush;
        const Index c = i % (chunks_ - 1);
        accumulate(y, scans_[std::size_t(i / (chunks_ - 1))], from + c * chunk, from + (c + 1) * chunk);
      });
      team_.share(scans, [&](Index s, int) {
        for (ScanBlock& block : scans_[std::size_t(s)].blocks) block.carry(from, chunk, tiles_);
      });
    }
    // Scans are longer than sums and begin first.
    const Index scanned = scans * chunks_, summed = (rows_ - first + tile - 1) / tile * sums;
    team_.share(scanned + summed, [&](Index i, int) {
      const FlushDenormals flush;
      if (i < scanned) {
        const Index c = i % chunks_;
        return scan(y, v, scans_[std::size_t(i / chunks_)], from + c * chunk, std::min(tiles_, from + (c + 1) * chunk));
      }
      const Index begin = first + (i - scanned) / sums * tile;
      sum(y, v, sums_[std::size_t((i - scanned) % sums)], begin, std::min(rows_, begin + tile));
    });
  }

  void take_start(const Array& D) {
    for (auto& bunch : scans_)
      for (Index i = 0; i < bunch.modes.count; ++i)
        bunch.blocks[std::size_t(i)].start_from(host(D), bunch.modes.first + i);
  }

  const std::vector<bool>& take_state(const Vector& z) {
    for (auto& bunch : scans_)
      for (Index i = 0; i < bunch.modes.count; ++i)
        bunch.blocks[std::size_t(i)].begin_with(z.data(), exponentials_, Index(scanned_.size()), bunch.modes.first + i);
    return scanned_;
  }

  std::size_t bytes() const override {
    std::size_t all = 0;
    for (const auto& bunch : scans_)
      for (const ScanBlock& block : bunch.blocks) all += block.bytes();
    for (const auto& bunch : sums_)
      for (const DirectBlock& block : bunch.blocks) all += block.bytes();
    return all;
  }

 private:
  // Blocks per bunch, so that `parts` units of work keep all threads busy.
  Index shared(Index parts) const { return std::clamp<Index>(parts / (2 * team_.threads()), 1, most_together); }

  // The bunch that takes block b: the last one if b is its neighbour and it has fewer than `together` blocks, else a
  // new one.
  template <typename Block>
  static std::vector<Block>& place(std::vector<Bunch<Block>>& bunches, Index b, Index together) {
    if (bunches.empty() || bunches.back().modes.count == together ||
        bunches.back().modes.first + bunches.back().modes.count != b)
      bunches.push_back({{b, 0}, {}});
    ++bunches.back().modes.count;
    return bunches.back().blocks;
  }

  // Buffers of a thread for one bunch: y with its past, and v. The offset of v_j modulo a page is just behind that of
  // y_j: a load stalls on an earlier store with the same page offset (4K aliasing).
  Index input_size() const { return (most_together * (past_ + stride) / page + 1) * page + 1; }
  Lanes* inputs() const { return workspace(input_size() + most_together * stride); }
  Lanes* outputs() const { return inputs() + input_size(); }

  // One buffer per thread, shared by all plans.
  static Lanes* workspace(Index size) {
    static thread_local std::vector<Lanes> values;
    if (Index(values.size()) < size) values.resize(std::size_t(size));
    return values.data();
  }

  Index count(Index t) const { return std::min(rows_, ScanBlock::begin(t + 1)) - ScanBlock::begin(t); }

  // The state that tiles [t0, t1) add to zero.
  void accumulate(const RowMatrix& y, Bunch<ScanBlock>& bunch, Index t0, Index t1) {
    if (t1 >= tiles_) return;
    Lanes* const in = inputs();
    for (ScanBlock& block : bunch.blocks) block.clear(t1);
    for (Index t = t0; t < t1; ++t) {
      bunch.modes.gather(y, ScanBlock::begin(t) - 1, tile + 1, in, stride);
      for (Index i = 0; i < bunch.modes.count; ++i)
        bunch.blocks[std::size_t(i)].accumulate(in + i * stride, t, tile, t1);
    }
  }

  void scan(const RowMatrix& y, RowMatrix& v, Bunch<ScanBlock>& bunch, Index t0, Index t1) {
    Lanes *const in = inputs(), *const out = outputs();
    for (Index t = t0; t < t1; ++t) {
      bunch.modes.gather(y, ScanBlock::begin(t) - 1, count(t) + 1, in, stride);
      for (Index i = 0; i < bunch.modes.count; ++i)
        bunch.blocks[std::size_t(i)].apply(in + i * stride, out + i * stride, t, count(t), t + 1 < t1);
      bunch.modes.scatter(out, stride, ScanBlock::begin(t), count(t), v);
    }
  }

  void sum(const RowMatrix& y, RowMatrix& v, const Bunch<DirectBlock>& bunch, Index begin, Index end) {
    Lanes *const in = inputs(), *const out = outputs();
    Lanes y0[most_together];
    Index past = 0;
    for (const DirectBlock& block : bunch.blocks) past = std::max(past, block.past(begin));
    const Index given = std::min(past, begin - 1), step = past / 2 * 2 + stride;
    for (Index i = 0; i < bunch.modes.count; ++i) {
      std::fill_n(in + i * step, past - given, all(0));
      std::fill(in + i * step + past + (end - begin), in + (i + 1) * step, all(0));
    }
    bunch.modes.gather(y, begin - given, given + end - begin, in + past - given, step);
    bunch.modes.gather(y, 0, 1, y0, 1);
    for (Index i = 0; i < bunch.modes.count; ++i)
      bunch.blocks[std::size_t(i)].apply(in + i * step + past, y0[i], out + i * stride, begin, end - begin);
    bunch.modes.scatter(out, stride, begin, end - begin, v);
  }

  Index rows_;
  Team& team_;
  Index tiles_, exponentials_, chunks_ = 1, past_ = 0;
  std::vector<bool> scanned_;  ///< modes, with a state
  std::vector<Bunch<ScanBlock>> scans_;
  std::vector<Bunch<DirectBlock>> sums_;
};

}  // namespace

std::unique_ptr<Convolution> make_convolution(const ModalRecurrence& r, Index rows, Team& team) {
  return std::make_unique<ModalConvolution>(r, rows, team);
}

}  // namespace bromwich::cpu
