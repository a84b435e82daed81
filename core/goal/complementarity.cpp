#include "core/goal/complementarity.hpp"

#include "core/base/text.hpp"
#include "core/goal/indicators.hpp"
#include "core/seam/backend.hpp"

#include <algorithm>
#include <limits>

namespace bromwich {

ConstrainedGoal::ConstrainedGoal(const Scene& scene, Backend& backend, const GoalOptions& goal)
    : system_(scene),
      backend_(backend),
      goal_(goal),
      quantity_(goal.quantity ? goal.quantity : local_balance()),
      last_() {
  constraint_point(goal.scheme);  // throws if the scheme has none
}

GoalEvaluation ConstrainedGoal::evaluate(const Vector& t) {
  const StepScheme scheme = goal_.scheme;
  const Vector& x0 = system_.scene().x0;
  last_ = solve_constrained(system_, scheme, t, x0);
  GoalEvaluation e;
  e.x = last_.x;
  if (backend_.fused().step_chain) e.elsewhere = "steps with complementarity on the host";
  e.indicators = Vector::Zero(t.size() - 1);
  e.quantity = std::numeric_limits<double>::quiet_NaN();
  if (last_.unsolved >= 0) return e;
  solved_ += long(t.size()) - 1;

  Trajectory path{system_.port(), scheme, t, e.x};
  path_ = constraints_along(system_, backend_, path);
  path.constraints = &path_;
  path.threads = &backend_;
  const bool weighted_on_this = goal_.weights != CellWeights::global;
  QuantityEvaluation quantity = quantity_->evaluate(path, weighted_on_this);
  e.quantity = quantity.value;
  e.rounding = quantity.rounding;
  const ConstrainedChain coarse = constrained_chain(system_, scheme, t, x0, last_.steps);
  e.sizes = group_steps(t).sizes.size();
  RowMatrix l;
  if (weighted_on_this)
    l = backend_.step_chain(coarse.problem)->solve_transposed(std::move(quantity.gradient), goal_.adjoint);

  const Vector fine_t = halved(t);
  const RowMatrix fine_x = prolonged(path);
  Trajectory fine{system_.port(), scheme, fine_t, fine_x, 2};
  const ConstraintPath fine_path = constraints_along(system_, backend_, fine);
  fine.constraints = &fine_path;
  fine.threads = &backend_;
  const ConstraintValues steps = constraints_within(system_, backend_, fine, constraint_point(scheme));
  const ConstrainedChain chain = constrained_chain(system_, scheme, fine_t, x0, steps);
  e.indicators = indicator_scale(scheme, *quantity_) * weighted_residual(backend_, chain.problem, chain.d, fine_x,
                                                                         quantity_->gradient(fine), goal_.weights, l,
                                                                         goal_.adjoint);
  add_quadrature_errors(*quantity_, path, fine, e.indicators);
  return e;
}

EnergyBalance ConstrainedGoal::balance(const AdaptedGrid& grid) const {
  if (last_.unsolved >= 0) return {};
  return energy_balance({system_.port(), goal_.scheme, grid.t, grid.last.x, 1, &path_});
}

PowerBalance ConstrainedGoal::power(const AdaptedGrid& grid, const Result& result) const {
  if (last_.unsolved >= 0) return {};
  return power_balance({system_.port(), goal_.scheme, grid.t, grid.last.x}, result.y, system_.port_matrix());
}

void ConstrainedGoal::report(const AdaptedGrid& grid, Result& result) {
  const Index M = grid.t.size() - 1, n = system_.constraints();
  const Index good = last_.unsolved < 0 ? M + 1 : last_.unsolved;  // rows
  result.y = RowMatrix::Constant(M + 1, n, std::numeric_limits<double>::quiet_NaN());
  result.y.topRows(good) =
      constraints_at(system_, backend_, grid.t.head(good), grid.last.x.topRows(good)).y.array() + 0.;  // -0 + 0 = 0
  // Residual at the points of the steps where complementarity holds.
  const Trajectory path{system_.port(), goal_.scheme, grid.t, grid.last.x};
  const RowMatrix e = states_within(path, constraint_point(goal_.scheme));
  const double theta = constraint_point(goal_.scheme);
  result.residual = 0;
  for (Index i = 0; i + 1 < good; ++i) {
    const Vector q = system_.N() * e.row(i).transpose() + system_.g((1 - theta) * grid.t[i] + theta * grid.t[i + 1]);
    const Vector y = last_.steps.y.row(i).transpose(), w = system_.M() * y + q;
    result.residual =
        std::max(result.residual, y.cwiseMin(w).cwiseAbs().maxCoeff() / std::max(1., q.cwiseAbs().maxCoeff()));
  }
  result.lcp.solved = solved_;
  if (last_.unsolved < 0) return;
  result.status = last_.nonfinite    ? Status::nonfinite
                  : last_.infeasible ? Status::infeasible
                                     : Status::tolerance_not_met;
  result.reason = text("the problem of the step to t = %g %s on %td cells", grid.t[last_.unsolved],
                       last_.nonfinite    ? "is not finite"
                       : last_.infeasible ? "was proven to have no solution"
                                          : "was not solved",
                       M);
  if (last_.infeasible) result.infeasible_at = grid.t[last_.unsolved];
}

}  // namespace bromwich
