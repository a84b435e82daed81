// March with y discontinuous between steps (core/host/stage_march.hpp).

#include "core/host/stage_march.hpp"

#include "core/base/denormals.hpp"
#include "core/host/stage_stepper.hpp"
#include "core/numerics/sine_basis.hpp"

#include <array>
#include <cmath>
#include <map>

namespace bromwich::host {

namespace {

class Stages {
 public:
  explicit Stages(const StageProblem& p)
      : problem_(p),
        asked_to_stop_(p),
        rows_(p.g.rows()),
        lengths_(p, rows_),
        main_(p, p.stages, p.h, lengths_.rows(0)) {
    touching_.assign(std::size_t(p.g.cols() / p.stages), false);
    if (p.modal) {
      S_ = sine_matrix(p.modal->along.size());
      if (!p.components.empty()) across_ = p.modal->across;
      rigid_.assign(touching_.size(), p.modal->direct == 0 && diagonal(*p.M).isZero(0));
      return;
    }
    B_ = (*p.dynamics)->rates_of_inputs(p.h);
    if (p.poles) NB_ = (*p.dynamics)->outputs() * B_;
    rigid_ = rigid_constraints((*p.dynamics)->outputs());
  }

  StageSolution run(const Vector& y0) {
    const FlushDenormals flush;
    const Index n = y0.size();
    StageSolution out;
    for (RowMatrix* values : {&out.y, &out.impulse, &out.v}) values->resize(rows_, n);
    out.x.resize(rows_, Index(problem_.components.size()));
    out.report.well_posed = main_.well_posed();
    Vector x = start(), next(x.size());
    out.y.row(0) = y0.transpose();
    out.impulse.row(0).setZero();
    record(x, 0, out);
    regular_ = y0.allFinite() ? y0 : Vector(Vector::Zero(n));
    touch_at_start(problem_.modal ? observe(*problem_.dynamics, problem_.x0) : Vector(out.v.row(0).transpose()));
    for (Index j = 1; j < rows_; ++j) {
      const Stepper* used = asked_to_stop_(j, out.report) ? nullptr : take(x, j, next, out.report);
      if (!used) {
        for (RowMatrix* values : {&out.y, &out.impulse, &out.v, &out.x}) values->bottomRows(rows_ - j).setConstant(NAN);
        break;
      }
      if (j == 1 && !y0.allFinite()) out.y.row(0) = used->first_stage().transpose();
      const Vector y = used->last_stage();
      for (std::size_t i = 0; i < touching_.size(); ++i) touching_[i] = y[Index(i)] > 0;
      if (used->stages() == problem_.stages)
        regular_ = regular_.cwiseMax(y);
      else if (impact_)
        out.impacts.push_back(j);
      out.y.row(j) = y.transpose();
      out.impulse.row(j) = lengths_.size(lengths_.kind(j)) * used->mean().transpose();
      x.swap(next);
      record(x, j, out);
    }
    if (problem_.modal) finish_modes(out);
    out.bytes = bytes();
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

  // S N x of a state in modes.
  Vector seen_in_modes(const Vector& x) const {
    const ModalStages& modal = *problem_.modal;
    const Eigen::Map<const RowMatrix> z(x.data(), modal.rates.size(), modal.along.size());
    return z.transpose() * modal.output;
  }

  // N x of all rows from modes, and row 0 from x0 itself.
  void finish_modes(StageSolution& out) const {
    const Index valid = out.report.stopped >= 0 ? out.report.stopped : rows_;
    if (valid > 0) out.v.topRows(valid) = (out.v.topRows(valid) * S_).eval();
  }

  std::size_t bytes() const {
    std::size_t sum = main_.bytes();
    for (const auto& of_stages : others_)
      for (const auto& [kind, stepper] : of_stages) sum += stepper->bytes();
    return sum;
  }

  // Rigid position constraints: M_ii = 0, and y_i acts on the second or a higher derivative of w_i. With M_ii > 0 a
  // contact is a spring, which throws back.
  std::vector<bool> rigid_constraints(const SparseMatrix& N) const {
    const Matrix M = to_dense(*problem_.M);
    const Eigen::SparseMatrix<double, Eigen::RowMajor> rows = N;
    std::vector<bool> rigid(std::size_t(M.rows()));
    for (Index i = 0; i < M.rows(); ++i) {
      const double first = rows.row(i).dot(B_.col(i)), terms = rows.row(i).cwiseAbs().dot(B_.col(i).cwiseAbs());
      rigid[std::size_t(i)] = M(i, i) == 0 && std::abs(first) <= negligible * terms;
    }
    return rigid;
  }

  // Marks the constraints with w(0) = 0; `seen` is N x0.
  void touch_at_start(const Vector& seen) {
    const Vector g = problem_.g.row(0).head(seen.size()).transpose();
    const Vector size = (*problem_.dynamics)->observed_terms(problem_.x0) + g.cwiseAbs();
    for (Index i = 0; i < seen.size(); ++i)
      touching_[std::size_t(i)] = std::abs(seen[i] + g[i]) <= negligible * size[i];
  }

  // Whether a rigid constraint has a new contact. If it is active at both stages, Radau IIA sends the state back with a
  // velocity of up to twice the distance to the constraint divided by the step.
  bool impacts(const Stepper& step) const {
    const Vector most = step.first_stage().cwiseMax(step.last_stage());
    for (std::size_t i = 0; i < rigid_.size(); ++i)
      if (rigid_[i] && !touching_[i] && most[Index(i)] > 0) return true;
    return false;
  }

  // Detects an impulse: y_i is released within the step, and it either moves a component of the state by a large part
  // of its size (small components are measured against a hundredth of the largest) or is much larger than in steps
  // without jumps. Radau IIA would move the state by 9/5 of the impulse, and many small errors of this kind add up.
  // Contacts that stay or begin have no part in this: a step that ends in contact ends on the constraint.
  bool jumps(const Stepper& step, double h, const Vector& before, const Vector& after) const {
    const Vector first = step.first_stage(), last = step.last_stage();
    const double zero = negligible * step.Y.cwiseAbs().maxCoeff();
    // In a part of a step, y halves only after an impulse. Other constraints may then hold the state, so y need not be
    // 0.
    for (Index i = 0; i < first.size() && h < problem_.h / 2 && step.stages() == 2; ++i)
      if (first[i] > std::max(zero, much_more * regular_[i]) && last[i] < first[i] / 2) return true;
    if (!step.switches()) return false;
    Vector released = Vector::Zero(first.size());
    for (Index i = 0; i < first.size(); ++i) {
      if (!(first[i] > zero) || last[i] > zero) continue;
      if (first[i] > much_more * regular_[i]) return true;
      released[i] = first[i];
    }
    return !released.isZero(0) && moves(released, step, h, before, after);
  }

  // Whether y of the first stage moves a component by a quarter of its size. In modes and with poles N x stands for the
  // state: y moves it by h N B y, or less if what is stiff forgets it before the end of the step.
  bool moves(const Vector& y, const Stepper& step, double h, const Vector& before, const Vector& after) const {
    const auto state = [&](const Vector& x) {
      if (problem_.poles) return Vector(problem_.poles->output.topRows(NB_.rows()) * x);
      return problem_.modal ? Vector(S_ * seen_in_modes(x)) : x;
    };
    Vector moved = h * (problem_.modal ? Vector(problem_.modal->direct * y) : Vector((problem_.poles ? NB_ : B_) * y));
    moved = moved.cwiseAbs();
    if (problem_.poles || problem_.modal) moved = moved.cwiseMin(step.seen_at_end(y).cwiseAbs() / weight_of_first);
    const Vector size = state(before).cwiseAbs().cwiseMax(state(after).cwiseAbs());
    return (moved.array() > 0.25 * size.cwiseMax(0.01 * size.maxCoeff()).array()).any();
  }
  static constexpr double weight_of_first = 0.75;  ///< of the first stage at the end of the step
  static constexpr double negligible = 1e-9;       ///< relative to the largest y of the step
  static constexpr double much_more = 4;           ///< relative to y in steps without jumps

  Stepper& stepper(Index stages, std::size_t kind) {
    if (stages == problem_.stages && kind == 0) return main_;
    auto& made = others_[std::size_t(stages - 1)];
    if (const auto found = made.find(kind); found != made.end()) return *found->second;
    if (made.size() >= most_kept) made.clear();
    return *(made[kind] = std::make_unique<Stepper>(problem_, stages, lengths_.size(kind), lengths_.rows(kind)));
  }

  // The step to t_j with the stages of the problem, or with one stage if the state jumps or two have no solution. Null:
  // unsolved.
  const Stepper* take(const Vector& x, Index j, Vector& next, MarchReport& report) {
    const std::size_t kind = lengths_.kind(j);
    const Index place = lengths_.place(j);
    Stepper& main = stepper(problem_.stages, kind);
    const bool fine = main.advance(x, place, j, touching_, next, report);
    if (problem_.stages == 1 || (fine && !problem_.substitutes_euler)) return fine ? &main : nullptr;
    impact_ = fine && impacts(main);
    if (fine && !impact_ && !jumps(main, lengths_.size(kind), x, next)) return &main;
    MarchReport by_euler = report;
    by_euler.stopped = by_euler.infeasible = -1;
    by_euler.count.unsolved = 0;
    other_.resize(x.size());
    Stepper& one_stage = stepper(1, kind);
    if (!one_stage.advance(x, place, j, touching_, other_, by_euler)) return fine ? &main : nullptr;
    next.swap(other_);
    report = by_euler;
    ++report.jumps;
    return &one_stage;
  }

  void record(const Vector& x, Index j, StageSolution& out) const {
    if (problem_.modal) return record_modes(x, j, out);
    if (problem_.poles && j > 0) return record_poles(x, j, out);
    out.v.row(j) = observe(*problem_.dynamics, problem_.poles ? problem_.x0 : x).transpose();
    const Vector& state = problem_.poles ? problem_.x0 : x;
    for (std::size_t c = 0; c < problem_.components.size(); ++c) out.x(j, Index(c)) = state[problem_.components[c]];
  }

  // U ζ + D (y, phi).
  void record_poles(const Vector& x, Index j, StageSolution& out) const {
    const PoleModel& model = *problem_.poles;
    Vector seen = model.output * x + model.direct.leftCols(model.n) * out.y.row(j).transpose();
    if (problem_.phi.size() > 0) {
      const Index width = problem_.phi.cols() / problem_.stages;
      seen +=
          model.direct.middleCols(model.sources > 0 ? model.n : 0, width) * problem_.phi.row(j).tail(width).transpose();
    }
    out.v.row(j) = seen.head(model.n).transpose();
    out.x.row(j) = seen.tail(model.components).transpose();
  }

  // v in modes, which are transformed at the end, and components of the state.
  void record_modes(const Vector& x, Index j, StageSolution& out) const {
    out.v.row(j) = seen_in_modes(x).transpose();
    if (problem_.components.empty()) return;
    const ModalStages& modal = *problem_.modal;
    const Index n = modal.along.size(), K = modal.rates.size();
    const Eigen::Map<const RowMatrix> z(x.data(), K, n);
    const Matrix state = across_ * z * S_;  // positions x lines
    for (std::size_t c = 0; c < problem_.components.size(); ++c) {
      const Index i = problem_.components[c];
      out.x(j, Index(c)) = j == 0 ? problem_.x0[i] : state(i % K, i / K);
    }
  }

  const StageProblem& problem_;
  Poll asked_to_stop_;
  Index rows_;
  static constexpr std::size_t most_kept = 64;  ///< lengths
  Lengths lengths_;
  Stepper main_;
  std::array<std::map<std::size_t, std::unique_ptr<Stepper>>, 2> others_;  ///< by kind; one-stage and two-stage
  Vector other_;
  Vector regular_;       ///< largest y_i at the ends of steps without jumps
  SparseMatrix B_, NB_;  ///< E^{-1} B; N E^{-1} B of a model of poles
  Matrix S_, across_;    ///< the modes along and across the lines of a Kronecker sum
  std::vector<bool> rigid_;
  bool impact_ = false;         ///< the last step was an impact on a rigid constraint
  std::vector<bool> touching_;  ///< y_i > 0 at the end of the last step
};

}  // namespace
}  // namespace bromwich::host

namespace bromwich {

StageSolution march_by_stages(const StageProblem& problem, const Vector& y0) { return host::Stages(problem).run(y0); }

}  // namespace bromwich
