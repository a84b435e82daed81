#include "core/derivatives/result_derivative.hpp"

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"

namespace bromwich {

namespace {

constexpr Index largest_located_states = 64, largest_located_constraints = 48;

// Of the grid of a result by shooting.
Result by_galerkin(const Scene& scene, Backend& backend, const Result& result) {
  Options options;
  options.method = Method::galerkin;
  options.steps = result.steps;
  return solve(scene, backend, options);
}

}  // namespace

bool ResultDerivative::may_be_located(const Scene& scene) {
  return !scene.boundary && scene.free_rows.empty() && scene.dynamics->small_state() &&
         scene.states() <= largest_located_states && scene.constraints() <= largest_located_constraints;
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
  if (scene.boundary && !all_times && !choice.located.value_or(false)) {
    galerkin_.emplace(scene, result.method == Method::shooting ? by_galerkin(scene, backend, result) : result);
    form_ = DerivativeForm::boundary;
    return;
  }
  const auto locate = [&] {
    switched_.emplace(scene, choice.times.size() > 0 ? choice.times : result.t, true);
    form_ = DerivativeForm::located;
    t_ = switched_->times();
  };
  if (choice.located.value_or(jumps && !all_times)) {
    if (!solved) throw Error("derivative", "the result is not solved", "differentiate a result with status solved");
    if (all_times) throw Error("located", "is given together with all_times", "leave one of them out");
    locate();
    return;
  }
  if (all_times) {
    make_continuous(result, backend, true);
    return;
  }
  try {
    make_continuous(result, backend, false);
  } catch (const Error& refusal) {
    if (!solved || choice.located || refusal.argument() != "derivative" || !may_be_located(scene)) throw;
    try {
      locate();
    } catch (const Error&) {
      throw refusal;
    }
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

}  // namespace bromwich
