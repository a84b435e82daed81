// Step-by-step solution of the discrete problem: at step j
//
//     q_j = r_j + (part of v_j that is known),   y_j in SOL(M + W_0, q_j),   v_j = q_j - r_j + W_0 y_j,
//
// and one pass over the recurrence's state advances z and sums its output. This is the sequential baseline; the pass
// over z moves 4 x 8 bytes per exponential and mode, and is all the work for large scenes.

#include "cpu/parts.hpp"
#include "cpu/simd.hpp"
#include "cpu/step_lcp.hpp"

#include <cmath>
#include <vector>

namespace bromwich::cpu {

namespace {

class ModalMarch final : public March {
 public:
  ModalMarch(const MarchProblem& problem, const ModalRecurrence& r, Index rows, int threads)
      : r_(r),
        asked_to_stop_(problem),
        n_(r.modes()),
        blocks_(blocks(n_)),
        K_(r.exponentials()),
        response_(host(*problem.r)),
        modes_(rows, n_),
        sine_(make_vector_sine(n_)),
        rows_sine_(make_sine_transform(n_, rows, threads)),
        M_(to_dense(*problem.M)),
        lcp_(M_ + implicit_part(r), M_, problem.lcp_class),
        threads_(blocks_ * K_ * lanes >= parallel_size ? threads : 1) {
    decay_.resize(std::size_t(blocks_ * K_));
    output_.resize(decay_.size());
    z_.resize(decay_.size());
    for (Index l = 0; l < n_; ++l)
      for (Index k = 0; k < K_; ++k) {
        const std::size_t at = std::size_t((l / lanes) * K_ + k);
        decay_[at][l % lanes] = r.decay(k, l);
        output_[at][l % lanes] = r.output(k, l);
      }
    for (Vector* v : {&u_, &free_, &known_, &w1_}) *v = Vector::Zero(blocks_ * lanes);
    w1_.head(n_) = r.w1;
    q_ = y_ = Vector::Zero(n_);
    if (!problem.drive) return;
    drive_ = std::make_unique<HostArray>(rows, n_);
    rows_sine_->apply(*problem.drive, nullptr, *drive_, 0);
  }

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    report.well_posed = lcp_.well_posed();
    start(Y);
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      advance(j);
      if (drive_) free_.head(n_) += r_.w0.cwiseProduct(drive_->values.row(j).transpose());
      sine_->apply(free_.data(), known_.data());
      q_ = response_.row(j).transpose() + known_.head(n_);
      if (!lcp_.solve(q_, y_, j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      sine_->apply(y_.data(), u_.data());
      modes_.values.row(j) = (free_.head(n_) + r_.w0.cwiseProduct(u_.head(n_))).transpose();
      if (drive_) u_.head(n_) += drive_->values.row(j).transpose();
    }
    rows_sine_->apply(modes_, nullptr, v_array, 0);  // v = S (free + W_0 y), all rows together
    return report;
  }

  std::size_t bytes() const override {
    return 3 * decay_.size() * sizeof(Lanes) + sizeof(double) * std::size_t(5 * M_.size()) + modes_.bytes() +
           (drive_ ? drive_->bytes() : 0) + rows_sine_->bytes();
  }

 private:
  static constexpr Index parallel_size = 1 << 16;  ///< below it a barrier per step costs more than it saves

  // z_0 from y_0, phi_0 and x0.
  void start(const RowMatrix& Y) {
    y_ = Y.row(0).transpose();
    lcp_.start_from(y_);
    sine_->apply(y_.data(), u_.data());
    if (drive_) u_.head(n_) += drive_->values.row(0).transpose();
    for (std::size_t i = 0; i < z_.size(); ++i) z_[i] = all(0);
    for (Index l = 0; l < n_; ++l)
      for (Index k = 0; k < K_; ++k)
        z_[std::size_t((l / lanes) * K_ + k)][l % lanes] =
            r_.start(k, l) * u_[l] + (r_.initial.size() > 0 ? r_.initial(k, l) : 0.0);
  }

  // free_l = w1 u_l + Σ_k C_kl z_kl for step j, z advanced by the input u of step j-1 on the way.
  void advance(Index j) {
#pragma omp parallel for num_threads(threads_) schedule(static) if (threads_ > 1)
    for (Index b = 0; b < blocks_; ++b) {
      const Lanes u = load(u_.data() + b * lanes);
      const Lanes* E = &decay_[std::size_t(b * K_)];
      const Lanes* C = &output_[std::size_t(b * K_)];
      Lanes* z = &z_[std::size_t(b * K_)];
      Lanes sum[4] = {load(w1_.data() + b * lanes) * u, all(0), all(0), all(0)};
      if (j == 1) {
        // z_0 is complete, and lag 1 of y_0 has its own weight.
        for (Index k = 0; k < K_; ++k) sum[k % 4] += C[k] * z[k];
        sum[0] -= load(w1_.data() + b * lanes) * u;
        for (Index i = 0; i < lanes && b * lanes + i < n_; ++i) sum[0][i] += r_.s1[b * lanes + i] * u[i];
      } else {
        Index k = 0;
        for (; k + 4 <= K_; k += 4)
          for (Index i = 0; i < 4; ++i) {
            const Lanes s = E[k + i] * z[k + i] + u;
            z[k + i] = s;
            sum[i] += C[k + i] * s;
          }
        for (; k < K_; ++k) {
          z[k] = E[k] * z[k] + u;
          sum[0] += C[k] * z[k];
        }
      }
      store(free_.data() + b * lanes, (sum[0] + sum[1]) + (sum[2] + sum[3]));
    }
  }

  const ModalRecurrence& r_;
  Poll asked_to_stop_;
  Index n_, blocks_, K_;
  const RowMatrix& response_;
  std::unique_ptr<HostArray> drive_;  ///< phi in modes
  HostArray modes_;                   ///< v in modes
  std::unique_ptr<VectorSine> sine_;
  std::unique_ptr<SineTransform> rows_sine_;
  Matrix M_;
  StepLcp lcp_;
  int threads_;
  std::vector<Lanes> decay_, output_, z_;
  Vector u_, free_, known_, w1_, q_, y_;
};

class DenseMarch final : public March {
 public:
  DenseMarch(const MarchProblem& problem, const DenseRecurrence& r)
      : r_(r),
        asked_to_stop_(problem),
        response_(host(*problem.r)),
        start_(problem.start),
        forcing_(problem.forcing ? &host(*problem.forcing) : nullptr),
        M_(to_dense(*problem.M)),
        lcp_(M_ + r.w0, M_, problem.lcp_class),
        z_(r.decay.rows()),
        next_(z_),
        q_(M_.rows()),
        y_(q_) {}

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    report.well_posed = lcp_.well_posed();
    y_ = Y.row(0).transpose();
    lcp_.start_from(y_);
    z_.noalias() = r_.start * y_;
    if (start_) z_ += *start_;
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      q_.noalias() = r_.output * z_;
      V.row(j) = q_.transpose();
      q_ += response_.row(j).transpose();
      if (!lcp_.solve(q_, y_, j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      V.row(j).transpose().noalias() += r_.w0 * y_;
      next_.noalias() = r_.decay * z_;
      next_.noalias() += r_.input * y_;
      if (forcing_) next_ += forcing_->row(j).transpose();
      z_.swap(next_);
    }
    return report;
  }

  std::size_t bytes() const override { return sizeof(double) * std::size_t(2 * r_.decay.size() + 5 * M_.size()); }

 private:
  const DenseRecurrence& r_;
  Poll asked_to_stop_;
  const RowMatrix& response_;
  const Vector* start_;
  const RowMatrix* forcing_;
  Matrix M_;
  StepLcp lcp_;
  Vector z_, next_, q_, y_;
};

}  // namespace

std::unique_ptr<March> make_march(const MarchProblem& problem, Index rows, int threads) {
  if (const auto* modal = std::get_if<ModalRecurrence>(problem.recurrence))
    return std::make_unique<ModalMarch>(problem, *modal, rows, threads);
  return std::make_unique<DenseMarch>(problem, std::get<DenseRecurrence>(*problem.recurrence));
}

}  // namespace bromwich::cpu
