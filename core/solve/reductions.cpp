#include "core/solve/reductions.hpp"

#include "core/base/timer.hpp"
#include "core/result/located_solution.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/scaling.hpp"
#include "core/solve/symmetric_form.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

// Below this size dense matrices are faster in everything, and e^{hA} needs no contour.
constexpr Index smallest_sparse = 512;

// With breakpoints a march has steps in parts, and every length of a part needs an exponential of a dense matrix, or a
// factorization of a sparse one. (Whether a sparse march divides its steps is a question for Methods::march.)
constexpr Index smallest_sparse_with_parts = 128;
constexpr double most_filled = 1.0 / 16;  ///< of a matrix that is factorized in much less time

// Conditions on x(0) alone are an initial value.
std::optional<Reduction> initial_value(const Scene& scene, const InnerOptions& options) {
  if (!scene.boundary || !scene.boundary->ET.isZero(0)) return std::nullopt;
  const BoundaryCondition c = *scene.boundary;
  const Vector sizes = c.E0.rowwise().lpNorm<1>().cwiseMax(std::numeric_limits<double>::min());
  const Eigen::FullPivLU<Matrix> E0(sizes.cwiseInverse().asDiagonal() * c.E0);
  if (!E0.isInvertible()) return std::nullopt;
  Reduction made{scene, options};
  made.scene.boundary.reset();
  made.scene.x0 = E0.solve(c.b.cwiseQuotient(sizes));
  made.finish = [residual =
                     (c.E0 * made.scene.x0 - c.b).cwiseAbs().maxCoeff() / std::max(1.0, c.b.cwiseAbs().maxCoeff()),
                 x0 = made.scene.x0](Result& r) {
    r.boundary_residual = residual;
    r.start = x0;
  };
  return made;
}

// Memories become states, and rows that watch. Nothing of that is of use to another solve.
std::optional<Reduction> memory_rows(const Scene& scene, const InnerOptions& options) {
  if (scene.memories.empty()) return std::nullopt;
  Reduction made{with_memory_rows(scene), options};
  made.options.prepared = {};
  const Index m = scene.states(), n = scene.constraints();
  made.there = [rows = made.scene.constraints()](Result& r) {
    for (RowMatrix* table : {&r.y, &r.y_left, &r.y_integral, &r.trace}) {
      if (table->size() == 0) continue;
      const Index before = table->cols();
      table->conservativeResize(Eigen::NoChange, rows);
      table->rightCols(rows - before).setZero();
    }
  };
  made.back = [m, n](Result& r) {
    for (RowMatrix* table : {&r.y, &r.y_left, &r.y_integral, &r.trace})
      if (table->cols() > n) table->conservativeResize(Eigen::NoChange, n);
    Index own = 0;
    while (own < Index(r.x_components.size()) && r.x_components[std::size_t(own)] < m) ++own;
    if (r.x.cols() > own) r.x.conservativeResize(Eigen::NoChange, own);
    r.x_components.resize(std::size_t(own));
    if (r.start.size() > m) r.start.conservativeResize(m);
    // The modes at T do not depend on a change of x(0): their multipliers are 0, the last ones.
    if (Index(r.multipliers.size()) > m) r.multipliers.resize(std::size_t(m));
  };
  made.back_located = [m, n](LocatedSolution& s) {
    const auto behind = [n](Index i) { return i >= n; };
    for (EventPiece& p : s.pieces) {
      std::erase_if(p.active, behind);
      for (EventImpulse& impulse : p.impulses) std::erase_if(impulse.active, behind);
      std::erase_if(p.set, [m](Index i) { return i >= m; });
      if (p.event >= n) p.event = -1;
    }
    std::erase_if(s.switches, [&](const Switch& one) { return behind(one.component); });
  };
  return made;
}

// f given per state as a few shapes times functions of time: the shapes are columns F, which take the place of one
// column for each state in the shifted solves of large dynamics.
std::optional<Reduction> columns_of_f(const Scene& scene, const InnerOptions& options) {
  const SeparableSource* f = scene.f.separable();
  if (!f || scene.f_entry != SourceEntry::state || scene.port) return std::nullopt;
  if (scene.dynamics->small_state() || scene.dynamics->modes()) return std::nullopt;
  Reduction made{scene, options};
  made.scene.F = f->shapes.sparseView(0, 0);
  made.scene.f = f->time;
  made.scene.f_entry = SourceEntry::through_F;
  return made;
}

// A regular E, where that keeps A sparse. Method galerkin works with dense matrices.
std::optional<Reduction> mass_matrix(const Scene& scene, const InnerOptions& options) {
  if (!scene.dynamics->has_mass()) return std::nullopt;
  auto reduced = without_mass(scene);
  if (!reduced && scene.dynamics->has_matrices() && needs_galerkin(scene, options))
    reduced = without_mass(written_out(scene));
  if (!reduced) return std::nullopt;
  if (options.prepared)
    reduced->dynamics = options.prepared->reduced(ReducedDynamics::mass, scene.dynamics, reduced->dynamics);
  note(options.log, LogLevel::debug, "the mass matrix E is eliminated");
  return Reduction{std::move(*reduced), options};
}

// n = 0: a constraint that is never active is added.
std::optional<Reduction> no_constraints(const Scene& scene, const InnerOptions& options) {
  if (scene.constraints() > 0 || options.method == Method::goal) return std::nullopt;
  Reduction made{with_idle_constraint(scene), options};
  made.there = [](Result& result) { result = with_idle_constraint(std::move(result)); };
  made.back = [](Result& result) {
    result.y.resize(result.y.rows(), 0);
    result.y_integral.resize(0, 0);
    result.trace.resize(result.trace.rows(), 0);
  };
  return made;
}

std::optional<Reduction> dense_matrices(const Scene& scene, const InnerOptions& options) {
  if (options.method == Method::goal || !becomes_dense(scene, options)) return std::nullopt;
  note(options.log, LogLevel::debug, "sparse dynamics with %ld states are written out as dense ones",
       long(scene.states()));
  Reduction made{written_out(scene), options};
  if (options.prepared)
    made.scene.dynamics = options.prepared->reduced(ReducedDynamics::written_out, scene.dynamics, made.scene.dynamics);
  return made;
}

std::optional<Reduction> free_rows(const Scene& scene, const InnerOptions& options) {
  if (scene.free_rows.empty() || options.method == Method::galerkin) return std::nullopt;
  note(options.log, LogLevel::debug, "%zu free rows are eliminated", scene.free_rows.size());
  if (!options.prepared)
    return without_free_rows(scene, std::make_shared<EliminatedScene>(*eliminate_free(scene)), options);
  const std::shared_ptr<Prepared> kept = options.prepared;  // it owns them
  return without_free_rows(scene, {kept, kept->without_free_rows(scene)}, options);
}

// Coefficients of polynomials change as rows do: all of a solution are written as rows, and read back from them.
class CoefficientRows {
 public:
  explicit CoefficientRows(LocatedSolution& s) : s_(s) {
    Index rows = 0;
    for (const EventPiece& p : s.pieces) rows += p.x.rows() + 1 + Index(p.impulses.size());
    rows_.x = RowMatrix::Zero(rows, s.pieces.front().x.cols());
    rows_.y = RowMatrix::Zero(rows, s.pieces.front().y.cols());
    rows_.x_components.resize(std::size_t(rows_.x.cols()));
    std::iota(rows_.x_components.begin(), rows_.x_components.end(), Index(0));
    Index next = 0;
    for (const EventPiece& p : s.pieces) {
      rows_.x.middleRows(next, p.x.rows()) = p.x;
      rows_.y.middleRows(next, p.y.rows()) = p.y;
      next += p.x.rows();
      rows_.y.row(next++) = p.integral.transpose();
      for (const EventImpulse& impulse : p.impulses) rows_.y.row(next++) = impulse.p.transpose();
    }
  }

  Result& rows() { return rows_; }

  void read_back() {
    Index next = 0;
    for (EventPiece& p : s_.pieces) {
      const Index degrees = p.x.rows();
      p.x = rows_.x.middleRows(next, degrees);
      p.y = rows_.y.middleRows(next, degrees);
      next += degrees;
      p.integral = rows_.y.row(next++).transpose();
      for (EventImpulse& impulse : p.impulses) impulse.p = rows_.y.row(next++).transpose();
    }
  }

 private:
  LocatedSolution& s_;
  Result rows_;
};

}  // namespace

bool needs_galerkin(const Scene& scene, const InnerOptions& options) {
  if (options.method != Method::automatic) return options.method == Method::galerkin;
  return scene.boundary || (!scene.free_rows.empty() && !can_eliminate_free(scene));
}

bool becomes_dense(const Scene& scene, const InnerOptions& options) {
  const double m = double(scene.states());
  if (!scene.dynamics->matrices() || m > double(smallest_sparse)) return false;
  const bool marches = options.method == Method::march || options.method == Method::automatic;
  if (scene.breakpoints.empty() || !marches || needs_galerkin(scene, options)) return true;
  return m <= double(smallest_sparse_with_parts) ||
         double(scene.dynamics->matrices()->A.nonZeros()) > most_filled * m * m;
}

const std::vector<Reduce>& reductions_of_scene() {
  // E of small sparse dynamics can be eliminated once they are dense.
  static const std::vector<Reduce> list{initial_value,    memory_rows,    columns_of_f,   mass_matrix, symmetric_form,
                                        natural_units_of, no_constraints, dense_matrices, mass_matrix};
  return list;
}

const std::vector<Reduce>& reductions_of_grid() {
  static const std::vector<Reduce> list{symmetric_form, free_rows};
  return list;
}

Reductions::Reductions(const Scene& scene, const InnerOptions& options, const std::vector<Reduce>& list)
    : scene_(scene), options_(options) {
  Timer timer;
  for (const Reduce reduce : list)
    if (auto made = reduce(this->scene(), this->options())) made_.push_back(std::move(*made));
  spent_ = timer.lap();
}

void Reductions::there(Result& result) const {
  for (const Reduction& r : made_)
    if (r.there) r.there(result);
}

void Reductions::back(Result& result) const {
  for (auto r = made_.rbegin(); r != made_.rend(); ++r)
    if (r->back) r->back(result);
}

Result Reductions::of_solve(Result result) const {
  Timer timer;
  const bool changes = std::any_of(made_.begin(), made_.end(), [](const Reduction& r) { return bool(r.back); });
  if (changes && result.located && !result.located->pieces.empty()) {
    auto located = std::make_shared<LocatedSolution>(*result.located);
    CoefficientRows coefficients(*located);
    back(coefficients.rows());
    coefficients.read_back();
    for (auto r = made_.rbegin(); r != made_.rend(); ++r)
      if (r->back_located) r->back_located(*located);
    result.located = std::move(located);
  }
  for (auto r = made_.rbegin(); r != made_.rend(); ++r) {
    if (r->back) r->back(result);
    if (r->finish) r->finish(result);
  }
  result.seconds.add_around(spent_, timer.lap());
  return result;
}

}  // namespace bromwich
