// March with y discontinuous between steps (core/host/stage_march.hpp).

#include "core/host/stage_march.hpp"

#include "core/base/denormals.hpp"
#include "core/host/stage_steps.hpp"

#include <cmath>

namespace bromwich::host {

namespace {

class Stages {
 public:
  explicit Stages(const StageProblem& p) : problem_(p), asked_to_stop_(p), rows_(p.g.rows()), steps_(p) {
    if (!p.modal) return;
    V_ = p.modal->face.matrix();
    if (!p.components.empty()) across_ = p.modal->across;
  }

  StageSolution run(const Vector& y0) {
    const FlushDenormals flush;
    const Index n = y0.size();
    StageSolution out;
    for (RowMatrix* values : {&out.y, &out.impulse, &out.v}) values->resize(rows_, n);
    out.x.resize(rows_, Index(problem_.components.size()));
    out.report.well_posed = steps_.well_posed();
    Vector x = start(), next(x.size());
    out.y.row(0) = y0.transpose();
    out.impulse.row(0).setZero();
    record(x, 0, out);
    steps_.start(problem_.x0, y0,
                 problem_.modal ? observe(*problem_.dynamics, problem_.x0) : Vector(out.v.row(0).transpose()));
    for (Index j = 1; j < rows_; ++j) {
      const Stepper* used = asked_to_stop_(j, out.report) ? nullptr : steps_.take(x, j, next, out.report);
      if (!used) {
        for (RowMatrix* values : {&out.y, &out.impulse, &out.v, &out.x}) values->bottomRows(rows_ - j).setConstant(NAN);
        break;
      }
      if (j == 1 && !y0.allFinite()) out.y.row(0) = used->first_stage().transpose();
      const auto y = used->last_stage();
      steps_.pass(*used);
      if (used->stages() != problem_.stages && steps_.impact()) out.impacts.push_back(j);
      out.y.row(j) = y.transpose();
      out.impulse.row(j) = steps_.length(j) * used->mean().transpose();
      x.swap(next);
      record(x, j, out, used);
    }
    if (problem_.modal) finish_modes(out);
    out.bytes = steps_.bytes();
    return out;
  }

 private:
  Vector start() const {
    if (problem_.poles) {
      const PoleModel& model = *problem_.poles;
      Vector zeta = Vector::Zero(model.rows());
      zeta.tail(model.rows() - model.driven - model.forced).setOnes();
      return zeta;
    }
    if (!problem_.modal) return problem_.x0;
    const RowMatrix& z = problem_.modal->start;
    return Eigen::Map<const Vector>(z.data(), z.size());
  }

  // N x of all rows from modes, and row 0 from x0 itself.
  void finish_modes(StageSolution& out) const {
    const Index valid = out.report.stopped >= 0 ? out.report.stopped : rows_;
    if (valid > 0) out.v.topRows(valid) = (out.v.topRows(valid) * V_.transpose()).eval();
  }

  // `used`: the step to row j, null for row 0.
  void record(const Vector& x, Index j, StageSolution& out, const Stepper* used = nullptr) const {
    if (problem_.modal) return record_modes(x, j, out);
    if (problem_.poles && used) return record_poles(x, j, *used, out);
    out.v.row(j) = observe(*problem_.dynamics, problem_.poles ? problem_.x0 : x).transpose();
    const Vector& state = problem_.poles ? problem_.x0 : x;
    for (std::size_t c = 0; c < problem_.components.size(); ++c) out.x(j, Index(c)) = state[problem_.components[c]];
  }

  // N x from the problem of the step, and U ζ + D (y, phi) of the components.
  void record_poles(const Vector& x, Index j, const Stepper& used, StageSolution& out) const {
    const PoleModel& model = *problem_.poles;
    out.v.row(j) = used.seen_at_end().transpose() - problem_.g.row(j).tail(model.n);
    if (model.components == 0) return;
    const auto direct = model.direct.bottomRows(model.components);
    Vector seen = model.output.bottomRows(model.components) * x + direct.leftCols(model.n) * out.y.row(j).transpose();
    if (problem_.phi.size() > 0) {
      const Index width = problem_.phi.cols() / problem_.stages;
      seen += direct.middleCols(model.sources > 0 ? model.n : 0, width) * problem_.phi.row(j).tail(width).transpose();
    }
    out.x.row(j) = seen.transpose();
  }

  // v in modes, which are transformed at the end, and components of the state.
  void record_modes(const Vector& x, Index j, StageSolution& out) const {
    out.v.row(j) = seen_in_modes(*problem_.modal, x).transpose();
    if (problem_.components.empty()) return;
    const ModalStages& modal = *problem_.modal;
    const Index n = modal.along.size(), K = modal.rates.size();
    const Eigen::Map<const RowMatrix> z(x.data(), K, n);
    const Matrix state = across_ * z * V_.transpose();  // positions x lines
    for (std::size_t c = 0; c < problem_.components.size(); ++c) {
      const Index i = problem_.components[c];
      out.x(j, Index(c)) = j == 0 ? problem_.x0[i] : state(i % K, i / K);
    }
  }

  const StageProblem& problem_;
  Poll asked_to_stop_;
  Index rows_;
  StageSteps steps_;
  Matrix V_, across_;  ///< modes of the face and of the lines of a Kronecker sum
};

}  // namespace
}  // namespace bromwich::host

namespace bromwich {

StageSolution march_by_stages(const StageProblem& problem, const Vector& y0) { return host::Stages(problem).run(y0); }

}  // namespace bromwich
