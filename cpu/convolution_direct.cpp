#include "cpu/convolution_direct.hpp"

#include "cpu/mode_blocks.hpp"

namespace bromwich::cpu {

// W_d = C E^{d-1}, S_d = C E^{d-1} G0, d >= 1 (core/seam/recurrence.hpp). The powers of `group` exponentials stay in
// registers.
DirectBlock::DirectBlock(const ModalRecurrence& r, Index b, Index D)
    : lags_(D),
      weights_(std::size_t((D / near + 1) * near), all(0)),
      start_(std::size_t(D + 1), all(0)),
      initial_(r.initial.size() > 0 ? start_.size() : 0, all(0)) {
  constexpr Index group = 8;
  const Index n = r.modes(), K = r.exponentials();
  const auto block = [&](const auto& values, Index row) { return block_of_row(values.data() + row * n, b, n); };
  weights_[0] = block(r.w0, 0);
  if (D == 0) return;
  for (Index first = 0; first < K; first += group) {
    Lanes E[group] = {}, power[group] = {}, G0[group] = {}, z0[group] = {};
    for (Index k = first; k < std::min(K, first + group); ++k) {
      E[k - first] = block(r.decay, k);
      power[k - first] = block(r.output, k);
      G0[k - first] = block(r.start, k);
      if (!initial_.empty()) z0[k - first] = block(r.initial, k);
    }
    for (std::size_t d = 1; d < start_.size(); ++d) {
      Lanes W = all(0), S = all(0);
      for (Index g = 0; g < group; ++g) {
        W += power[g];
        S += power[g] * G0[g];
      }
      weights_[d] += W;
      start_[d] += S;
      if (!initial_.empty())
        for (Index g = 0; g < group; ++g) initial_[d] += power[g] * z0[g];
      for (Index g = 0; g < group; ++g) power[g] *= E[g];
    }
  }
  weights_[1] += block(r.w1, 0);
  start_[1] += block(r.s1, 0);
}

// Measured with AVX-512: a lag costs 0.7 multiply-adds of a scan. Computing a weight costs 3 per exponential.
double DirectBlock::cost(Index D, Index rows, Index exponentials) {
  const double steps = double(std::max<Index>(rows - 1, 1)), lags = std::min(double(D), steps);
  return 0.7 * (lags - lags * lags / (2 * steps) + near) + 0.1 * 3 * double(exponentials) * lags / steps;
}

void DirectBlock::apply(const Lanes* y, Lanes y0, Lanes* v, Index begin, Index count) const {
  for (Index j = 0; j < count; j += own) {
    Lanes sum[own] = {};
    const Index last = std::min(lags_, begin + j + own - 2);  // the lag of row 1 seen from the last of these rows
    for (Index d = 0; d <= last; d += near) {
      Lanes W[near];
      for (Index i = 0; i < near; ++i) W[i] = weights_[std::size_t(d + i)];
#pragma GCC unroll 32
      for (Index i = 1 - near; i < own; ++i) {
        const Lanes value = y[j + i - d];
#pragma GCC unroll 32
        for (Index g = std::max<Index>(i, 0); g < std::min(own, i + near); ++g) sum[g] += W[g - i] * value;
      }
    }
    for (Index g = 0; g < own; ++g) v[j + g] = sum[g];
  }
  const Index end = std::min(count, lags_ + 1 - begin);
  for (Index j = 0; j < end; ++j) v[j] += start_[std::size_t(begin + j)] * y0;
  if (!initial_.empty())
    for (Index j = 0; j < end; ++j) v[j] += initial_[std::size_t(begin + j)];
}

}  // namespace bromwich::cpu
