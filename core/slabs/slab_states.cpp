#include "core/slabs/slab_states.hpp"

#include "core/base/denormals.hpp"
#include "core/base/simd.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

namespace bromwich {

namespace {

using simd::Lanes;
using simd::lanes;

constexpr Index group = 8;     ///< exponentials whose states and decays stay in registers
constexpr Index together = 4;  ///< blocks of modes, neighbours in each row
constexpr Index tile = 64;     ///< rows of them, 16 KB
using Tile = Lanes[together][tile];

// Eight exponentials of eight modes.
struct Bank {
  Lanes E[group], z[group];

  bool nothing() const {
    return std::all_of(z, z + group, [](const Lanes& one) { return !simd::any(one != simd::all(0)); });
  }
  // z <- the state after `count` more values.
  void advance(const Lanes* y, Index count) {
    Lanes decay[group], state[group];
    std::copy_n(E, group, decay);
    std::copy_n(z, group, state);
    for (Index j = 0; j < count; ++j)
      for (Index g = 0; g < group; ++g) state[g] = decay[g] * state[g] + y[j];
    std::copy_n(state, group, z);
  }
  // v_j += z, z <- E z.
  void add(Lanes* v, Index count) {
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

// Up to 32 neighbouring modes with all their exponentials, padded with 0.
struct Bunch {
  Index begin, count;  ///< columns

  Index blocks() const { return simd::blocks(count); }
  Index width(Index block) const { return std::min(lanes, count - block * lanes); }

  std::vector<Bank> banks(const RowMatrix& decay, const double* z) const {
    const Index n = decay.cols(), K = decay.rows();
    std::vector<Bank> all(std::size_t(blocks() * ((K + group - 1) / group)), Bank{});
    for (Index b = 0; b < blocks(); ++b)
      for (Index k = 0; k < K; ++k) {
        Bank& bank = all[std::size_t(k / group * blocks() + b)];
        for (Index i = 0; i < width(b); ++i) {
          const Index column = begin + b * lanes + i;
          bank.E[k % group][i] = decay(k, column);
          bank.z[k % group][i] = z[k * n + column];
        }
      }
    return all;
  }
  void take(const std::vector<Bank>& banks, Index K, Index n, double* z) const {
    for (Index b = 0; b < blocks(); ++b)
      for (Index k = 0; k < K; ++k)
        for (Index i = 0; i < width(b); ++i)
          z[k * n + begin + b * lanes + i] = banks[std::size_t(k / group * blocks() + b)].z[k % group][i];
  }
  void read(HostRows& rows, Index first, Index length, Tile& to) const {
    for (Index j = 0; j < length; ++j) {
      const double* row = rows.row(first + j) + begin;
      for (Index b = 0; b < blocks(); ++b) {
        Lanes values = simd::all(0);
        std::memcpy(&values, row + b * lanes, sizeof(double) * std::size_t(width(b)));
        to[b][j] = values;
      }
    }
  }
  void write(const Tile& from, Index first, Index length, HostRows& rows) const {
    for (Index j = 0; j < length; ++j) {
      double* row = rows.row(first + j) + begin;
      for (Index b = 0; b < blocks(); ++b)
        std::memcpy(row + b * lanes, &from[b][j], sizeof(double) * std::size_t(width(b)));
    }
  }
};

void in_bunches(Index n, const HostThreads& threads, const std::function<void(const Bunch&)>& body) {
  constexpr Index width = together * lanes;
  threads.each_range((n + width - 1) / width, 1, [&](Index first, Index last) {
    const FlushDenormals flush;  // forgotten parts decay further
    for (Index b = first; b < last; ++b) body({b * width, std::min(width, n - b * width)});
  });
}

}  // namespace

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
  slowest_ = K_ > 0 ? Vector(decay_.cwiseAbs().colwise().maxCoeff().transpose()) : Vector(Vector::Zero(n_));
}

Vector ModalState::start(const double* y0) const {
  RowMatrix z = initial_;
  for (Index k = 0; k < K_; ++k) z.row(k) += start_.row(k).cwiseProduct(Eigen::Map<const Eigen::RowVectorXd>(y0, n_));
  return Eigen::Map<const Vector>(z.data(), z.size());
}

void ModalState::start_from(const RowMatrix& D) {
  initial_ = (decay_.array() == 0).select(0, D.array() * decay_.array() / output_.array());
}

void ModalState::advance(HostRows& y, Index rows, const HostThreads& threads, Vector& z) const {
  in_bunches(n_, threads, [&](const Bunch& bunch) {
    const Index known = remembered(slowest_.segment(bunch.begin, bunch.count).maxCoeff(), rows);
    std::vector<Bank> banks = bunch.banks(decay_, z.data());
    if (known < rows)
      for (Bank& bank : banks) std::fill_n(bank.z, group, simd::all(0));
    Tile in;
    for (Index j = rows - known + 1; j <= rows; j += tile) {
      const Index length = std::min(tile, rows + 1 - j);
      bunch.read(y, j, length, in);
      for (std::size_t i = 0; i < banks.size(); ++i) banks[i].advance(in[Index(i) % bunch.blocks()], length);
    }
    bunch.take(banks, K_, n_, z.data());
  });
}

Index ModalState::add(const Vector& z, Index rows, const HostThreads& threads, HostRows& v) const {
  std::atomic<Index> last = 0;
  Vector seen = z;  // C z
  Eigen::Map<RowMatrix>(seen.data(), K_, n_).array() *= output_.array();
  in_bunches(n_, threads, [&](const Bunch& bunch) {
    const Index known = remembered(slowest_.segment(bunch.begin, bunch.count).maxCoeff(), rows);
    std::vector<Bank> banks = bunch.banks(decay_, seen.data());
    if (std::all_of(banks.begin(), banks.end(), [](const Bank& bank) { return bank.nothing(); })) return;
    for (Index before = last; before < known && !last.compare_exchange_weak(before, known);) {
    }
    Tile out;
    for (Index j = 1; j <= known; j += tile) {
      const Index length = std::min(tile, known + 1 - j);
      bunch.read(v, j, length, out);
      for (std::size_t i = 0; i < banks.size(); ++i) banks[i].add(out[Index(i) % bunch.blocks()], length);
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

void ModalState::carry(const std::vector<Index>& which, Index steps, Vector& values) const {
  for (std::size_t i = 0; i < which.size(); ++i) values[Index(i)] *= std::pow(decay_.data()[which[i]], double(steps));
}

// The memory ends with the first power, by doubling, that is forgotten: its norm bounds those of later ones.
DenseState::DenseState(const DenseRecurrence& r) : r_(r) {
  constexpr Index without_end = Index(1) << 30;
  for (Matrix power = r.decay; memory_ < without_end; power = (power * power).eval(), memory_ *= 2)
    if (power.cwiseAbs().rowwise().sum().maxCoeff() <= forgotten) break;
}

Vector DenseState::start(const double* y0) const { return r_.start * Eigen::Map<const Vector>(y0, r_.start.cols()); }

void DenseState::advance(HostRows& y, Index rows, const HostThreads&, Vector& z) const {
  const Index known = std::min(memory_, rows);
  if (known < rows) z.setZero();
  Vector fresh(z.size());
  for (Index j = rows - known + 1; j <= rows; ++j) {
    fresh.noalias() = r_.decay * z;
    fresh.noalias() += r_.input * Eigen::Map<const Vector>(y.row(j), r_.input.cols());
    z.swap(fresh);
  }
}

Index DenseState::add(const Vector& carried, Index rows, const HostThreads&, HostRows& v) const {
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

void DenseState::carry(const std::vector<Index>& which, Index steps, Vector& values) const {
  if (!which.empty()) values = matrix_power(r_.decay, steps) * values;
}

}  // namespace bromwich
