#include "core/base/error.hpp"
#include "cpu/real_fft.hpp"

#include <fftw3.h>

#include <mutex>
#include <string>

namespace bromwich::cpu {
namespace {

/// Guards the planner; executing plans needs no lock.
std::mutex& planner() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace

struct OnePlan {
  explicit OnePlan(fftw_plan made, Index length) : plan(made) {
    if (!plan)
      throw Error("steps", "FFTW made no plan of length " + std::to_string(length), "use fewer steps or constraints");
  }
  ~OnePlan() {
    const std::lock_guard lock(planner());
    fftw_destroy_plan(plan);
  }
  OnePlan(const OnePlan&) = delete;
  OnePlan& operator=(const OnePlan&) = delete;

  fftw_plan plan;
};

namespace {

fftw_complex* of(Complex* values) { return reinterpret_cast<fftw_complex*>(values); }

/// Buffers that the planner looks at and does not touch (FFTW_ESTIMATE).
struct Sample {
  explicit Sample(Index length) : real(length), complex(length / 2 + 1) {}
  Vector real;
  ComplexVector complex;
};

std::unique_ptr<OnePlan> plan_forward(Index length, unsigned flags) {
  Sample s(length);
  std::unique_lock lock(planner());
  const fftw_plan made = fftw_plan_dft_r2c_1d(int(length), s.real.data(), of(s.complex.data()), flags);
  lock.unlock();
  return std::make_unique<OnePlan>(made, length);
}

std::unique_ptr<OnePlan> plan_backward(Index length, unsigned flags) {
  Sample s(length);
  std::unique_lock lock(planner());
  const fftw_plan made = fftw_plan_dft_c2r_1d(int(length), of(s.complex.data()), s.real.data(), flags);
  lock.unlock();
  return std::make_unique<OnePlan>(made, length);
}

std::unique_ptr<OnePlan> plan_sine(Index n) {
  Vector in(n), out(n);
  std::unique_lock lock(planner());
  const fftw_plan made = fftw_plan_r2r_1d(int(n), in.data(), out.data(), FFTW_RODFT00,
                                          FFTW_ESTIMATE | FFTW_UNALIGNED | FFTW_PRESERVE_INPUT);
  lock.unlock();
  return std::make_unique<OnePlan>(made, n);
}

}  // namespace

const char* transform_library() { return "FFTW"; }

struct RealFft::Plan {
  std::unique_ptr<OnePlan> forward, backward;
};

RealFft::RealFft(Index length)
    : RealFft(length, std::make_shared<const Plan>(Plan{plan_forward(length, FFTW_ESTIMATE | FFTW_UNALIGNED),
                                                        plan_backward(length, FFTW_ESTIMATE | FFTW_UNALIGNED)})) {}

RealFft RealFft::forward_of_aligned(Index length) {
  return {length, std::make_shared<const Plan>(Plan{plan_forward(length, FFTW_ESTIMATE), nullptr})};
}

void RealFft::forward(const double* in, Complex* out) const {
  fftw_execute_dft_r2c(plan_->forward->plan, const_cast<double*>(in), of(out));  // a plan out of place keeps its input
}

void RealFft::backward(Complex* in, double* out) const { fftw_execute_dft_c2r(plan_->backward->plan, of(in), out); }

struct SineFft::Plan {
  std::unique_ptr<OnePlan> plan;
};

SineFft::SineFft(Index n) : plan_(std::make_shared<const Plan>(Plan{plan_sine(n)})) {}

void SineFft::apply(const double* in, double* out) const {
  fftw_execute_r2r(plan_->plan->plan, const_cast<double*>(in), out);
}

}  // namespace bromwich::cpu
