#include "ranks/slab_states.hpp"

#include "core/base/denormals.hpp"
#include "core/base/simd.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>

namespace bromwich {

namespace {

using simd::Lanes;
using simd::lanes;

constexpr Index group = 8;     ///< exponentials whose states and decays stay in registers
constexpr Index together = 4;  ///< blocks of modes, neighbours in each row
constexpr Index tile = 64;     ///< rows of them, 16 KB
using Tile = Lanes[together][tile];

}  // namespace

// Up to 32 neighbouring modes with all their exponentials, padded with 0: bank k / group * blocks + b has those of
// block b.
struct ModalState::Bunch {
  // Eight exponentials of eight modes.
  struct Bank {
    Lanes E[group] = {}, C[group] = {};
    Index known = 0;  ///< rows after which all of them are forgotten

    // z <- the state after `count` more values.
    void advance(const Lanes* y, Index count, Lanes* z) const {
      Lanes decay[group], state[group];
      std::copy_n(E, group, decay);
      std::copy_n(z, group, state);
      for (Index j = 0; j < count; ++j)
        for (Index g = 0; g < group; ++g) state[g] = decay[g] * state[g] + y[j];
      std::copy_n(state, group, z);
    }
    // v_j += z, z <- E z.
    void add(Lanes* z, Lanes* v, Index count) const {
      Lanes decay[group], state[group];
      std::copy_n(E, group, decay);
      std::copy_n(z, group, state);
      for (Index j = 0; j < count; ++j) {
        Lanes even = v[j] + state[0], odd = state[1];
        for (Index g = 2; g < group; g += 2) {
          even += state[g];
          odd += state[g + 1];
        }
        v[j] = even + odd;
        for (Index g = 0; g < group; ++g) state[g] *= decay[g];
      }
      std::copy_n(state, group, z);
    }
  };

  Index begin, count, K, n;  ///< begin, count: columns
  std::vector<Bank> banks;

  Bunch(const ModalRecurrence& r, Index begin_in)
      : begin(begin_in),
        count(std::min(together * lanes, r.modes() - begin_in)),
        K(r.exponentials()),
        n(r.modes()),
        banks(std::size_t(blocks() * ((K + group - 1) / group))) {
    constexpr Index without_end = std::numeric_limits<Index>::max();
    for (Index k = 0; k < K; ++k)
      for (Index l = 0; l < count; ++l) {
        Bank& bank = banks[place(k, l / lanes) / group];
        const double E = r.decay(k, begin + l);
        bank.E[k % group][l % lanes] = E;
        bank.C[k % group][l % lanes] = r.output(k, begin + l);
        bank.known = std::max(bank.known, remembered(std::abs(E), without_end));
      }
  }

  Index blocks() const { return simd::blocks(count); }
  Index width(Index block) const { return std::min(lanes, count - block * lanes); }
  std::size_t bytes_of(Index block) const { return sizeof(double) * std::size_t(width(block)); }

  // The values of K x n that belong to the banks, one bank after the other.
  std::vector<Lanes> take(const double* z) const {
    std::vector<Lanes> state(banks.size() * std::size_t(group), simd::all(0));
    for (Index k = 0; k < K; ++k)
      for (Index b = 0; b < blocks(); ++b) std::memcpy(&state[place(k, b)], z + k * n + begin + b * lanes, bytes_of(b));
    return state;
  }
  void give(const std::vector<Lanes>& state, double* z) const {
    for (Index k = 0; k < K; ++k)
      for (Index b = 0; b < blocks(); ++b) std::memcpy(z + k * n + begin + b * lanes, &state[place(k, b)], bytes_of(b));
  }
  std::size_t place(Index k, Index b) const { return std::size_t((k / group * blocks() + b) * group + k % group); }

  void read(HostRows& rows, Index first, Index length, Tile& to) const {
    for (Index j = 0; j < length; ++j) {
      const double* row = rows.row(first + j) + begin;
      for (Index b = 0; b < blocks(); ++b) {
        Lanes values = simd::all(0);
        std::memcpy(&values, row + b * lanes, bytes_of(b));
        to[b][j] = values;
      }
    }
  }
  void write(const Tile& from, Index first, Index length, HostRows& rows) const {
    for (Index j = 0; j < length; ++j) {
      double* row = rows.row(first + j) + begin;
      for (Index b = 0; b < blocks(); ++b) std::memcpy(row + b * lanes, &from[b][j], bytes_of(b));
    }
  }
};

Index remembered(double slowest, Index most) {
  if (slowest == 0) return std::min<Index>(1, most);
  if (!(slowest < 1)) return most;
  const double rows = std::ceil(std::log(forgotten) / std::log(slowest));
  return rows < double(most) ? std::max<Index>(1, Index(rows)) : most;
}

ModalRecurrence of_rank(const ModalRecurrence& r, bool first) {
  ModalRecurrence local = r;
  if (first) return local;
  local.initial.resize(0, 0);
  local.start.setZero();
  local.s1 = local.w1;
  return local;
}

Outliving outliving(const RowMatrix& decay, const std::vector<Index>& ends, int rank) {
  const int ranks = int(ends.size()) - 1;
  Outliving found;
  if (ranks <= 2) return found;
  Index shortest = ends.back();
  for (int r = 1; r + 1 < ranks; ++r) shortest = std::min(shortest, ends[std::size_t(r) + 1] - ends[std::size_t(r)]);
  for (Index i = 0; i < decay.size(); ++i)
    if (!(std::pow(std::abs(decay.data()[i]), double(shortest)) <= forgotten)) found.values.push_back(i);
  found.powers = RowMatrix::Zero(ranks, Index(found.values.size()));
  for (int r = 0; r + 1 < rank; ++r)
    for (std::size_t i = 0; i < found.values.size(); ++i)
      found.powers(r, Index(i)) =
          std::pow(decay.data()[found.values[i]], double(ends[std::size_t(rank)] - ends[std::size_t(r) + 1]));
  return found;
}

ModalState::ModalState(const ModalRecurrence& r)
    : K_(r.exponentials()), n_(r.modes()), decay_(r.decay), output_(r.output), start_(r.start), initial_(r.initial) {
  if (initial_.size() == 0) initial_ = RowMatrix::Zero(K_, n_);
  auto bunches = std::make_shared<std::vector<Bunch>>();
  for (Index begin = 0; begin < n_; begin += together * lanes) bunches->emplace_back(r, begin);
  bunches_ = std::move(bunches);
}

void ModalState::start(const double* y0, Eigen::Ref<Vector> z) const {
  Eigen::Map<RowMatrix>(z.data(), K_, n_) =
      initial_.array() + start_.array().rowwise() * Eigen::Map<const Eigen::RowVectorXd>(y0, n_).array();
}

void ModalState::start_from(const RowMatrix& D) {
  initial_ = (decay_.array() == 0).select(0, D.array() * decay_.array() / output_.array());
}

template <class Body>
void ModalState::in_bunches(const HostThreads& threads, const Body& body) const {
  threads.each_range(Index(bunches_->size()), 1, [&](Index first, Index last) {
    const FlushDenormals flush;  // forgotten parts decay further
    for (Index b = first; b < last; ++b) body((*bunches_)[std::size_t(b)]);
  });
}

// A bank begins, with 0, at the first tile whose rows it does not forget all.
void ModalState::advance(HostRows& y, Index rows, const HostThreads& threads, Eigen::Ref<Vector> z) const {
  in_bunches(threads, [&](const Bunch& bunch) {
    const std::size_t banks = bunch.banks.size();
    std::vector<Lanes> state = bunch.take(z.data());
    Index most = 0;
    for (std::size_t i = 0; i < banks; ++i) {
      const Index known = bunch.banks[i].known;
      most = std::max(most, std::min(known, rows));
      if (known < rows) std::fill_n(&state[i * std::size_t(group)], group, simd::all(0));
    }
    Tile in;
    for (Index j = rows - most + 1; j <= rows; j += tile) {
      const Index length = std::min(tile, rows + 1 - j);
      bunch.read(y, j, length, in);
      for (std::size_t i = 0; i < banks; ++i)
        if (const Bunch::Bank& bank = bunch.banks[i]; bank.known > rows - j - length)
          bank.advance(in[Index(i) % bunch.blocks()], length, &state[i * std::size_t(group)]);
    }
    bunch.give(state, z.data());
  });
}

Index ModalState::add(const Eigen::Ref<const Vector>& z, Index rows, const HostThreads& threads, HostRows& v) const {
  std::atomic<Index> last = 0;
  in_bunches(threads, [&](const Bunch& bunch) {
    const std::size_t banks = bunch.banks.size();
    std::vector<Lanes> state = bunch.take(z.data());  // C z
    std::vector<Index> known(banks, 0);
    for (std::size_t i = 0; i < banks; ++i) {
      bool something = false;
      for (Index g = 0; g < group; ++g) {
        Lanes& one = state[i * std::size_t(group) + std::size_t(g)];
        one *= bunch.banks[i].C[g];
        something = something || simd::any(one != simd::all(0));
      }
      if (something) known[i] = std::min(bunch.banks[i].known, rows);
    }
    const Index most = known.empty() ? 0 : *std::max_element(known.begin(), known.end());
    for (Index before = last; before < most && !last.compare_exchange_weak(before, most);) {
    }
    Tile out;
    for (Index j = 1; j <= most; j += tile) {
      const Index length = std::min(tile, most + 1 - j);
      bunch.read(v, j, length, out);
      for (std::size_t i = 0; i < banks; ++i)
        if (known[i] >= j) bunch.banks[i].add(&state[i * std::size_t(group)], out[Index(i) % bunch.blocks()], length);
      bunch.write(out, j, length, v);
    }
  });
  return last;
}

std::vector<Index> ModalState::lasting(Index steps) const {
  std::vector<Index> found;
  for (Index i = 0; i < size(); ++i)
    if (!(std::pow(std::abs(decay_.data()[i]), double(steps)) <= forgotten)) found.push_back(i);
  return found;
}

Eigen::DiagonalMatrix<double, Eigen::Dynamic> ModalState::power(const std::vector<Index>& which, Index steps) const {
  Vector powers(Index(which.size()));
  for (std::size_t i = 0; i < which.size(); ++i) powers[Index(i)] = std::pow(decay_.data()[which[i]], double(steps));
  return Eigen::DiagonalMatrix<double, Eigen::Dynamic>(powers);
}

// The memory ends with the first power, by doubling, that is forgotten: its norm bounds those of later ones.
DenseState::DenseState(const DenseRecurrence& r) : r_(r) {
  constexpr Index without_end = Index(1) << 30;
  for (Matrix power = r.decay; memory_ < without_end; power = (power * power).eval(), memory_ *= 2)
    if (power.cwiseAbs().rowwise().sum().maxCoeff() <= forgotten) break;
}

void DenseState::start(const double* y0, Eigen::Ref<Vector> z) const {
  z = r_.start * Eigen::Map<const Vector>(y0, r_.start.cols());
}

void DenseState::advance(HostRows& y, Index rows, const HostThreads&, Eigen::Ref<Vector> end) const {
  const Index known = std::min(memory_, rows);
  Vector z = end, fresh(z.size());
  if (known < rows) z.setZero();
  for (Index j = rows - known + 1; j <= rows; ++j) {
    fresh.noalias() = r_.decay * z;
    fresh.noalias() += r_.input * Eigen::Map<const Vector>(y.row(j), r_.input.cols());
    z.swap(fresh);
  }
  end = z;
}

Index DenseState::add(const Eigen::Ref<const Vector>& carried, Index rows, const HostThreads&, HostRows& v) const {
  Vector z = carried, fresh(z.size());
  const Index last = std::min(memory_, rows);
  for (Index j = 1; j <= last; ++j) {
    Eigen::Map<Vector>(v.row(j), r_.output.rows()).noalias() += r_.output * z;
    fresh.noalias() = r_.decay * z;
    z.swap(fresh);
  }
  return last;
}

std::vector<Index> DenseState::lasting(Index steps) const {
  std::vector<Index> all;
  for (Index i = 0; steps < memory_ && i < size(); ++i) all.push_back(i);
  return all;
}

Matrix DenseState::power(const std::vector<Index>&, Index steps) const { return matrix_power(r_.decay, steps); }

}  // namespace bromwich
