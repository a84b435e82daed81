// A step of a Kronecker sum in modes. All rates of all modes are scalar problems x' = lambda x + u:
//
//     X_i = see_i x + Σ_k reach_ik u_k,   see_i = Re' (v_i start/h) / (mu/h - lambda),   reach_ik = Re' v_i w_k / (...)
//
// with Re' z = 2 Re z for two stages and z for one (core/host/stage_coefficients.hpp). Values of constraints are
// transformed by one product with the modes of the face for all stages.

#include "core/base/error.hpp"
#include "core/host/stage_coefficients.hpp"
#include "core/host/stage_step.hpp"

#include <cmath>

namespace bromwich::host {

namespace {

template <class Scalar>
class ModalStageStep final : public StageStep {
  static constexpr Index s = Coefficients<Scalar>::stages;

 public:
  ModalStageStep(const StageProblem& p, double h, const std::vector<Index>& rows)
      : modal_(*p.modal),
        n_(modal_.along.size()),
        K_(modal_.rates.size()),
        V_(modal_.face.matrix()),
        g_(last_stages(p.g, p.stages, s, rows)),
        phi_(last_stages(p.phi, p.stages, s, rows)) {
    for (Index i = 0; i < s && phi_.size() > 0; ++i)
      phi_.middleCols(i * n_, n_) = (phi_.middleCols(i * n_, n_) * V_).eval();
    const Coefficients<Scalar> c;
    for (Index i = 0; i < s; ++i) {
      see_[i].resize(K_, n_);
      drive_[i].resize(K_, n_);
    }
    Matrix implicit = Matrix::Zero(s * s, n_);  // per mode, row i s + k
    for (Index k = 0; k < K_; ++k)
      for (Index l = 0; l < n_; ++l) {
        const Scalar r = Scalar(1) / (c.mu / h - (modal_.rates[k] + modal_.along[l]));
        if (!std::isfinite(std::abs(r)))
          throw Error("steps", "a step is singular: h meets an eigenvalue of A", "use another number of steps");
        for (Index i = 0; i < s; ++i) {
          see_[i](k, l) = c.real(c.v[i] * c.start / h * r);
          drive_[i](k, l) = modal_.input(k, l) * c.real(c.v[s - 1] * c.w[i] * r);
          for (Index j = 0; j < s; ++j)
            implicit(i * s + j, l) += modal_.output(k, l) * modal_.input(k, l) * c.real(c.v[i] * c.w[j] * r);
        }
      }
    in_modes_ = implicit;
    implicit_.resize(s * n_, s * n_);
    for (Index i = 0; i < s; ++i)
      for (Index j = 0; j < s; ++j)
        implicit_.block(i * n_, j * n_, n_, n_) = V_ * implicit.row(i * s + j).asDiagonal() * V_.transpose();
  }

  void free(const Vector& x, Index j, Vector& q, Vector& x_free) override {
    const Eigen::Map<const RowMatrix> z(x.data(), K_, n_);
    x_free.resize(x.size());
    Eigen::Map<RowMatrix> next(x_free.data(), K_, n_);
    seen_.setZero(n_, s);
    for (Index k = 0; k < K_; ++k) {
      next.row(k).array() = see_[s - 1].row(k).array() * z.row(k).array();
      const auto output = modal_.output.row(k).array();
      seen_.col(s - 1).array() += (output * next.row(k).array()).transpose();
      if (s == 2) seen_.col(0).array() += (output * see_[0].row(k).array() * z.row(k).array()).transpose();
    }
    if (phi_.size() > 0) {
      for (Index i = 0; i < s; ++i) inputs_[i] = phi_.row(j).segment(i * n_, n_).transpose();
      add_inputs(x_free);
      for (Index i = 0; i < s; ++i)
        for (Index k = 0; k < s; ++k)
          seen_.col(i).array() += in_modes_.row(i * s + k).transpose().array() * inputs_[k].array();
    }
    q_.noalias() = V_ * seen_;
    q = g_.row(j).transpose() + Eigen::Map<const Vector>(q_.data(), s * n_);
  }

  void drive(const Vector& y, Vector& x_free) const override {
    q_.noalias() = V_.transpose() * Eigen::Map<const Matrix>(y.data(), n_, s);
    for (Index i = 0; i < s; ++i) inputs_[i] = q_.col(i);
    add_inputs(x_free);
  }

  const Matrix& implicit_part() const override { return implicit_; }
  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(2 * s * K_ * n_ + V_.size() + implicit_.size() + g_.size() + phi_.size());
  }

 private:
  void add_inputs(Vector& x) const {
    Eigen::Map<RowMatrix> z(x.data(), K_, n_);
    for (Index k = 0; k < K_; ++k)
      for (Index i = 0; i < s; ++i) z.row(k).array() += drive_[i].row(k).array() * inputs_[i].transpose().array();
  }

  const ModalStages& modal_;
  Index n_, K_;
  Matrix V_;
  RowMatrix g_, phi_;  ///< phi in modes
  RowMatrix see_[s], drive_[s];
  Matrix in_modes_, implicit_, seen_;
  mutable Matrix q_;
  mutable Vector inputs_[s];
};

}  // namespace

std::unique_ptr<StageStep> make_modal_stage_step(const StageProblem& p, Index stages, double h,
                                                 const std::vector<Index>& rows) {
  if (stages == 2) return std::make_unique<ModalStageStep<Complex>>(p, h, rows);
  return std::make_unique<ModalStageStep<double>>(p, h, rows);
}

}  // namespace bromwich::host
