#include "core/host/stage_step.hpp"

#include "core/base/error.hpp"
#include "core/host/stage_coefficients.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/equilibration.hpp"

#include <Eigen/LU>

#include <cmath>
#include <utility>

namespace bromwich::host {

namespace {

[[noreturn]] void singular_step() {
  throw Error("steps", "a step is singular: h meets an eigenvalue of A", "use another number of steps");
}

// The result of a solve with the matrix of a step.
template <class Solve>
auto regular(const Solve& solve) {
  try {
    return solve();
  } catch (const SingularShift&) {
    singular_step();
  }
}

template <class Scalar>
DenseStageMaps dense_maps(const StageProblem& p, const DenseDynamics& d, double h, const std::vector<Index>& rows) {
  using ScalarMatrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;
  constexpr Index s = Coefficients<Scalar>::stages;
  const Coefficients<Scalar> c;
  const Index m = d.A.rows(), n = d.N.rows();
  const auto inverse = regular_inverse(ScalarMatrix(c.mu / h * ScalarMatrix::Identity(m, m) - d.A.cast<Scalar>()));
  if (!inverse) singular_step();
  const ScalarMatrix& R = *inverse;
  const Matrix F = p.F;
  const Index k = F.cols();
  DenseStageMaps maps{{},
                      Matrix(s * n, m),
                      Matrix(m, s * n),
                      Matrix(s * n, s * n),
                      Matrix(m, s * k),
                      Matrix(s * n, s * k),
                      last_stages(p.g, p.stages, s, rows),
                      {}};
  for (Index i = 0; i < s; ++i) {
    maps.decay = c.real(c.v[i] * c.start / h * R);  // of the last stage after the loop
    maps.see.middleRows(i * n, n) = d.N * maps.decay;
    for (Index j = 0; j < s; ++j) {
      const Matrix Q = c.real(c.v[i] * c.w[j] * R), QB = Q * d.B;
      maps.implicit.block(i * n, j * n, n, n) = d.N * QB;
      if (i == s - 1) maps.drive.middleCols(j * n, n) = QB;
      if (k == 0) continue;
      const Matrix QF = Q * F;
      maps.seen_push.block(i * n, j * k, n, k) = d.N * QF;
      if (i == s - 1) maps.push.middleCols(j * k, k) = QF;
    }
  }
  const RowMatrix phi = last_stages(p.phi, p.stages, s, rows);
  if (phi.size() == 0) return maps;
  maps.q += phi * maps.seen_push.transpose();
  maps.forcing = phi * maps.push.transpose();
  return maps;
}

// Dense operators: a step is a few products with small matrices.
class DenseStageStep final : public StageStep {
 public:
  explicit DenseStageStep(DenseStageMaps maps) : maps_(std::move(maps)) {}

  void free(const Vector& x, Index j, Vector& q, Vector& x_free) override {
    q = maps_.q.row(j).transpose();
    q.noalias() += maps_.see * x;
    x_free.noalias() = maps_.decay * x;
    if (maps_.forcing.size() > 0) x_free += maps_.forcing.row(j).transpose();
  }
  void drive(const Vector& y, Vector& x_free) const override { x_free.noalias() += maps_.drive * y; }
  const Matrix& implicit_part() const override { return maps_.implicit; }
  const DenseStageMaps* maps() const override { return &maps_; }
  std::size_t bytes() const override {
    return sizeof(double) * std::size_t(maps_.decay.size() + maps_.see.size() + maps_.drive.size() +
                                        maps_.implicit.size() + maps_.q.size() + maps_.forcing.size());
  }

 private:
  DenseStageMaps maps_;
};

// One shifted solve per step.
template <class Scalar>
class SolvedStep final : public StageStep {
  static constexpr Index s = Coefficients<Scalar>::stages;
  using ScalarVector = Eigen::Matrix<Scalar, Eigen::Dynamic, 1>;
  using ScalarMatrix = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic>;

 public:
  SolvedStep(const StageProblem& p, double h, const std::vector<Index>& rows)
      : h_(h),
        system_(**p.dynamics),
        N_(system_.outputs()),
        F_(p.F),
        g_(last_stages(p.g, p.stages, s, rows)),
        phi_(last_stages(p.phi, p.stages, s, rows)),
        shifted_(regular([&] { return system_.at_shift(Coefficients<Scalar>().mu / h); })) {
    if (!shifted_) singular_step();
    const Index m = system_.states(), n = N_.rows();
    const ScalarMatrix B = Matrix(system_.inputs()).cast<Scalar>(), RB = regular([&] { return shifted_->solve(B); });
    drive_.resize(m, s * n);
    implicit_.resize(s * n, s * n);
    for (Index i = 0; i < s; ++i)
      for (Index k = 0; k < s; ++k) {
        const Matrix QB = c_.real(c_.v[i] * c_.w[k] * RB);
        implicit_.block(i * n, k * n, n, n) = N_ * QB;
        if (i == s - 1) drive_.middleCols(k * n, n) = QB;
      }
  }

  void free(const Vector& x, Index j, Vector& q, Vector& x_free) override {
    rhs_ = (c_.start / h_) * system_.times_mass(x).template cast<Scalar>();
    for (Index k = 0; k < s && phi_.size() > 0; ++k) {
      x_free.noalias() = F_ * phi_.row(j).segment(k * F_.cols(), F_.cols()).transpose();
      rhs_ += c_.w[k] * x_free.cast<Scalar>();
    }
    xi_ = regular([&] { return shifted_->solve(rhs_); });
    const Index n = N_.rows();
    q = g_.row(j).transpose();
    for (Index i = 0; i < s; ++i) {
      x_free = c_.real(c_.v[i] * xi_);
      q.segment(i * n, n) += N_ * x_free;
    }
  }
  void drive(const Vector& y, Vector& x_free) const override { x_free.noalias() += drive_ * y; }
  const Matrix& implicit_part() const override { return implicit_; }
  std::size_t bytes() const override {
    return shifted_->bytes() + sizeof(double) * std::size_t(drive_.size() + implicit_.size() + g_.size() + phi_.size());
  }

 private:
  Coefficients<Scalar> c_;
  double h_;
  const LinearSystem& system_;
  SparseMatrix N_, F_;
  RowMatrix g_, phi_;
  std::unique_ptr<ShiftedSystem<Scalar>> shifted_;  ///< (mu/h E - A)^{-1}
  Matrix drive_, implicit_;
  ScalarVector rhs_, xi_;
};

template <class Scalar>
std::unique_ptr<StageStep> make(const StageProblem& p, double h, const std::vector<Index>& rows) {
  if (const auto* d = (*p.dynamics)->small_state())
    return std::make_unique<DenseStageStep>(dense_maps<Scalar>(p, *d, h, rows));
  return std::make_unique<SolvedStep<Scalar>>(p, h, rows);
}

}  // namespace

RowMatrix last_stages(const RowMatrix& values, Index given, Index used, const std::vector<Index>& rows) {
  if (values.size() == 0) return RowMatrix(values.rows() > 0 ? Index(rows.size()) : 0, 0);
  const Index width = values.cols() / given;
  return values(rows, Eigen::seqN(values.cols() - used * width, used * width));
}

DenseStageMaps dense_stage_maps(const StageProblem& p, const DenseDynamics& d, Index stages, double h,
                                const std::vector<Index>& rows) {
  return stages == 2 ? dense_maps<Complex>(p, d, h, rows) : dense_maps<double>(p, d, h, rows);
}

std::unique_ptr<StageStep> make_stage_step(const StageProblem& p, Index stages, double h,
                                           const std::vector<Index>& rows) {
  if (p.poles) return make_pole_stage_step(p, stages, h, rows);
  if (p.modal) return make_modal_stage_step(p, stages, h, rows);
  return stages == 2 ? make<Complex>(p, h, rows) : make<double>(p, h, rows);
}

}  // namespace bromwich::host
