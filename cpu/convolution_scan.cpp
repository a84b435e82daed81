// Causal convolution along time as a recurrence with state z (core/recurrence.hpp).
//
// Modal: eight modes move together in one vector; the K exponentials of a mode are taken `group` at a time, so that
// states and decay factors of a group stay in registers while time runs over a tile that stays in L1. Per time point,
// mode and exponential: two multiply-adds and no memory traffic. States at the start of every tile are kept, so a later
// call can begin at any tile whose past has not changed.
//
// Where there are fewer blocks of modes than threads, time is cut into chunks: (1) the state each chunk adds, from
// zero; (2) carry: z at the start of chunk c+1 = E^length z at the start of c + what c adds; (3) apply.

#include "cpu/parts.hpp"
#include "cpu/simd.hpp"

#include <omp.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich::cpu {

namespace {

constexpr Index group = 8;   ///< exponentials advanced together: 8 states + 8 decays + a few more fill 32 registers
constexpr Index tile = 128;  ///< time points per tile: y and v of a block take 2 x 8 KB

// One group of exponentials of one block of modes.
struct Bank {
  Lanes decay[group], output[group];
};

// v_j += C z_{j-1}, z_j = E z_{j-1} + y_j over `count` rows.
inline void advance(const Bank& bank, Lanes* z, const Lanes* y, Lanes* v, Index count) {
  Lanes s[group];
  for (Index g = 0; g < group; ++g) s[g] = z[g];
  for (Index j = 0; j < count; ++j) {
    Lanes even = v[j], odd = bank.output[1] * s[1];
    const Lanes input = y[j];
    even += bank.output[0] * s[0];
    for (Index g = 2; g < group; g += 2) {
      even += bank.output[g] * s[g];
      odd += bank.output[g + 1] * s[g + 1];
    }
    for (Index g = 0; g < group; ++g) s[g] = bank.decay[g] * s[g] + input;
    v[j] = even + odd;
  }
  for (Index g = 0; g < group; ++g) z[g] = s[g];
}

// The same without output: what a stretch of time adds to the state.
inline void accumulate(const Bank& bank, Lanes* z, const Lanes* y, Index count) {
  for (Index j = 0; j < count; ++j)
    for (Index g = 0; g < group; ++g) z[g] = bank.decay[g] * z[g] + y[j];
}

class ModalScan final : public Convolution {
 public:
  ModalScan(const ModalRecurrence& r, Index rows, int threads)
      : rows_(rows),
        n_(r.modes()),
        blocks_(blocks(n_)),
        groups_((r.exponentials() + group - 1) / group),
        tiles_(std::max<Index>(1, (rows - 1 + tile - 1) / tile)),
        threads_(threads),
        chunks_(std::clamp<Index>(blocks_ >= threads ? 1 : threads / blocks_, 1, tiles_)) {
    banks_.resize(std::size_t(blocks_ * groups_));
    start_.resize(banks_.size() * group);
    initial_.resize(banks_.size() * group);
    w0_.resize(std::size_t(blocks_));
    w1_.resize(w0_.size());
    s1_.resize(w0_.size());
    states_.resize(std::size_t(blocks_ * tiles_ * groups_ * group));
    for (Index l = 0; l < n_; ++l) pack(r, l);
  }

  void apply(const Array& y_array, Array& v_array, Index first) override {
    const RowMatrix& y = host(y_array);
    RowMatrix& v = host(v_array);
    if (first == 0) v.row(0).setZero();
    const Index from = std::max<Index>(first - 1, 0) / tile;
    if (from >= tiles_) return;
    const Index chunk = (tiles_ - from + chunks_ - 1) / chunks_;
#pragma omp parallel num_threads(threads_)
    {
      const FlushDenormals flush;
      if (chunks_ > 1) {
#pragma omp for collapse(2) schedule(static)
        for (Index b = 0; b < blocks_; ++b)
          for (Index c = 0; c < chunks_ - 1; ++c) accumulate_chunk(y, b, from + c * chunk, from + (c + 1) * chunk);
#pragma omp for schedule(static)
        for (Index b = 0; b < blocks_; ++b) carry(y, b, from, chunk);
      }
#pragma omp for collapse(2) schedule(dynamic, 1)
      for (Index b = 0; b < blocks_; ++b)
        for (Index c = 0; c < chunks_; ++c)
          apply_tiles(y, v, b, from + c * chunk, std::min(tiles_, from + (c + 1) * chunk), c == 0 && from == 0);
    }
  }

  std::size_t bytes() const override {
    return banks_.size() * sizeof(Bank) +
           sizeof(Lanes) * (start_.size() + initial_.size() + states_.size() + 3 * w0_.size());
  }

 private:
  void pack(const ModalRecurrence& r, Index l) {
    const Index b = l / lanes, lane = l % lanes;
    w0_[std::size_t(b)][lane] = r.w0[l];
    w1_[std::size_t(b)][lane] = r.w1[l];
    s1_[std::size_t(b)][lane] = r.s1[l];
    for (Index k = 0; k < r.exponentials(); ++k) {
      Bank& bank = banks_[std::size_t(b * groups_ + k / group)];
      bank.decay[k % group][lane] = r.decay(k, l);
      bank.output[k % group][lane] = r.output(k, l);
      start_[std::size_t(b * groups_ * group + k)][lane] = r.start(k, l);
      if (r.initial.size() > 0) initial_[std::size_t(b * groups_ * group + k)][lane] = r.initial(k, l);
    }
  }

  Lanes* state(Index b, Index t) { return &states_[std::size_t((b * tiles_ + t) * groups_ * group)]; }

  // Rows 1 + t*tile .. of tile t; the last tile ends at row rows_-1.
  Index tile_begin(Index t) const { return 1 + t * tile; }
  Index tile_rows(Index t) const { return std::min(rows_, tile_begin(t + 1)) - tile_begin(t); }

  void gather(const RowMatrix& y, Index b, Index begin, Index count, Lanes* to) const {
    const Index l = b * lanes, width = std::min(lanes, n_ - l);
    for (Index j = 0; j < count; ++j) {
      const double* row = y.data() + (begin + j) * n_ + l;
      if (width == lanes) {
        to[j] = load(row);
      } else {
        to[j] = all(0);
        for (Index i = 0; i < width; ++i) to[j][i] = row[i];
      }
    }
  }

  void scatter(RowMatrix& v, Index b, Index begin, Index count, const Lanes* from) const {
    const Index l = b * lanes, width = std::min(lanes, n_ - l);
    for (Index j = 0; j < count; ++j) {
      double* row = v.data() + (begin + j) * n_ + l;
      if (width == lanes)
        store(row, from[j]);
      else
        for (Index i = 0; i < width; ++i) row[i] = from[j][i];
    }
  }

  // z before row 1: the column of y_0 and what x0 adds.
  void start_state(const RowMatrix& y, Index b, Lanes* z) const {
    Lanes y0;
    gather(y, b, 0, 1, &y0);
    for (Index k = 0; k < groups_ * group; ++k)
      z[k] = start_[std::size_t(b * groups_ * group + k)] * y0 + initial_[std::size_t(b * groups_ * group + k)];
  }

  // What tiles [t0, t1) add to a zero state, left in the slot of tile t1.
  void accumulate_chunk(const RowMatrix& y, Index b, Index t0, Index t1) {
    if (t1 >= tiles_) return;
    Lanes input[tile];
    Lanes* z = state(b, t1);
    std::fill(z, z + groups_ * group, all(0));
    for (Index t = t0; t < t1; ++t) {
      gather(y, b, tile_begin(t), tile_rows(t), input);
      for (Index g = 0; g < groups_; ++g)
        accumulate(banks_[std::size_t(b * groups_ + g)], z + g * group, input, tile_rows(t));
    }
  }

  void carry(const RowMatrix& y, Index b, Index from, Index chunk) {
    if (from == 0) start_state(y, b, state(b, 0));
    for (Index t = from; t + chunk < tiles_; t += chunk) {
      const Lanes* before = state(b, t);
      Lanes* after = state(b, t + chunk);
      for (Index g = 0; g < groups_; ++g)
        for (Index e = 0; e < group; ++e)
          for (Index lane = 0; lane < lanes; ++lane)
            after[g * group + e][lane] +=
                std::pow(banks_[std::size_t(b * groups_ + g)].decay[e][lane], double(chunk * tile)) *
                before[g * group + e][lane];
    }
  }

  void apply_tiles(const RowMatrix& y, RowMatrix& v, Index b, Index t0, Index t1, bool from_start) {
    if (t0 >= t1) return;
    Lanes input[tile + 1], out[tile];
    std::vector<Lanes>& z = scratch(groups_ * group);
    if (from_start) start_state(y, b, state(b, 0));
    std::copy_n(state(b, t0), groups_ * group, z.data());
    const Lanes w0 = w0_[std::size_t(b)], w1 = w1_[std::size_t(b)], s1 = s1_[std::size_t(b)];
    for (Index t = t0; t < t1; ++t) {
      if (t > t0) std::copy_n(z.data(), groups_ * group, state(b, t));
      const Index begin = tile_begin(t), count = tile_rows(t);
      gather(y, b, begin - 1, count + 1, input);
      for (Index j = 0; j < count; ++j) out[j] = w0 * input[j + 1] + w1 * input[j];
      if (t == 0) out[0] += (s1 - w1) * input[0];
      for (Index g = 0; g < groups_; ++g)
        advance(banks_[std::size_t(b * groups_ + g)], z.data() + g * group, input + 1, out, count);
      scatter(v, b, begin, count, out);
    }
  }

  // Per-thread state buffer that grows once.
  static std::vector<Lanes>& scratch(Index size) {
    static thread_local std::vector<Lanes> buffer;
    if (Index(buffer.size()) < size) buffer.resize(std::size_t(size));
    return buffer;
  }

  Index rows_, n_, blocks_, groups_, tiles_;
  int threads_;
  Index chunks_;
  std::vector<Bank> banks_;
  std::vector<Lanes> start_, initial_, states_, w0_, w1_, s1_;
};

// The state of the scene itself as z. Chunks of time run in parallel; E^length carries them over.
class DenseScan final : public Convolution {
 public:
  DenseScan(const DenseRecurrence& r, Index rows, int threads)
      : r_(r),
        threads_(threads),
        length_(std::max(shortest_chunk(r), (rows - 1 + threads - 1) / threads)),
        chunks_(std::max<Index>(1, (rows - 1 + length_ - 1) / length_)),
        states_(r.decay.rows(), chunks_ + 1),
        next_(r.decay.rows(), chunks_),
        fresh_(r.decay.rows(), chunks_),
        power_(Matrix::Identity(r.decay.rows(), r.decay.rows())) {
    if (chunks_ > 1)
      for (Index i = 0; i < length_; ++i) power_ = power_ * r_.decay;
  }

  void apply(const Array& y_array, Array& v_array, Index first) override {
    const RowMatrix& y = host(y_array);
    RowMatrix& v = host(v_array);
    const Index from = std::max<Index>(first - 1, 0) / length_;
    if (first == 0) v.row(0).setZero();
    if (from >= chunks_) return;
    if (from == 0) states_.col(0) = r_.start * y.row(0).transpose();
    if (chunks_ - from == 1) {
      next_.col(from) = states_.col(from);
      return run(y, &v, from);
    }
#pragma omp parallel num_threads(threads_)
    {
      const FlushDenormals flush;
#pragma omp for schedule(static)
      for (Index c = from; c < chunks_ - 1; ++c) {
        next_.col(c).setZero();
        run(y, nullptr, c);
      }
#pragma omp single
      for (Index c = from; c < chunks_ - 1; ++c) states_.col(c + 1) = power_ * states_.col(c) + next_.col(c);
#pragma omp for schedule(static)
      for (Index c = from; c < chunks_; ++c) {
        next_.col(c) = states_.col(c);
        run(y, &v, c);
      }
    }
  }

  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(states_.size() + 2 * next_.size() + power_.size() + 3 * r_.decay.size());
  }

 private:
  // Below some 10^5 operations a chunk costs less than waking a thread for it.
  static Index shortest_chunk(const DenseRecurrence& r) {
    const Index m = r.decay.rows(), n = r.output.rows(), k = r.input.cols();
    return std::max<Index>(tile, (1 << 17) / (1 + m * m + m * n + m * k + n * k));
  }

  // Advances next_.col(c) over the rows of chunk c; with v, writes the output on the way.
  void run(const RowMatrix& y, RowMatrix* v, Index c) {
    const Index m = r_.decay.rows(), n = r_.output.rows(), k = r_.input.cols();
    const Index begin = 1 + c * length_, end = std::min(y.rows(), begin + length_);
    double* z = next_.col(c).data();
    double* fresh = fresh_.col(c).data();
    for (Index j = begin; j < end; ++j) {
      const double* u = y.data() + j * k;
      if (v) {
        double* out = v->data() + j * n;
        for (Index i = 0; i < n; ++i) {
          double sum = 0;
          for (Index e = 0; e < m; ++e) sum += r_.output(i, e) * z[e];
          for (Index e = 0; e < k; ++e) sum += r_.w0(i, e) * u[e];
          out[i] = sum;
        }
      }
      for (Index i = 0; i < m; ++i) {
        double sum = 0;
        for (Index e = 0; e < m; ++e) sum += r_.decay(i, e) * z[e];
        for (Index e = 0; e < k; ++e) sum += r_.input(i, e) * u[e];
        fresh[i] = sum;
      }
      std::copy_n(fresh, m, z);
    }
  }

  DenseRecurrence r_;
  int threads_;
  Index length_, chunks_;
  Matrix states_, next_, fresh_, power_;
};

}  // namespace

std::unique_ptr<Convolution> make_scan(const ModalRecurrence& r, Index rows, int threads) {
  return std::make_unique<ModalScan>(r, rows, threads);
}

std::unique_ptr<Convolution> make_scan(const DenseRecurrence& r, Index rows, int threads) {
  return std::make_unique<DenseScan>(r, rows, threads);
}

}  // namespace bromwich::cpu
