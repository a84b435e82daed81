// Step-by-step solution of modal recurrences (cpu/march.cpp) with step problems of class P. kernels/march_steps.cu
// takes the steps. This file sets the initial state, transforms all rows afterwards, and checks every row
// (kernels/march_rows.cuh). A march that fails is repeated by the host, which then determines the outcome.
//
// symbol  meaning
// u_j     S y_j, the modes of y
// free_j  v_j without W_0 y_j, in modes; v_j = S (free_j + w0 u_j)
// R, C    scaling of M + W_0 (core/lcp/solution.hpp)

#include "kernels/host_plans.hpp"
#include "kernels/march_rows.cuh"
#include "kernels/march_steps.hpp"
#include "kernels/parts.hpp"

#include "core/kernel/response.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/sine_basis.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich::cuda {

namespace {

constexpr Index piece = 512;  ///< steps per launch if progress or interruption is wanted
/// Of a march whose steps keep their tableaus, as those of a coarsest grid that is marched again and again.
constexpr Index most_kept_steps = 16;
constexpr std::size_t most_kept_bytes = std::size_t(1) << 29;

class ModalMarch final : public March {
 public:
  ModalMarch(const Device& device, Backend& host, const MarchProblem& problem, const ModalRecurrence& r,
             const Matrix& implicit, const StepKernel& kernel, Index rows)
      : March(problem.interrupted || problem.progress),
        device_(device),
        host_(host),
        problem_(problem),
        kernel_(kernel),
        n_(r.modes()),
        rows_(rows),
        kept_steps_(may_keep() ? rows - 1 : 0),
        sine_(make_sine_transform(device, n_, rows)),
        known_(device, rows, n_),
        input_(device, rows, n_),
        exact_input_(device, rows, n_),
        outcome_(device, {}),
        queued_(device, 1),
        totals_(device, 1) {
    totals_.clear();
    put_matrices(implicit);
    put_recurrence(r);
    reserve_state(r.exponentials());
    if (problem.drive) drive_ = std::make_unique<DeviceArray>(device, rows, n_);
    recurrence_ = &r;
  }

  MarchReport run(Array& y, Array& v) override {
    *outcome_ = {};
    MarchReport report;
    const Index done = take_steps(y, report);
    if (done > 0) complete(y, v, done, outcome_.get());
    device_.wait();
    if (done == 0 || outcome_->drifted || (!at_once && outcome_->reached < rows_ && rows_ > 1))
      return make_host_march(device_, host_, problem_, rows_)->run(y, v);
    if (!at_once) count_steps(report);
    report.count.solved = done - 1;
    return report;
  }

  // Queued runs cannot be interrupted; `collect` reports them, and the caller repeats failed ones.
  void submit(Array& y, Array& v) override {
    if (at_once) {
      const MarchReport report = run(y, v);
      polled_.count += report.count;
      if (report.stopped >= 0) polled_.stopped = 0;
      return;
    }
    queued_.clear();
    take_inputs();
    if (rows_ > 1) launch(y, 1, rows_, queued_.data());
    complete(y, v, rows_, queued_.data());
    tally<<<1, 1, 0, device_.stream()>>>(queued_.data(), int(rows_), totals_.data());
    check(cudaGetLastError(), "finishing the march");
  }
  MarchReport collect() override {
    if (at_once) return std::exchange(polled_, {});
    MarchTotals now{};
    totals_.get(&now);
    MarchReport report;
    report.count.solved = (now.runs - reported_.runs) * (rows_ - 1);
    report.count.newton = now.sweeps - reported_.sweeps;
    report.count.fallbacks = now.fallbacks - reported_.fallbacks;
    if (now.failed > reported_.failed) report.stopped = 0;
    reported_ = now;
    return report;
  }

  std::size_t bytes() const override {
    std::size_t sum = sine_->bytes() + known_.bytes() + input_.bytes() + exact_input_.bytes();
    if (drive_) sum += drive_->bytes();
    for (const Memory<double>* memory :
         {&A_,         &S_,      &row_scale_,  &column_scale_, &lower_, &diagonal_, &upper_, &dense_,
          &decay_,     &output_, &start_,      &initial_,      &lag1_,  &s1_,       &w0_,    &start_transform_,
          &transform_, &z_,      &next_known_, &exchanged_})
      sum += memory->bytes();
    return sum + active_.bytes() + updates_.bytes() + mail_.bytes();
  }

 private:
  void put_matrices(const Matrix& implicit) {
    const Equilibration scale = equilibrate(implicit);
    A_ = on_device(device_, RowMatrix(scaled(implicit, scale)));
    S_ = on_device(device_, sine_matrix(n_));
    row_scale_ = on_device(device_, scale.rows);
    column_scale_ = on_device(device_, scale.columns);
    if (const auto* t = std::get_if<Tridiagonal>(problem_.M)) {
      lower_ = on_device(device_, t->lower);
      diagonal_ = on_device(device_, t->diagonal);
      upper_ = on_device(device_, t->upper);
    } else {
      dense_ = on_device(device_, to_dense(*problem_.M));
    }
  }

  void put_recurrence(const ModalRecurrence& r) {
    decay_ = on_device(device_, r.decay);
    output_ = on_device(device_, r.output);
    start_ = on_device(device_, r.start);
    initial_ = on_device(device_, r.initial);
    lag1_ = on_device(device_, Vector(r.w1 + r.output.colwise().sum().transpose()));
    s1_ = on_device(device_, r.s1);
    w0_ = on_device(device_, r.w0);
  }

  void reserve_state(Index exponentials) {
    const Index kept = std::max<Index>(kept_steps_, 1);
    start_transform_ = Memory<double>(device_, std::size_t(kept) * kernel_.transform_size());
    if (at_once || !kernel_.resident()) transform_ = Memory<double>(device_, kernel_.transform_size());
    z_ = Memory<double>(device_, std::size_t(exponentials * n_));
    next_known_ = Memory<double>(device_, std::size_t(n_));
    exchanged_ = Memory<double>(device_, std::size_t(4 * n_ * n_));
    active_ = Memory<unsigned char>(device_, std::size_t((kept + 1) * n_));
    updates_ = Memory<int>(device_, std::size_t(kept + 1));
    mail_ = Memory<unsigned long long>(device_, std::size_t(2 * n_));
    active_.clear();
    updates_.clear();
    for (Index j = 0; j < kept; ++j)
      kernel_.form(tables(), start_transform_.data() + std::size_t(j) * kernel_.transform_size());
  }

  bool may_keep() const {
    return rows_ > 1 && rows_ - 1 <= most_kept_steps && !at_once &&
           sizeof(double) * kernel_.transform_size() * std::size_t(rows_ - 1) <= most_kept_bytes;
  }

  StepTables tables() const {
    return {A_.data(),         S_.data(),
            row_scale_.data(), column_scale_.data(),
            decay_.data(),     output_.data(),
            lag1_.data(),      w0_.data(),
            int(n_),           int(z_.size() / std::size_t(n_))};
  }

  StepArrays arrays(Array& y) {
    const double* drive = drive_ ? drive_->memory.data() : nullptr;
    return {values(*problem_.r), drive, values(y), values(input_), values(known_), int(rows_), int(stride(n_))};
  }

  // Reads the contribution of x0 and the drive for this run.
  void take_inputs() {
    initial_ = recurrence_->initial.size() > 0 ? on_device(device_, recurrence_->initial) : Memory<double>();
    if (drive_) sine_->apply(*problem_.drive, nullptr, *drive_, 0);
  }

  // Number of final rows; 0 if the host has to take over.
  Index take_steps(Array& y, MarchReport& report) {
    if (rows_ < 2) return rows_;
    take_inputs();
    for (Index j = 1, last; j < rows_; j = last) {
      last = at_once ? std::min(rows_, j + piece) : rows_;
      launch(y, j, last, outcome_.get());
      if (!at_once) continue;
      device_.wait();
      if (outcome_->reached < last) return 0;
      count_steps(report);
      if (last < rows_ && stops(last, report)) return last;
    }
    return rows_;
  }

  // Launches steps j .. last-1.
  void launch(Array& y, Index j, Index last, StepOutcome* out) {
    const First first{start_.data(), initial_.size() > 0 ? initial_.data() : nullptr, s1_.data()};
    const Index kept = std::max<Index>(kept_steps_, 1);
    const StepState state{start_transform_.data(),
                          transform_.data(),
                          active_.data(),
                          active_.data() + kept * n_,
                          updates_.data(),
                          updates_.data() + kept,
                          z_.data(),
                          next_known_.data(),
                          mail_.data(),
                          exchanged_.data(),
                          int(kept_steps_),
                          long(kernel_.transform_size())};
    if (j == 1)
      begin<<<unsigned(n_), threads, 0, device_.stream()>>>(tables(), first, arrays(y), z_.data(), next_known_.data());
    check(cudaGetLastError(), "starting the march");
    kernel_.launch(tables(), state, arrays(y), {int(j), int(last), j == 1, last < rows_}, out);
  }

  void count_steps(MarchReport& report) const {
    report.count.newton += long(outcome_->sweeps);
    report.count.fallbacks += outcome_->fallbacks;
  }

  bool stops(Index j, MarchReport& report) const {
    if (problem_.progress) problem_.progress(j);
    if (!problem_.interrupted || !problem_.interrupted()) return false;
    report.interrupted = true;
    report.stopped = j;
    return true;
  }

  // Computes v for rows 0 .. done-1 of y and checks them; NaN beyond.
  void complete(Array& y, Array& v, Index done, StepOutcome* out) {
    sine_->apply(y, nullptr, exact_input_, 1);
    const unsigned last = unsigned(done - 1);
    const StepArrays a = arrays(y);
    if (done > 1)
      add_implicit<<<last, threads, 0, device_.stream()>>>(w0_.data(), int(n_), a.step, values(exact_input_),
                                                           values(known_));
    sine_->apply(known_, nullptr, v, 0);
    const GivenMatrix M{lower_.data(), diagonal_.data(), upper_.data(), dense_.data()};
    if (done > 1)
      check_rows<<<last, threads, 0, device_.stream()>>>(tables(), M, a, values(v), values(exact_input_), out);
    if (done < rows_)
      invalidate<<<unsigned(rows_ - done), threads, 0, device_.stream()>>>(values(y), values(v), int(n_), a.step,
                                                                           int(done));
    check(cudaGetLastError(), "finishing the march");
  }

  const Device& device_;
  Backend& host_;
  MarchProblem problem_;
  const ModalRecurrence* recurrence_ = nullptr;
  StepKernel kernel_;
  Index n_, rows_;
  Index kept_steps_;  ///< all of a short march, whose steps keep their tableaus from run to run; 0: of none
  std::unique_ptr<RowTransform> sine_;
  DeviceArray known_;                   ///< free_j, then free_j + w0 u_j
  DeviceArray input_, exact_input_;     ///< u used by the steps, and S y
  std::unique_ptr<DeviceArray> drive_;  ///< phi in modes
  Memory<double> A_, S_, row_scale_, column_scale_, lower_, diagonal_, upper_, dense_;
  Memory<double> decay_, output_, start_, initial_, lag1_, s1_, w0_;
  Memory<double> start_transform_, transform_, z_, next_known_, exchanged_;
  Memory<unsigned char> active_;
  Memory<int> updates_;
  Memory<unsigned long long> mail_;
  Pinned<StepOutcome> outcome_;  ///< written by the device
  Memory<StepOutcome> queued_;   ///< outcome of the run submitted last
  Memory<MarchTotals> totals_;
  MarchTotals reported_{};
  MarchReport polled_;  ///< sum of runs that were not queued
};

// M symmetric with a dominant diagonal, and W_0 = S diag(w0) S with w0 > 0: the sum is positive definite. To find that
// by a factorization takes longer than most of the rest of the plan.
bool is_positive_sum(const LcpMatrix& matrix, const ModalRecurrence& r) {
  const auto* M = std::get_if<Tridiagonal>(&matrix);
  if (!M || !(r.w0.minCoeff() > 0)) return false;
  const Index n = M->diagonal.size();
  for (Index i = 0; i < n; ++i) {
    const double left = i > 0 ? M->lower[i] : 0, right = i + 1 < n ? M->upper[i] : 0;
    if (i > 0 && left != M->upper[i - 1]) return false;
    if (!(M->diagonal[i] >= std::abs(left) + std::abs(right))) return false;
  }
  return true;
}

}  // namespace

std::unique_ptr<March> make_march(const Device& device, Backend& host, const MarchProblem& problem, Index rows) {
  const auto* modal = problem.recurrence ? std::get_if<ModalRecurrence>(problem.recurrence) : nullptr;
  if (modal && modal->modes() > 0 && modal->face.size() <= 1 && modal->face.is_sine() &&
      !selects_least(problem.lcp_class)) {
    const StepKernel kernel(device, modal->modes(), modal->exponentials());
    if (kernel.fits()) {
      const Matrix implicit = to_dense(*problem.M) + implicit_part(*modal);
      if (is_positive_sum(*problem.M, *modal) || has_one_solution(classify(LcpMatrix(implicit))))
        return std::make_unique<ModalMarch>(device, host, problem, *modal, implicit, kernel, rows);
    }
  }
  if (modal && modal->face.size() > 1)
    if (auto march = make_face_march(device, host, problem, *modal, rows)) return march;
  return make_host_march(device, host, problem, rows);
}

}  // namespace bromwich::cuda
