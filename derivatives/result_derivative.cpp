#include "derivatives/result_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/solve/solve.hpp"

namespace bromwich {

namespace {

constexpr Index largest_located_states = 64, largest_located_constraints = 48;
constexpr double coarser_tolerance = 1e-9;  ///< of the integration, a hundred times that of SwitchedDerivative

constexpr auto tables_of_solution = {&SolutionChange::y, &SolutionChange::x, &SolutionChange::w,
                                     &SolutionChange::integral};
constexpr auto tables_of_data = {&DataChange::f, &DataChange::g};
constexpr auto matrices = {&DataChange::A, &DataChange::B,  &DataChange::N, &DataChange::M,
                           &DataChange::E, &DataChange::E0, &DataChange::ET};
constexpr auto vectors = {&DataChange::x0, &DataChange::b, &DataChange::restitution};

// From the rows to these and the middles between them, along lines.
RowMatrix with_middles(const RowMatrix& rows) {
  const Index J = rows.rows() - 1;
  RowMatrix all(2 * J + 1, rows.cols());
  for (Index j = 0; j <= J; ++j) all.row(2 * j) = rows.row(j);
  for (Index j = 0; j < J; ++j) all.row(2 * j + 1) = (rows.row(j) + rows.row(j + 1)) / 2;
  return all;
}

// The transpose.
RowMatrix without_middles(const RowMatrix& all) {
  const Index J = (all.rows() - 1) / 2;
  RowMatrix rows(J + 1, all.cols());
  for (Index j = 0; j <= J; ++j) {
    rows.row(j) = all.row(2 * j);
    if (j > 0) rows.row(j) += all.row(2 * j - 1) / 2;
    if (j < J) rows.row(j) += all.row(2 * j + 1) / 2;
  }
  return rows;
}

Result with_half_the_step(const Scene& scene, const Result& result, Backend& backend) {
  Options options;
  options.method = scene.boundary ? Method::galerkin : result.method;
  options.steps = 2 * result.steps;
  options.states = scene.states() <= ResultDerivative::largest_written_out ? StateSelection::all : StateSelection::none;
  Result finer = solve(scene, backend, options);
  if (finer.status != Status::solved || finer.t.size() != 2 * result.t.size() - 1)
    throw Error("derivative", text("the scene is not solved with half the step (%s)", to_string(finer.status)),
                "take more steps");
  return finer;
}

// Of two values of one derivative.
template <class Table>
void differ(Table& value, const Table& other, double factor) {
  if (value.size() == 0 || other.size() == 0)
    value.resize(0, value.cols());
  else
    value = factor * (value - other).cwiseAbs();
}
void differ(Vector& value, const Vector& other, double factor) {
  value = value.size() == other.size() ? Vector(factor * (value - other).cwiseAbs()) : Vector();
}

// The second where the first is refused; where both are, the refusal of the first.
template <class First, class Second>
void first_of(const First& first, const Second& second) {
  try {
    first();
  } catch (const Error& refusal) {
    if (refusal.argument() != "derivative") throw;
    try {
      second();
    } catch (const Error&) {
      throw refusal;
    }
  }
}

// Near x(0) of the solution that the result is of.
Vector start_of(const Scene& scene, const Result& r) {
  Vector start = r.start;
  if (scene.boundary && start.size() == 0 && r.x.cols() == scene.states() && r.x.rows() > 0) start = r.x.row(0);
  if (start.size() == 0 || scene.memories.empty()) return start;
  if (r.modes.rows() == 0) return {};
  Vector with_modes(start.size() + r.modes.cols());
  with_modes << start, r.modes.row(0).transpose();
  return with_modes;
}

// Of the grid of a result by shooting.
Result by_galerkin(const Scene& scene, Backend& backend, const Result& result) {
  Options options;
  options.method = Method::galerkin;
  options.steps = result.steps;
  return solve(scene, backend, options);
}

}  // namespace

bool ResultDerivative::may_be_located(const Scene& scene) {
  return scene.free_rows.empty() && scene.dynamics->small_state() && scene.states() <= largest_located_states &&
         scene.constraints() <= largest_located_constraints;
}

const char* to_string(DerivativeForm form) {
  switch (form) {
    case DerivativeForm::modes:
      return "modes";
    case DerivativeForm::all_times:
      return "over all time points";
    case DerivativeForm::boundary:
      return "boundary values";
    case DerivativeForm::located:
      return "located switches";
    case DerivativeForm::discrete:
      break;
  }
  return "discrete solution";
}

ResultDerivative::ResultDerivative(const Scene& scene, const Result& result, Backend& backend,
                                   const DerivativeChoice& choice)
    : scene_(scene), t_(result.t) {
  const bool solved = result.status == Status::solved, all_times = choice.all_times;
  const bool jumps = solved && (y_may_jump(result) || result.method == Method::events);
  const auto by_boundary_values = [&] {
    galerkin_.emplace(scene, result.method == Method::shooting ? by_galerkin(scene, backend, result) : result);
    form_ = DerivativeForm::boundary;
  };
  const auto locate = [&] {
    switched_.emplace(scene, choice.times.size() > 0 ? choice.times : result.t, true,
                      SwitchedDerivative::usual_tolerance, start_of(scene, result));
    form_ = DerivativeForm::located;
    t_ = switched_->times();
  };
  const auto continuous = [&] { make_continuous(result, backend, all_times); };
  const bool may_choose = solved && !choice.located && !all_times && may_be_located(scene);
  const bool values_at_both_ends = scene.boundary && !all_times;
  if (choice.located.value_or(jumps && !values_at_both_ends && !all_times)) {
    if (!solved) throw Error("derivative", "the result is not solved", "differentiate a result with status solved");
    if (all_times) throw Error("located", "is given together with all_times", "leave one of them out");
    locate();
  } else if (values_at_both_ends && may_choose && result.method == Method::shooting) {
    first_of(locate, by_boundary_values);
  } else if (values_at_both_ends) {
    may_choose ? first_of(by_boundary_values, locate) : by_boundary_values();
  } else {
    may_choose ? first_of(continuous, locate) : continuous();
  }
}

void ResultDerivative::make_continuous(const Result& result, Backend& backend, bool all_times) {
  const KroneckerDynamics* const modes = scene_.dynamics->modes();
  const bool one_face = modes && !modes->both_faces;  // as the derivative in modes needs it
  if (!all_times && scene_.states() <= largest_written_out) {
    discrete_.emplace(scene_, result);
  } else if (all_times || !one_face || space_time_pays(backend, scene_, result)) {
    space_time_ = std::make_unique<SpaceTimeDerivative>(scene_, result, backend);
    form_ = DerivativeForm::all_times;
  } else {
    modal_ = std::make_unique<ModalDerivative>(scene_, result);
    form_ = DerivativeForm::modes;
  }
  if (modes && !modal_) {
    result_ = result;
    result_->x.resize(0, 0);
  }
}

Index ResultDerivative::sources() const { return space_time_ || modal_ ? scene_.constraints() : scene_.states(); }

const DerivativeMargin& ResultDerivative::margin() const {
  if (space_time_) return space_time_->margin();
  if (galerkin_) return galerkin_->margin();
  return switched_ ? switched_->margin() : modal_ ? modal_->margin() : discrete_->margin();
}

SolutionChange ResultDerivative::jvp(const DataChange& c, bool states) const {
  if (space_time_) return space_time_->jvp(c, states);
  if (galerkin_) return galerkin_->jvp(c);
  return switched_ ? switched_->jvp(c) : modal_ ? modal_->jvp(c, states) : discrete_->jvp(c);
}

DataChange ResultDerivative::vjp(const SolutionChange& c, bool by_x0) const {
  if (space_time_) return space_time_->vjp(c, by_x0);
  if (galerkin_) return galerkin_->vjp(c);
  return switched_ ? switched_->vjp(c) : modal_ ? modal_->vjp(c) : discrete_->vjp(c);
}

const RowMatrix* ResultDerivative::states() const {
  if (galerkin_) return &galerkin_->states();
  return switched_ ? &switched_->values().x : discrete_ ? &discrete_->states() : nullptr;
}

QuantityChange ResultDerivative::quantity(const QuantityOfInterest& quantity) const {
  const RowMatrix* x = states();
  if (!x) throw Error("quantity", "states of large scenes are not kept", "weigh y, w or integral");
  return quantity_change(quantity, scene_, t_, *x);
}

const ModalDerivative& ResultDerivative::of_sum() const {
  if (modal_) return *modal_;
  if (!result_) throw Error("parameters", "are those of a Kronecker sum with a continuous y", "change A, B and N");
  const std::lock_guard lock(of_sum_->made);
  if (!of_sum_->derivative) of_sum_->derivative = std::make_unique<ModalDerivative>(scene_, *result_);
  return *of_sum_->derivative;
}

// ---- Errors.

DerivativeError::DerivativeError(const Scene& scene, const Result& result, Backend& backend,
                                 const ResultDerivative& derivative)
    : derivative_(derivative) {
  if (derivative.located())
    coarser_.emplace(scene, derivative.times(), true, coarser_tolerance, derivative.switched()->start());
  else
    finer_.emplace(scene, with_half_the_step(scene, result, backend), backend,
                   DerivativeChoice{.located = false, .all_times = derivative.form() == DerivativeForm::all_times});
}

SolutionChange DerivativeError::of_jvp(const DataChange& change, bool states) const {
  SolutionChange found = derivative_.jvp(change, states), other;
  if (coarser_) {
    other = coarser_->jvp(change);
  } else {
    DataChange finer = change;
    for (const auto table : tables_of_data)
      if ((change.*table).size() > 0) finer.*table = with_middles(change.*table);
    other = finer_->jvp(finer, states);
    for (const auto table : tables_of_solution)
      if ((other.*table).size() > 0)
        other.*table = RowMatrix((other.*table)(Eigen::seqN(0, (found.*table).rows(), 2), Eigen::all));
  }
  for (const auto table : tables_of_solution) differ(found.*table, other.*table, coarser_ ? 1 : 2);
  return found;
}

DataChange DerivativeError::of_vjp(const SolutionChange& function, bool by_x0) const {
  DataChange found = derivative_.vjp(function, by_x0), other;
  if (coarser_) {
    other = coarser_->vjp(function);
  } else {
    SolutionChange finer;
    for (const auto table : tables_of_solution) {
      const RowMatrix& weights = function.*table;
      if (weights.size() == 0) continue;
      finer.*table = RowMatrix::Zero(2 * weights.rows() - 1, weights.cols());
      (finer.*table)(Eigen::seqN(0, weights.rows(), 2), Eigen::all) = weights;
    }
    other = finer_->vjp(finer, by_x0);
    for (const auto table : tables_of_data)
      if ((other.*table).size() > 0) other.*table = without_middles(other.*table);
  }
  const double factor = coarser_ ? 1 : 2;
  for (const auto table : tables_of_data) differ(found.*table, other.*table, factor);
  for (const auto matrix : matrices) differ(found.*matrix, other.*matrix, factor);
  for (const auto vector : vectors) differ(found.*vector, other.*vector, factor);
  return found;
}

}  // namespace bromwich
