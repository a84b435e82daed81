#include "core/slabs/slab_states.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index width = 32;  ///< modes side by side: a few lines of each row, and states that stay in the nearest cache
using Lanes = std::array<double, std::size_t(width)>;

// Rows after which `largest`^rows is forgotten, at most `most`.
Index remembered(double largest, Index most) {
  if (largest == 0) return std::min<Index>(1, most);
  if (!(largest < 1)) return most;
  const double rows = std::ceil(std::log(forgotten) / std::log(largest));
  return rows < double(most) ? std::max<Index>(1, Index(rows)) : most;
}

Lanes lanes_of(const double* values, Index count) {
  Lanes lanes{};
  if (count == width)
    std::copy_n(values, width, lanes.begin());
  else
    std::copy_n(values, count, lanes.begin());
  return lanes;
}

// Columns begin .. begin + count - 1 of a K x n table.
std::vector<Lanes> block(const double* table, Index K, Index n, Index begin, Index count) {
  std::vector<Lanes> rows;
  for (Index k = 0; k < K; ++k) rows.push_back(lanes_of(table + k * n + begin, count));
  return rows;
}

}  // namespace

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

void ModalState::in_blocks(const HostThreads& threads,
                           const std::function<void(Index begin, Index count)>& body) const {
  if (K_ == 0) return;
  threads.each_range((n_ + width - 1) / width, 1, [&](Index first, Index last) {
    for (Index b = first; b < last; ++b) body(b * width, std::min(width, n_ - b * width));
  });
}

void ModalState::advance(HostRows& y, Index rows, const HostThreads& threads, Vector& z) const {
  in_blocks(threads, [&](Index begin, Index count) {
    const Index known = remembered(slowest_.segment(begin, count).maxCoeff(), rows);
    const std::vector<Lanes> E = block(decay_.data(), K_, n_, begin, count);
    std::vector<Lanes> state = block(z.data(), K_, n_, begin, count);
    if (known < rows) std::fill(state.begin(), state.end(), Lanes{});
    for (Index j = rows - known + 1; j <= rows; ++j) {
      const Lanes now = lanes_of(y.row(j) + begin, count);
      for (std::size_t k = 0; k < E.size(); ++k)
        for (std::size_t i = 0; i < now.size(); ++i) state[k][i] = E[k][i] * state[k][i] + now[i];
    }
    for (std::size_t k = 0; k < E.size(); ++k) std::copy_n(state[k].begin(), count, z.data() + Index(k) * n_ + begin);
  });
}

void ModalState::add(const Vector& z, Index rows, const HostThreads& threads, HostRows& v) const {
  in_blocks(threads, [&](Index begin, Index count) {
    const Index known = remembered(slowest_.segment(begin, count).maxCoeff(), rows);
    const std::vector<Lanes> E = block(decay_.data(), K_, n_, begin, count),
                             C = block(output_.data(), K_, n_, begin, count);
    std::vector<Lanes> part = block(z.data(), K_, n_, begin, count);  // C E^{j-1} z
    for (std::size_t k = 0; k < E.size(); ++k)
      for (std::size_t i = 0; i < part[k].size(); ++i) part[k][i] *= C[k][i];
    for (Index j = 1; j <= known; ++j) {
      Lanes sum{};
      for (std::size_t k = 0; k < E.size(); ++k)
        for (std::size_t i = 0; i < sum.size(); ++i) {
          sum[i] += part[k][i];
          part[k][i] *= E[k][i];
        }
      double* row = v.row(j) + begin;
      for (Index i = 0; i < count; ++i) row[i] += sum[std::size_t(i)];
    }
  });
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

void DenseState::add(const Vector& carried, Index rows, const HostThreads&, HostRows& v) const {
  Vector z = carried, fresh(z.size());
  for (Index j = 1; j <= std::min(memory_, rows); ++j) {
    Eigen::Map<Vector>(v.row(j), r_.output.rows()).noalias() += r_.output * z;
    fresh.noalias() = r_.decay * z;
    z.swap(fresh);
  }
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
