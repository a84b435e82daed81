// Step-by-step solution of the discrete problem: at step j
//
//     q_j = r_j + (part of v_j that is known),   y_j in SOL(M + W_0, q_j),   v_j = q_j - r_j + W_0 y_j,
//
// and one pass over the recurrence's state advances z and sums its output. This is the sequential baseline; the pass
// over z moves 4 x 8 bytes per exponential and mode, and is all the work for large scenes.

#include "core/lcp.hpp"
#include "cpu/parts.hpp"
#include "cpu/simd.hpp"

#include <cmath>
#include <vector>

namespace bromwich::cpu {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

// The LCP of a step and its bookkeeping. M + W_0 does not inherit the class of M: it is tested itself.
class StepLcp {
 public:
  StepLcp(const Matrix& implicit, const Matrix& M, LcpClass lcp_class)
      : M_(M),
        is_Z_(lcp_class == LcpClass::Z),
        solver_(implicit, classify(LcpMatrix(implicit)), is_Z_ ? &M_ : nullptr) {}

  void start_from(const Vector& y) { solver_.start_from(y); }

  // false: no solution could be certified; the report says why.
  bool solve(const Vector& q, Vector& y, Index j, MarchReport& report) {
    const Clock::time_point start = Clock::now();
    const LcpOutcome outcome = solver_.solve(q, y);
    report.lcp_seconds += seconds_since(start);
    report.count.newton += outcome.newton;
    report.count.fallbacks += outcome.fallback;
    if (outcome.solved) {
      ++report.count.solved;
      return true;
    }
    ++report.count.unsolved;
    if (!q.allFinite())
      report.finite = false;
    else if (outcome.infeasible && is_Z_)  // the proof is about least elements, which only a Z scene asks for
      report.infeasible = j;
    report.stopped = j;
    return false;
  }

 private:
  Matrix M_;
  bool is_Z_;
  ActiveSetLcp solver_;
};

void invalidate(RowMatrix& y, RowMatrix& v, Index from) {
  y.bottomRows(y.rows() - from).setConstant(NAN);
  v.bottomRows(v.rows() - from).setConstant(NAN);
}

// Every `polled_every` steps: reports progress and looks whether to stop.
class Poll {
 public:
  explicit Poll(const MarchProblem& problem) : interrupted_(problem.interrupted), progress_(problem.progress) {}

  bool operator()(Index j, MarchReport& report) const {
    if (j % polled_every != 0) return false;
    if (progress_) progress_(j);
    if (!interrupted_ || !interrupted_()) return false;
    report.interrupted = true;
    report.stopped = j;
    return true;
  }

 private:
  static constexpr Index polled_every = 64;
  std::function<bool()> interrupted_;
  std::function<void(Index)> progress_;
};

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
        lcp_(M_ + implicit_part(), M_, problem.lcp_class),
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

  // S diag(w0) S: products of sines are differences of cosines, so entry (i, j) is c(i-j) - c(i+j) with
  // c(d) = 1/(n+1) Σ_k w0_k cos(pi k d/(n+1)), a Toeplitz and a Hankel matrix from one table.
  Matrix implicit_part() const {
    const Index period = 2 * (n_ + 1);
    Vector cosine(period), c = Vector::Zero(n_ + 2);
    for (Index a = 0; a < period; ++a) cosine[a] = std::cos(M_PI * double(a) / double(n_ + 1)) / double(n_ + 1);
    for (Index d = 0; d < c.size(); ++d)
      for (Index k = 0; k < n_; ++k) c[d] += r_.w0[k] * cosine[(k + 1) * d % period];
    Matrix W(n_, n_);
    for (Index j = 1; j <= n_; ++j)
      for (Index i = 1; i <= n_; ++i) W(i - 1, j - 1) = c[std::abs(i - j)] - c[std::min(i + j, period - i - j)];
    return W;
  }

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
        drive_(problem.drive ? &host(*problem.drive) : nullptr),
        M_(to_dense(*problem.M)),
        lcp_(M_ + r.w0, M_, problem.lcp_class),
        z_(r.decay.rows()),
        next_(z_),
        q_(M_.rows()),
        y_(q_),
        u_(q_) {}

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    u_ = Y.row(0).transpose();
    lcp_.start_from(u_);
    if (drive_) u_ += drive_->row(0).transpose();
    z_.noalias() = r_.start * u_;
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      q_.noalias() = r_.output * z_;
      if (drive_) q_.noalias() += r_.w0 * drive_->row(j).transpose();
      V.row(j) = q_.transpose();
      q_ += response_.row(j).transpose();
      if (!lcp_.solve(q_, y_, j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      V.row(j).transpose().noalias() += r_.w0 * y_;
      u_ = y_;
      if (drive_) u_ += drive_->row(j).transpose();
      next_.noalias() = r_.decay * z_;
      next_.noalias() += r_.input * u_;
      z_.swap(next_);
    }
    return report;
  }

  std::size_t bytes() const override { return sizeof(double) * std::size_t(2 * r_.decay.size() + 5 * M_.size()); }

 private:
  const DenseRecurrence& r_;
  Poll asked_to_stop_;
  const RowMatrix& response_;
  const RowMatrix* drive_;
  Matrix M_;
  StepLcp lcp_;
  Vector z_, next_, q_, y_, u_;
};

}  // namespace

std::unique_ptr<March> make_march(const MarchProblem& problem, Index rows, int threads) {
  if (const auto* modal = std::get_if<ModalRecurrence>(problem.recurrence))
    return std::make_unique<ModalMarch>(problem, *modal, rows, threads);
  return std::make_unique<DenseMarch>(problem, std::get<DenseRecurrence>(*problem.recurrence));
}

}  // namespace bromwich::cpu
