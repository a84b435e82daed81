#include "core/host/stage_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich::host {

namespace {

constexpr double weight_of_first = 0.75;  ///< of the first stage at the end of the step
constexpr double negligible = 1e-9;       ///< relative to the largest y of the step
constexpr double much_more = 4;           ///< relative to y in steps without jumps

// Whether two steps from x end at about the same state, beside what they move it by.
bool end_alike(const Vector& x, const Vector& one, const Vector& other) {
  constexpr double apart = 0.5;  // smooth decay by implicit Euler and by Radau IIA: 0.3 at most
  return x.size() == 0 || (one - other).cwiseAbs().maxCoeff() <= apart * (other - x).cwiseAbs().maxCoeff();
}

}  // namespace

Vector seen_in_modes(const ModalStages& modal, const Vector& x) {
  const Eigen::Map<const RowMatrix> z(x.data(), modal.rates.size(), modal.along.size());
  return z.cwiseProduct(modal.output).colwise().sum().transpose();
}

StageSteps::StageSteps(const StageProblem& p)
    : problem_(p), lengths_(p, p.g.rows()), main_(p, p.stages, p.h, lengths_.rows(0)) {
  touching.assign(std::size_t(p.g.cols() / p.stages), false);
  resume(touching, Vector::Zero(p.g.cols() / p.stages));
  if (p.modal) {
    V_ = p.modal->face.matrix();
    rigid_.assign(touching.size(), p.modal->direct == 0 && diagonal(*p.M).isZero(0));
    return;
  }
  B_ = (*p.dynamics)->rates_of_inputs(p.h);
  if (p.poles) NB_ = (*p.dynamics)->outputs() * B_;
  rigid_ = rigid_constraints((*p.dynamics)->outputs(), B_, to_dense(*p.M));
}

std::vector<bool> StageSteps::rigid_constraints(const SparseMatrix& N, const SparseMatrix& B, const Matrix& M) {
  const Eigen::SparseMatrix<double, Eigen::RowMajor> rows = N;
  std::vector<bool> rigid(std::size_t(M.rows()));
  for (Index i = 0; i < M.rows(); ++i) {
    const double first = rows.row(i).dot(B.col(i)), terms = rows.row(i).cwiseAbs().dot(B.col(i).cwiseAbs());
    rigid[std::size_t(i)] = M(i, i) == 0 && std::abs(first) <= negligible * terms;
  }
  return rigid;
}

void StageSteps::resume(const std::vector<bool>& touching_before, const Vector& before) {
  touching = touching_before;
  regular = before;
  own_regular_ = Vector::Zero(before.size());
  same_before_ = {Vector::Zero(before.size()), Vector::Constant(before.size(), INFINITY)};
}

void StageSteps::start(const Vector& x0, const Vector& y0, const Vector& seen) {
  regular = y0.allFinite() ? y0 : Vector(Vector::Zero(y0.size()));
  const Vector g = problem_.g.row(0).head(seen.size()).transpose();
  const Vector size = (*problem_.dynamics)->observed_terms(x0) + g.cwiseAbs();
  for (Index i = 0; i < seen.size(); ++i) touching[std::size_t(i)] = std::abs(seen[i] + g[i]) <= negligible * size[i];
}

void StageSteps::pass(const Stepper& used) {
  const auto y = used.last_stage();
  for (std::size_t i = 0; i < touching.size(); ++i) touching[i] = y[Index(i)] > 0;
  if (used.stages() != problem_.stages) return;
  regular = regular.cwiseMax(y);
  own_regular_ = own_regular_.cwiseMax(y);
}

// Whether y_i is much more than in steps without jumps.
bool StageSteps::exceeds_regular(Index i, double y) const {
  const bool exceeds = y > much_more * regular[i];
  if (exceeds)
    same_before_.below[i] = std::min(same_before_.below[i], y / much_more);
  else if (y > much_more * own_regular_[i])
    same_before_.least[i] = std::max(same_before_.least[i], y / much_more);
  return exceeds;
}

// Whether a rigid constraint has a new contact. If it is active at both stages, Radau IIA sends the state back with a
// velocity of up to twice the distance to the constraint divided by the step.
bool StageSteps::impacts(const Stepper& step) const {
  const auto first = step.first_stage(), last = step.last_stage();
  for (std::size_t i = 0; i < rigid_.size(); ++i)
    if (rigid_[i] && !touching[i] && std::max(first[Index(i)], last[Index(i)]) > 0) return true;
  return false;
}

// Detects an impulse: y_i is released within the step, and it either moves a component of the state by a large part
// of its size (small components are measured against a hundredth of the largest) or is much larger than in steps
// without jumps. Radau IIA would move the state by 9/5 of the impulse, and many small errors of this kind add up.
// Contacts that stay or begin have no part in this: a step that ends in contact ends on the constraint.
bool StageSteps::jumps(const Stepper& step, double h, const Vector& before, const Vector& after) const {
  const auto first = step.first_stage(), last = step.last_stage();
  const double zero = negligible * step.Y.cwiseAbs().maxCoeff();
  // In a part of a step, y halves only after an impulse. Other constraints may then hold the state, so y need not be
  // 0.
  for (Index i = 0; i < first.size() && h < problem_.h / 2 && step.stages() == 2; ++i)
    if (first[i] > zero && last[i] < first[i] / 2 && exceeds_regular(i, first[i])) return true;
  if (!step.switches()) return false;
  Vector released = Vector::Zero(first.size());
  for (Index i = 0; i < first.size(); ++i) {
    if (!(first[i] > zero) || last[i] > zero) continue;
    if (exceeds_regular(i, first[i])) return true;
    released[i] = first[i];
  }
  return !released.isZero(0) && moves(released, step, h, before, after);
}

// Whether y of the first stage moves a component by a quarter of its size. In modes and with poles N x stands for the
// state: y moves it by h N B y, or less if what is stiff forgets it before the end of the step.
bool StageSteps::moves(const Vector& y, const Stepper& step, double h, const Vector& before,
                       const Vector& after) const {
  const auto state = [&](const Vector& x) {
    if (problem_.poles) return Vector(problem_.poles->output.topRows(NB_.rows()) * x);
    return problem_.modal ? Vector(V_ * seen_in_modes(*problem_.modal, x)) : x;
  };
  Vector moved = h * (problem_.modal ? Vector(problem_.modal->direct * y) : Vector((problem_.poles ? NB_ : B_) * y));
  moved = moved.cwiseAbs();
  if (problem_.poles || problem_.modal) moved = moved.cwiseMin(step.seen_at_end(y).cwiseAbs() / weight_of_first);
  const Vector size = state(before).cwiseAbs().cwiseMax(state(after).cwiseAbs());
  return (moved.array() > 0.25 * size.cwiseMax(0.01 * size.maxCoeff()).array()).any();
}

Stepper& StageSteps::stepper(Index stages, std::size_t kind) {
  if (stages == problem_.stages && kind == 0) return main_;
  auto& made = others_[std::size_t(stages - 1)];
  if (const auto found = made.find(kind); found != made.end()) return *found->second;
  if (made.size() >= most_kept_ || bytes() > most_kept_bytes_) made.clear();
  return *(made[kind] = std::make_unique<Stepper>(problem_, stages, lengths_.size(kind), lengths_.rows(kind)));
}

const Stepper* StageSteps::take(const Vector& x, Index j, Vector& next, MarchReport& report) {
  const std::size_t kind = lengths_.kind(j);
  const Index place = lengths_.place(j);
  Stepper& main = stepper(problem_.stages, kind);
  const bool fine = main.advance(x, place, j, touching, next, report);
  if (problem_.stages == 1 || (fine && !problem_.substitutes_euler)) return fine ? &main : nullptr;
  impact_ = fine && impacts(main);
  const bool regular_step = fine && !impact_ && !jumps(main, lengths_.size(kind), x, next);
  // From a state that violates the constraints Radau IIA may jump onto others of them than implicit Euler.
  const bool jumps_first = regular_step && j == 1 && problem_.jumps_at_start;
  if (regular_step && !jumps_first) return &main;
  MarchReport by_euler = report;
  by_euler.stopped = by_euler.infeasible = -1;
  by_euler.count.unsolved = 0;
  other_.resize(x.size());
  Stepper& one_stage = stepper(1, kind);
  if (!one_stage.advance(x, place, j, touching, other_, by_euler)) return fine ? &main : nullptr;
  if (jumps_first && end_alike(x, next, other_)) return &main;
  next.swap(other_);
  report = by_euler;
  ++report.jumps;
  return &one_stage;
}

std::size_t StageSteps::bytes() const {
  std::size_t sum = main_.bytes();
  for (const auto& of_stages : others_)
    for (const auto& [kind, stepper] : of_stages) sum += stepper->bytes();
  return sum;
}

}  // namespace bromwich::host
