#include "derivatives/switched_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "core/shooting/located_shooting.hpp"
#include "core/solve/scaling.hpp"
#include "derivatives/check_table.hpp"
#include "derivatives/switched_tape.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

// E0 x(0) + ET x(T) = b, in natural units.
struct SwitchedDerivative::Ends {
  BoundaryCondition condition;
  Vector first, last;                ///< x(0) and x(T)
  Eigen::FullPivLU<Matrix> closing;  ///< of E0 + ET D
};

namespace {

[[noreturn]] void not_defined(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

// The scene with the rows of its memories, dense dynamics and E = I.
Scene written_for_events(const Scene& given, Matrix& inverse) {
  const Scene scene = written_out(given.memories.empty() ? given : with_memory_rows(given));
  const DenseDynamics& d = *scene.dynamics->small_state();
  if (d.E.size() == 0) return scene;
  const Eigen::FullPivLU<Matrix> lu(d.E);
  if (!lu.isInvertible()) not_defined("E is singular", "eliminate the algebraic states");
  inverse = lu.inverse();
  return *without_mass(scene);
}

// Tables of a scene in those of the scene with the rows of its memories, and back. Empty ones stay.
template <class Table>
void resize(Table& table, Index rows, Index columns) {
  if (table.size() == 0) return;
  Table other = Table::Zero(rows, columns);
  const Index r = std::min(rows, table.rows()), c = std::min(columns, table.cols());
  other.topLeftCorner(r, c) = table.topLeftCorner(r, c);
  table = std::move(other);
}
void resize(SolutionChange& s, Index m, Index n) {
  for (RowMatrix* table : {&s.y, &s.w, &s.integral}) resize(*table, table->rows(), n);
  resize(s.x, s.x.rows(), m);
}
void resize(DataChange& c, Index m, Index n) {
  resize(c.x0, m, 1), resize(c.b, m, 1), resize(c.restitution, n, 1);
  resize(c.f, c.f.rows(), m), resize(c.g, c.g.rows(), n);
  resize(c.B, m, n), resize(c.N, n, m), resize(c.M, n, n);
  for (Matrix* square : {&c.A, &c.E, &c.E0, &c.ET}) resize(*square, m, m);
}

EventSolution located(const Scene& scene, double tolerance) {
  EventOptions options;
  options.tolerance = tolerance;
  EventSolution s = integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), scene.breakpoints, options);
  if (!s.complete)
    not_defined("not differentiable here: " + s.reason, "differentiate a scene whose switches can be located");
  return s;
}

// Rows times 10^{rows[i]}, columns by 10^{-columns[k]}; `sign` = -1: the other way.
template <class Table>
void scale_by(Table& table, const std::vector<int>* rows, const std::vector<int>* columns, int sign) {
  for (Index i = 0; i < table.rows(); ++i)
    for (Index k = 0; k < table.cols(); ++k) {
      const int up = rows ? (*rows)[std::size_t(i)] : 0, down = columns ? (*columns)[std::size_t(k)] : 0;
      table(i, k) = times_ten_to(sign * (up - down), table(i, k));
    }
}

}  // namespace

SwitchedDerivative::~SwitchedDerivative() = default;
SwitchedDerivative::SwitchedDerivative(SwitchedDerivative&&) noexcept = default;

SwitchedDerivative::SwitchedDerivative(const Scene& given, const Vector& times, bool along_some, double tolerance,
                                       const Vector& start)
    : t_(times) {
  given.validate();
  if (const DenseDynamics* d = given.dynamics->small_state(); !d || !given.free_rows.empty())
    not_defined("the scene has no small dense form, or free rows", "differentiate a scene with dense matrices");
  const Index rows = t_.size();
  bool good = rows >= 2 && t_[0] == 0 && std::abs(t_[rows - 1] - given.T) <= 1e-12 * given.T;
  for (Index j = 1; j < rows; ++j) good = good && t_[j] > t_[j - 1];
  if (!good) throw Error("times", "are not increasing from 0 to T", "give times from 0 to T");
  Scene plain = written_for_events(given, inverse_E_);
  m_ = plain.states(), n_ = plain.constraints();
  Scene started = plain;
  started.boundary.reset();
  if (const std::string why = unsuited_to_events(started); !why.empty())
    not_defined("not differentiable here: " + why, "");
  if (!plain.breakpoints_are_all && (plain.f || plain.g)) plain.breakpoints = find_breakpoints(plain);
  plain.breakpoints_are_all = true;
  units_ = std::make_unique<const NaturalUnits>(natural_units(plain));
  Scene scene = in_natural_units(plain, *units_);
  if (scene.boundary) find_start(scene, tolerance, start);
  const EventSolution s = located(scene, tolerance);
  if (ends_) {
    ends_->last = s.x(scene.T, true);
    ends_->closing.compute(ends_->condition.E0 + ends_->condition.ET * FlowDerivative(scene).at_end(s));
    if (!ends_->closing.isInvertible())
      not_defined("not differentiable here: the boundary condition does not determine the change of x(0)",
                  "change the data slightly");
  }
  tape_ = std::make_unique<const SwitchedTape>(scene, s, t_, along_some);
  margin_ = tape_->margin();
  switch_times_ = tape_->switch_times();
  one_sided_ = tape_->one_sided();
  without_M_ = tape_->without_M();
  only_along_ = tape_->only_along();
  values_ = {RowMatrix(rows, n_), RowMatrix(rows, m_), RowMatrix(rows, n_), RowMatrix(rows, n_)};
  for (Index j = 0; j < rows; ++j) {
    const bool left = j == rows - 1;
    const Regime& regime = tape_->regimes().at(s.piece(t_[j], left).modes);
    values_.y.row(j) = s.y(t_[j], left).transpose();
    values_.x.row(j) = s.x(t_[j], left).transpose();
    values_.integral.row(j) = s.integral_of_y(t_[j], left).transpose();
    values_.w.row(j) = values_.x.row(j) * regime.system.N.transpose() + values_.y.row(j) * regime.system.M.transpose() +
                       regime.sources.g(t_[j]).transpose();
  }
  scale(values_);
  resize(values_, given.states(), given.constraints());
}

std::vector<std::vector<Index>> SwitchedDerivative::modes() const {
  std::vector<std::vector<Index>> all;
  for (const auto& [modes, regime] : tape_->regimes()) all.push_back(modes);
  return all;
}

// In place of the boundary condition: x(0).
void SwitchedDerivative::find_start(Scene& scene, double tolerance, const Vector& start) {
  ShootingOptions options;
  options.events.tolerance = tolerance;
  options.start = start;
  if (!units_->trivial()) scale_by(options.start, &units_->x, nullptr, -1);
  const ShootingSolution s =
      shoot_on_events(scene, selection_class(scene.M, scene.lcp_class), scene.breakpoints, options);
  if (!s.found)
    not_defined("not differentiable here: " + s.reason, "differentiate a scene that method shooting solves");
  ends_ = std::make_unique<Ends>(Ends{*scene.boundary, s.x0, {}, {}});
  scene.boundary.reset();
  scene.x0 = s.x0;
  start_ = s.x0;
  if (!units_->trivial()) scale_by(start_, &units_->x, nullptr, 1);
}

// Of a solution: from natural units to those of the scene. Of weights: the other way.
void SwitchedDerivative::scale(SolutionChange& s) const {
  if (units_->trivial()) return;
  scale_by(s.y, nullptr, &units_->y, -1);
  scale_by(s.integral, nullptr, &units_->y, -1);
  scale_by(s.x, nullptr, &units_->x, -1);
  scale_by(s.w, nullptr, &units_->w, -1);
}

// Of a change: to natural units. Of a gradient: from these.
void SwitchedDerivative::scale(DataChange& c) const {
  if (units_->trivial()) return;
  scale_by(c.x0, &units_->x, nullptr, -1);
  scale_by(c.f, nullptr, &units_->x, 1);
  scale_by(c.g, nullptr, &units_->w, 1);
  scale_by(c.A, &units_->x, &units_->x, -1);
  scale_by(c.E, &units_->x, &units_->x, -1);
  scale_by(c.B, &units_->x, &units_->y, -1);
  scale_by(c.N, &units_->w, &units_->x, -1);
  scale_by(c.M, &units_->w, &units_->y, -1);
  scale_by(c.b, &units_->boundary, nullptr, -1);
  scale_by(c.E0, &units_->boundary, &units_->x, -1);
  scale_by(c.ET, &units_->boundary, &units_->x, -1);
}

SolutionChange SwitchedDerivative::jvp(const DataChange& given) const { return jvp(given, {}); }

SolutionChange SwitchedDerivative::jvp(const DataChange& given, const std::vector<MovingJump>& jumps) const {
  const Index rows = t_.size(), m = values_.x.cols(), n = values_.y.cols();
  if (!ends_) check_no_b(given.b);
  if (ends_) check_no_x0(given.x0);
  check_data(given, rows, m, n);
  check_table("restitution", given.restitution, n, 1);
  check_table("b", given.b, m, 1), check_table("E0", given.E0, m, m), check_table("ET", given.ET, m, m);
  DataChange c = given;
  resize(c, m_, n_);
  prepare(c);
  return jvp([&c](const std::vector<Index>&) -> const DataChange& { return c; }, c, jumps);
}

SolutionChange SwitchedDerivative::jvp(const ChangesInModes& given, const std::vector<MovingJump>& jumps) const {
  ChangesInModes all = given;
  for (auto& [modes, change] : all) prepare(change);
  return jvp([&all](const std::vector<Index>& modes) -> const DataChange& { return all.at(modes); },
             all.begin()->second, jumps);
}

// To natural units and E = I.
void SwitchedDerivative::prepare(DataChange& c) const {
  if (c.E.size() > 0) c.E = -c.E;
  if (inverse_E_.size() > 0) {
    for (Matrix* change : {&c.A, &c.B, &c.E})
      if (change->size() > 0) *change = inverse_E_ * *change;
    if (c.f.size() > 0) c.f = c.f * inverse_E_.transpose();
  }
  scale(c);
}

// `any`: of some modes, for x0 or the boundary condition.
SolutionChange SwitchedDerivative::jvp(const ChangeInModes& in, const DataChange& any,
                                       const std::vector<MovingJump>& jumps) const {
  const Vector x0 = ends_ ? change_of_start(in, any, jumps) : any.x0;
  SolutionChange out = tape_->jvp(in, x0, jumps);
  scale(out);
  resize(out, values_.x.cols(), values_.y.cols());
  return out;
}

Vector SwitchedDerivative::change_of_start(const ChangeInModes& in, const DataChange& c,
                                           const std::vector<MovingJump>& jumps) const {
  // What has to stay zero does so with the change of x(0) alone.
  const RowMatrix held = tape_->jvp(in, {}, jumps, SwitchedTape::Zeros::may_move).x;
  Vector right = -ends_->condition.ET * held.bottomRows(1).transpose();
  if (c.b.size() > 0) right += c.b;
  if (c.E0.size() > 0) right -= c.E0 * ends_->first;
  if (c.ET.size() > 0) right -= c.ET * ends_->last;
  const Vector change = ends_->closing.solve(right);
  // What is left of larger changes within T is zero to the accuracy of the integration, as in SwitchedTape::terms_of.
  constexpr double left = 1e-10;
  const Vector within = held.cwiseAbs().colwise().maxCoeff().transpose();
  return (change.cwiseAbs().array() <= left * within.array()).select(0, change);
}

// Of weights, and of those that x(0) has with x(0) held.
DataChange SwitchedDerivative::with_ends(SolutionChange of, const Vector& of_start) const {
  const Vector multiplier = ends_->closing.transpose().solve(of_start);
  if (of.x.size() == 0) of.x = RowMatrix::Zero(t_.size(), m_);
  of.x.bottomRows(1) -= multiplier.transpose() * ends_->condition.ET;
  DataChange bar = tape_->vjp(of);
  bar.x0.resize(0);
  bar.b = multiplier;
  bar.E0 = -multiplier * ends_->first.transpose();
  bar.ET = -multiplier * ends_->last.transpose();
  return bar;
}

DataChange SwitchedDerivative::vjp(const SolutionChange& given) const {
  const Index rows = t_.size(), m = values_.x.cols(), n = values_.y.cols();
  check_table("y", given.y, rows, n);
  check_table("x", given.x, rows, m);
  check_table("w", given.w, rows, n);
  check_table("integral", given.integral, rows, n);
  if (tape_->conditioned().all() || (ends_ && !only_along_.empty()))
    not_defined("not differentiable here: " + only_along_, "ask for jvp along other changes");
  for (const Index j : one_sided_)
    for (const RowMatrix* table : {&given.y, &given.x, &given.w})
      if (table->size() > 0 && (table->row(j).array() != 0).any())
        not_defined(text("not differentiable here: t = %.6g is at a switch", t_[j]), "ask for other times");
  SolutionChange of = given;
  resize(of, m_, n_);
  scale(of);
  DataChange bar = tape_->vjp(of);
  if (ends_) bar = with_ends(of, bar.x0);
  scale(bar);
  if (inverse_E_.size() > 0) {
    const Matrix back = inverse_E_.transpose();
    for (Matrix* gradient : {&bar.A, &bar.B, &bar.E})
      if (gradient->size() > 0) *gradient = back * *gradient;
    if (bar.f.size() > 0) bar.f = bar.f * inverse_E_;
  }
  bar.E = -bar.E;
  resize(bar, m, n);
  return bar;
}

}  // namespace bromwich
