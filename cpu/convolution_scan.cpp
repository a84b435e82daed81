// Exponentials are processed in groups of `group`. The states and decay factors of a group stay in registers while time
// runs over a tile held in L1. Per time point, mode and exponential: two multiply-adds and no memory traffic.

#include "cpu/convolution_scan.hpp"

#include "cpu/mode_blocks.hpp"

#include <cmath>

namespace bromwich::cpu {

ScanBlock::ScanBlock(const ModalRecurrence& r, Index b, Index rows)
    : tiles_(tiles(rows)), banks_(std::size_t((r.exponentials() + group - 1) / group), Bank{}) {
  const Index n = r.modes();
  const auto block = [&](const auto& values, Index row) { return block_of_row(values.data() + row * n, b, n); };
  w0_ = block(r.w0, 0);
  w1_ = block(r.w1, 0);
  s1_ = block(r.s1, 0);
  for (Index k = 0; k < r.exponentials(); ++k) {
    Bank& bank = banks_[std::size_t(k / group)];
    bank.decay[k % group] = block(r.decay, k);
    bank.output[k % group] = block(r.output, k);
    bank.start[k % group] = block(r.start, k);
    if (r.initial.size() > 0) bank.initial[k % group] = block(r.initial, k);
  }
  states_ = std::make_unique_for_overwrite<Lanes[]>(std::size_t(tiles_ * exponentials()));
}

void ScanBlock::start_from(const RowMatrix& D, Index b) {
  for (Index k = 0; k < D.rows(); ++k) {
    Bank& bank = banks_[std::size_t(k / group)];
    const Lanes row = block_of_row(D.row(k).data(), b, D.cols()), E = bank.decay[k % group], C = bank.output[k % group];
    for (Index lane = 0; lane < lanes; ++lane)
      bank.initial[k % group][lane] = E[lane] == 0 ? 0 : row[lane] * E[lane] / C[lane];
  }
}

void ScanBlock::begin_with(const double* z, Index K, Index n, Index b) {
  for (Index k = 0; k < K; ++k) banks_[std::size_t(k / group)].initial[k % group] = block_of_row(z + k * n, b, n);
}

double ScanBlock::cost(const ModalRecurrence& r) { return 2 * double((r.exponentials() + group - 1) / group * group); }

void ScanBlock::advance(const Bank& bank, const Lanes* before, Lanes* after, const Lanes* y, Lanes* v, Index count) {
  Lanes E[group], C[group], z[group];  // local copies stay in registers; v might alias members
  std::copy_n(bank.decay, group, E);
  std::copy_n(bank.output, group, C);
  std::copy_n(before, group, z);
  for (Index j = 0; j < count; ++j) {
    Lanes even = v[j] + C[0] * z[0], odd = C[1] * z[1];
    for (Index g = 2; g < group; g += 2) {
      even += C[g] * z[g];
      odd += C[g + 1] * z[g + 1];
    }
    for (Index g = 0; g < group; ++g) z[g] = E[g] * z[g] + y[j];
    v[j] = even + odd;
  }
  for (Index g = 0; g < group; ++g) after[g] = z[g];
}

void ScanBlock::apply(const Lanes* y, Lanes* v, Index t, Index count, bool keep) {
  if (t == 0) start(y[0]);
  for (Index j = 0; j < count; ++j) v[j] = w0_ * y[j + 1] + w1_ * y[j];
  if (t == 0) v[0] += (s1_ - w1_) * y[0];
  Lanes left[group];
  for (Index k = 0; k < Index(banks_.size()); ++k)
    advance(banks_[std::size_t(k)], state(t) + k * group, keep ? state(t + 1) + k * group : left, y + 1, v, count);
}

// z before row 1: contributions of y_0 and x0.
void ScanBlock::start(Lanes y0) {
  Lanes* z = state(0);
  for (const Bank& bank : banks_)
    for (Index g = 0; g < group; ++g) *z++ = bank.start[g] * y0 + bank.initial[g];
}

void ScanBlock::accumulate(const Lanes* y, Index t, Index count, Index to) {
  if (t == 0) start(y[0]);
  Lanes* z = state(to);
  for (const Bank& bank : banks_) {
    Lanes s[group];
    std::copy_n(z, group, s);
    for (Index j = 1; j <= count; ++j)
      for (Index g = 0; g < group; ++g) s[g] = bank.decay[g] * s[g] + y[j];
    z = std::copy_n(s, group, z);
  }
}

void ScanBlock::carry(Index from, Index length, Index end) {
  for (Index t = from; t + length < end; t += length) {
    const Lanes* before = state(t);
    Lanes* after = state(t + length);
    for (const Bank& bank : banks_)
      for (Index g = 0; g < group; ++g, ++before, ++after)
        for (Index lane = 0; lane < lanes; ++lane)
          (*after)[lane] += std::pow(bank.decay[g][lane], double(length * tile)) * (*before)[lane];
  }
}

std::size_t ScanBlock::bytes() const {
  return banks_.size() * sizeof(Bank) + sizeof(Lanes) * std::size_t(tiles_ * exponentials());
}

}  // namespace bromwich::cpu
