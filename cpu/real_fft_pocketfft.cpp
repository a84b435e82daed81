// pocketfft (third_party/pocketfft) transforms in place and packs a spectrum as r_0, r_1, i_1, r_2, i_2, ...

#define POCKETFFT_NO_MULTITHREADING
#include "cpu/real_fft.hpp"

#include <pocketfft_hdronly.h>

#include <algorithm>

namespace bromwich::cpu {

const char* transform_library() { return "pocketfft"; }

struct RealFft::Plan {
  explicit Plan(Index length) : plan(std::size_t(length)) {}
  pocketfft::detail::pocketfft_r<double> plan;
};

RealFft::RealFft(Index length) : RealFft(length, std::make_shared<const Plan>(length)) {}

RealFft RealFft::forward_of_aligned(Index length) { return RealFft(length); }

void RealFft::forward(const double* in, Complex* out) const {
  // One value behind its place, the packed spectrum has every r_k and i_k with k >= 1 where it belongs.
  auto* values = reinterpret_cast<double*>(out);
  std::copy(in, in + length_, values + 1);
  plan_->plan.exec(values + 1, 1.0, true);
  values[0] = values[1];
  values[1] = 0;
  if (length_ % 2 == 0) values[length_ + 1] = 0;
}

void RealFft::backward(Complex* in, double* out) const {
  const auto* values = reinterpret_cast<const double*>(in);
  out[0] = values[0];
  std::copy(values + 2, values + 1 + length_, out + 1);
  plan_->plan.exec(out, 1.0, false);
}

struct SineFft::Plan {
  explicit Plan(Index values) : n(values), plan(std::size_t(values)) {}
  Index n;
  pocketfft::detail::T_dst1<double> plan;
};

SineFft::SineFft(Index n) : plan_(std::make_shared<const Plan>(n)) {}

void SineFft::apply(const double* in, double* out) const {
  std::copy(in, in + plan_->n, out);
  plan_->plan.exec(out, 1.0, false, 1, false);
}

}  // namespace bromwich::cpu
