// A step of a model of few poles (core/host/pole_model.hpp). Every row of the state is a scalar problem ζ' = s ζ + u:
//
//     Z_i = see_i ζ + Σ_k reach_ik u_k,   see_i = Re' (v_i start/h) / (mu/h - s),   reach_ik = Re' v_i w_k / (mu/h - s)
//
// with Re' z = 2 Re z for two stages and z for one (core/host/stage_coefficients.hpp). N X_i = U Z_i + D u_i.

#include "core/host/stage_coefficients.hpp"
#include "core/host/stage_step.hpp"

#include <algorithm>

namespace bromwich::host {

namespace {

template <class Scalar>
class PoleStageStep final : public StageStep {
  static constexpr Index s = Coefficients<Scalar>::stages;

 public:
  PoleStageStep(const StageProblem& p, double h, const std::vector<Index>& rows)
      : model_(*p.poles),
        n_(model_.n),
        through_y_(model_.sources == 0),
        U_(model_.output.topRows(n_)),
        g_(last_stages(p.g, p.stages, s, rows)),
        phi_(last_stages(p.phi, p.stages, s, rows)) {
    const Coefficients<Scalar> c;
    const Index count = model_.rows();
    for (Index i = 0; i < s; ++i) {
      see_[i].resize(count);
      for (Index k = 0; k < s; ++k) reach_[i][k].resize(count);
    }
    for (Index r = 0; r < count; ++r) {
      const Scalar resolvent = Scalar(1) / (c.mu / h - model_.poles[r]);
      for (Index i = 0; i < s; ++i) {
        see_[i][r] = c.real(c.v[i] * c.start / h * resolvent);
        for (Index k = 0; k < s; ++k) reach_[i][k][r] = c.real(c.v[i] * c.w[k] * resolvent);
      }
    }
    set_implicit_part();
  }

  void free(const Vector& x, Index j, Vector& q, Vector& x_free) override {
    q = g_.row(j).transpose();
    for (Index i = 0; i < s; ++i) {
      Vector& Z = i + 1 < s ? first_ : x_free;
      Z = see_[i].matrix().cwiseProduct(x);
      for (Index k = 0; k < s && phi_.size() > 0; ++k) add_sources(j, k, reach_[i][k], Z);
    }
    add_outputs(x_free, q);
    for (Index i = 0; i < s && phi_.size() > 0; ++i) {
      const Index width = phi_.cols() / s;
      q.segment(i * n_, n_).noalias() +=
          model_.direct.block(0, through_y_ ? 0 : n_, n_, width) * phi_.row(j).segment(i * width, width).transpose();
    }
  }

  void drive(const Vector& y, Vector& x_free) const override {
    for (Index k = 0; k < s; ++k) {
      p_.noalias() = model_.basis.transpose() * y.segment(k * n_, n_);
      add(p_, 0, model_.driven, reach_[s - 1][k], x_free);
    }
  }

  const Matrix& implicit_part() const override { return implicit_; }
  std::size_t bytes() const override {
    return sizeof(double) *
           std::size_t(U_.size() + (s + s * s) * model_.rows() + implicit_.size() + g_.size() + phi_.size());
  }

 private:
  static constexpr Index panel = 64;  ///< columns of U that the cache keeps for the next stage

  // q_i += U Z_i. U, which is larger than the caches, is read once for all stages.
  void add_outputs(const Vector& last, Vector& q) const {
    for (Index r = 0; r < U_.cols(); r += panel) {
      const Index count = std::min(panel, U_.cols() - r);
      for (Index i = 0; i < s; ++i)
        q.segment(i * n_, n_).noalias() += U_.middleCols(r, count) * (i + 1 < s ? first_ : last).segment(r, count);
    }
  }

  void add(const Vector& inputs, Index first, Index last, const Eigen::ArrayXd& reach, Vector& x) const {
    for (Index r = first; r < last; ++r) x[r] += reach[r] * inputs[model_.direction[std::size_t(r)]];
  }

  void add_sources(Index j, Index k, const Eigen::ArrayXd& reach, Vector& x) const {
    const Index width = phi_.cols() / s;
    const Vector phi = phi_.row(j).segment(k * width, width).transpose();
    if (through_y_)
      add(model_.basis.transpose() * phi, 0, model_.driven, reach, x);
    else
      add(phi, model_.driven, model_.driven + model_.forced, reach, x);
  }

  void set_implicit_part() {
    implicit_.resize(s * n_, s * n_);
    for (Index i = 0; i < s; ++i)
      for (Index k = 0; k < s; ++k) {
        Matrix in_P = Matrix::Zero(n_, n_);
        for (Index r = 0; r < model_.driven; ++r)
          in_P.col(model_.direction[std::size_t(r)]) += reach_[i][k][r] * U_.col(r);
        auto block = implicit_.block(i * n_, k * n_, n_, n_);
        block.noalias() = in_P * model_.basis.transpose();
        if (i == k) block += model_.direct.topLeftCorner(n_, n_);
      }
  }

  const PoleModel& model_;
  Index n_;
  bool through_y_;  ///< phi, where there is one, adds to y
  Matrix U_;
  RowMatrix g_, phi_;
  Eigen::ArrayXd see_[s], reach_[s][s];
  Matrix implicit_;
  Vector first_;  ///< Z of the first of two stages
  mutable Vector p_;
};

}  // namespace

std::unique_ptr<StageStep> make_pole_stage_step(const StageProblem& p, Index stages, double h,
                                                const std::vector<Index>& rows) {
  if (stages == 2) return std::make_unique<PoleStageStep<Complex>>(p, h, rows);
  return std::make_unique<PoleStageStep<double>>(p, h, rows);
}

}  // namespace bromwich::host
