// Step-by-step solution of the discrete problem. At step j
//
//     q_j = r_j + (known part of v_j),   y_j in SOL(M + W_0, q_j),   v_j = q_j - r_j + W_0 y_j.
//
// The past of a Kronecker sum is processed in blocks of b steps. With Z = z at the last step s of the previous block,
//
//     v_{s+i} = C E^{i-1} Z + Σ_{d=1}^{i-1} W_d u_{s+i-d} + W_0 u_{s+i},   1 <= i <= b,
//
// Exponentials are therefore read once per block instead of once per step (4 x 8 bytes per exponential and mode, which
// dominates a step-wise march), and b sums stay in registers. Lags within the block are applied directly, in modes.

#include "core/host/face_lcp.hpp"
#include "cpu/march_step.hpp"
#include "cpu/parts.hpp"
#include "cpu/simd.hpp"

#include <cmath>
#include <memory>
#include <optional>
#include <vector>

namespace bromwich::cpu {

using host::invalidate;
using host::Poll;

namespace {

class ModalMarch final : public ImmediateMarch {
 public:
  ModalMarch(const MarchProblem& problem, const ModalRecurrence& r, Index rows, Team& team, const LinearStep& linear)
      : r_(r),
        asked_to_stop_(problem),
        n_(r.modes()),
        blocks_(blocks(n_)),
        K_(r.exponentials()),
        response_(host(*problem.r)),
        to_modes_(make_vector_transform(r.basis(), Way::to_modes)),
        to_points_(r.basis().is_sine() ? to_modes_ : make_vector_transform(r.basis(), Way::to_points)),
        M_(*problem.M),
        team_(team),
        shares_(blocks_ * K_ * lanes >= parallel_size) {
    decay_.resize(std::size_t(blocks_ * K_));
    output_.resize(decay_.size());
    z_.resize(decay_.size());
    for (Index l = 0; l < n_; ++l)
      for (Index k = 0; k < K_; ++k) {
        const std::size_t at = std::size_t((l / lanes) * K_ + k);
        decay_[at][l % lanes] = r.decay(k, l);
        output_[at][l % lanes] = r.output(k, l);
      }
    if (!linear && r.face.size() > 1 && !selects_least(problem.lcp_class))
      face_ = host::FaceLcp::make(M_, r.face, r.w0, [this](Way way, const double* in, double* out) {
        (way == Way::to_modes ? *to_modes_ : *to_points_).apply(in, out);
      });
    if (!face_)
      step_.emplace(problem, linear, linear ? Matrix() : to_dense(M_),
                    [&] { return Matrix(to_dense(M_) + implicit_part(r)); });
    for (RowMatrix* m : {&near_, &u_, &far_}) *m = RowMatrix::Zero(block_steps, blocks_ * lanes);
    make_near_lags();
    for (Vector* v : {&free_, &known_, &w0_, &first_}) *v = Vector::Zero(blocks_ * lanes);
    w0_.head(n_) = r.w0;
    q_ = y_ = Vector::Zero(n_);
    given_drive_ = problem.drive;
    if (!given_drive_) return;
    drive_ = std::make_unique<HostArray>(rows, n_);
    const FaceBasis basis = r.basis();
    transform_of_drive_ = basis.size() == 1 && basis.is_sine() ? make_sine_transform(n_, rows, team)
                                                               : make_face_transform(basis, rows, Way::to_modes, team);
  }

  MarchReport run(Array& y_array, Array& v_array) override {
    const FlushDenormals flush;
    RowMatrix &Y = host(y_array), &V = host(v_array);
    MarchReport report;
    report.well_posed = face_ || step_->well_posed();
    V.row(0).setZero();
    if (drive_) transform_of_drive_->apply(*given_drive_, nullptr, *drive_, 0);
    start(Y);
    for (Index j = 1; j < Y.rows(); ++j) {
      if (asked_to_stop_(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      const Index i = (j - 1) % block_steps;
      if (i == 0) begin_block(j);
      sum_near(i);
      if (drive_) free_.head(n_) += r_.w0.cwiseProduct(drive_->values.row(j).transpose());
      to_points_->apply(free_.data(), known_.data());
      q_ = response_.row(j).transpose() + known_.head(n_);
      if (!solve_step(j, report)) {
        invalidate(Y, V, j);
        return report;
      }
      Y.row(j) = y_.transpose();
      to_modes_->apply(y_.data(), u_.row(i).data());
      add_implicit(i);
      V.row(j) = known_.head(n_).transpose();
      if (drive_) u_.row(i).head(n_) += drive_->values.row(j);
    }
    return report;
  }

  std::size_t bytes() const override {
    return 3 * decay_.size() * sizeof(Lanes) + (face_ ? face_->bytes() : step_->bytes()) +
           (drive_ ? drive_->bytes() : 0);
  }

 private:
  static constexpr Index parallel_size = 1 << 16;  ///< below it, other threads save less than ten microseconds
  static constexpr Index block_steps = 16;

  // Row d - 1: W_d in modes, from the far parts of z = 1 and the extra weight of lag 1.
  void make_near_lags() {
    std::fill(z_.begin(), z_.end(), all(1));
    for (Index b = 0; b < blocks_; ++b) sum_far(b);
    near_ = far_;
    near_.row(0).head(n_) += r_.w1.transpose();
  }

  bool solve_step(Index j, MarchReport& report) {
    if (!face_) return step_->solve(q_, y_, j, report);
    Timer timer;
    const LcpOutcome outcome = face_->solve(q_, y_);
    report.lcp_seconds += timer.lap();
    return host::count_step(outcome, q_, true, j, report);
  }

  // z_0 from y_0, phi_0 and x0. Lag 1 of y_0 has its own weight.
  void start(const RowMatrix& Y) {
    y_ = Y.row(0).transpose();
    face_ ? face_->start_from(y_) : step_->start_from(y_);
    u_.setZero();
    Vector u = Vector::Zero(n_);
    to_modes_->apply(y_.data(), u.data());
    if (drive_) u += drive_->values.row(0).transpose();
    for (std::size_t i = 0; i < z_.size(); ++i) z_[i] = all(0);
    for (Index l = 0; l < n_; ++l)
      for (Index k = 0; k < K_; ++k)
        z_[std::size_t((l / lanes) * K_ + k)][l % lanes] =
            r_.start(k, l) * u[l] + (r_.initial.size() > 0 ? r_.initial(k, l) : 0.0);
    first_.head(n_) = r_.s1.cwiseProduct(u);
  }

  // Advances z by the inputs of the previous block, then computes its contribution to the steps j .. j + b - 1.
  void begin_block(Index j) {
    if (j > 1) first_.head(n_) = r_.w1.cwiseProduct(u_.row(block_steps - 1).head(n_).transpose());
    team_.each(blocks_, shares_, [&](Index b) {
      if (j > 1) advance(b);
      sum_far(b);
    });
    far_.row(0) += first_.transpose();
  }

  // z <- E^b z + Σ_i E^{b-i} u_i in the eight modes of block b.
  void advance(Index b) {
    constexpr Index group = 8;
    const Lanes* E = &decay_[std::size_t(b * K_)];
    Lanes* z = &z_[std::size_t(b * K_)];
    Lanes u[block_steps];
    for (Index i = 0; i < block_steps; ++i) u[i] = load(u_.row(i).data() + b * lanes);
    Index k = 0;
    for (; k + group <= K_; k += group) {
      Lanes e[group], s[group];
      for (Index g = 0; g < group; ++g) e[g] = E[k + g], s[g] = z[k + g];
      for (Index i = 0; i < block_steps; ++i)
        for (Index g = 0; g < group; ++g) s[g] = e[g] * s[g] + u[i];
      for (Index g = 0; g < group; ++g) z[k + g] = s[g];
    }
    for (; k < K_; ++k)
      for (Index i = 0; i < block_steps; ++i) z[k] = E[k] * z[k] + u[i];
  }

  // far_i = Σ_k C_k E_k^i z_k, i = 0 .. b-1, in the eight modes of block b.
  void sum_far(Index b) {
    constexpr Index group = 4;
    const Lanes* E = &decay_[std::size_t(b * K_)];
    const Lanes* C = &output_[std::size_t(b * K_)];
    const Lanes* z = &z_[std::size_t(b * K_)];
    Lanes sum[block_steps];
    for (Index i = 0; i < block_steps; ++i) sum[i] = all(0);
    Index k = 0;
    for (; k + group <= K_; k += group) {
      Lanes t[group], e[group];
      for (Index g = 0; g < group; ++g) e[g] = E[k + g], t[g] = C[k + g] * z[k + g];
#pragma GCC unroll 16
      for (Index i = 0; i < block_steps; ++i) {
        sum[i] += (t[0] + t[1]) + (t[2] + t[3]);
        for (Index g = 0; g < group; ++g) t[g] *= e[g];
      }
    }
    for (; k < K_; ++k) {
      Lanes t = C[k] * z[k];
      for (Index i = 0; i < block_steps; ++i, t *= E[k]) sum[i] += t;
    }
    for (Index i = 0; i < block_steps; ++i) store(far_.row(i).data() + b * lanes, sum[i]);
  }

  // free = known part of v in modes: the far part and the lags within the block.
  void sum_near(Index i) {
    for (Index b = 0; b < blocks_; ++b) {
      Lanes sum[2] = {load(far_.row(i).data() + b * lanes), all(0)};
      for (Index d = 1; d <= i; ++d)
        sum[d % 2] += load(near_.row(d - 1).data() + b * lanes) * load(u_.row(i - d).data() + b * lanes);
      store(free_.data() + b * lanes, sum[0] + sum[1]);
    }
  }

  // Adds W_0 y to the known part: from the product of the complementarity solver, or in modes.
  void add_implicit(Index i) {
    const double* product = face_ ? nullptr : step_->product();
    if (const auto* M = std::get_if<Tridiagonal>(&M_); M && product) {
      multiply(*M, y_.data(), q_.data());
      known_.head(n_) += Eigen::Map<const Vector>(product, n_) - q_;
      return;
    }
    free_ += w0_.cwiseProduct(u_.row(i).transpose());
    to_points_->apply(free_.data(), known_.data());
  }

  const ModalRecurrence& r_;
  Poll asked_to_stop_;
  Index n_, blocks_, K_;
  const RowMatrix& response_;
  std::unique_ptr<HostArray> drive_;  ///< phi in modes
  const Array* given_drive_ = nullptr;
  std::unique_ptr<RowTransform> transform_of_drive_;
  std::shared_ptr<VectorTransform> to_modes_, to_points_;  ///< one for sine modes
  const LcpMatrix& M_;
  std::unique_ptr<host::FaceLcp> face_;  ///< of a face; else all in dense matrices
  std::optional<MarchStep> step_;
  Team& team_;
  bool shares_;  ///< the work of a block
  std::vector<Lanes> decay_, output_, z_;
  RowMatrix near_;     ///< b x n: W_1 .. W_b
  RowMatrix u_, far_;  ///< b x n: inputs and far parts of the block's steps
  Vector free_, known_, w0_, first_, q_, y_;
};

}  // namespace

std::unique_ptr<March> make_march(const MarchProblem& problem, Index rows, Team& team, const LinearStep& linear) {
  if (problem.lags) return make_lag_march(problem, rows, team, linear);
  if (const auto* modal = std::get_if<ModalRecurrence>(problem.recurrence))
    return std::make_unique<ModalMarch>(problem, *modal, rows, team, linear);
  return make_dense_march(problem, std::get<DenseRecurrence>(*problem.recurrence), rows, linear);
}

}  // namespace bromwich::cpu
