#pragma once
// The derivative that fits a result, of the five that there are (docs/derivatives.md): of the discrete solution, in
// modes, over all time points, of boundary values, or with located switches.

#include "../core/seam/backend.hpp"
#include "galerkin_derivative.hpp"
#include "modal_derivative.hpp"
#include "quantity_derivative.hpp"
#include "space_time_derivative.hpp"
#include "switched_derivative.hpp"

#include <memory>
#include <mutex>
#include <optional>

namespace bromwich {

enum class DerivativeForm : char { discrete, modes, all_times, boundary, located };
/// "discrete solution", "modes", "over all time points", "boundary values" or "located switches".
const char* to_string(DerivativeForm);

/// Which derivative to take, where several fit.
struct DerivativeChoice {
  /// With located switches, or without. Not given: where y may jump or method shooting has located them, and where the
  /// derivative of the discrete solution is refused and the scene is small enough.
  std::optional<bool> located = {};
  Vector times = {};       ///< of the rows where switches are located; empty: the time points of the result
  bool all_times = false;  ///< over all time points on the backend, for dense dynamics too
};

class ResultDerivative {
 public:
  static constexpr Index largest_written_out = 1000;  ///< states of scenes whose A, B, N and E are data
  /// Whether switches can be located: dense and small.
  static bool may_be_located(const Scene&);

  /// Throws Error as the derivatives do; where several were tried, that of the first. The backend has to outlive this
  /// object if `on_backend`.
  ResultDerivative(const Scene&, const Result&, Backend&, const DerivativeChoice& = {});

  DerivativeForm form() const { return form_; }
  bool located() const { return form_ == DerivativeForm::located; }
  /// Whether products use the backend.
  bool on_backend() const { return space_time_ != nullptr; }
  const Scene& scene() const { return scene_; }
  /// Of the rows of tables.
  const Vector& times() const { return t_; }
  /// Columns of f in changes and gradients: m, or n where f enters through B.
  Index sources() const;
  const DerivativeMargin& margin() const;

  /// As those of the derivative. `states`: x of scenes with many states, too.
  SolutionChange jvp(const DataChange&, bool states = false) const;
  /// Without `by_x0`: without x0 where that costs more than all others.
  DataChange vjp(const SolutionChange&, bool by_x0 = true) const;
  /// Throws Error for scenes with many states, which are not kept.
  QuantityChange quantity(const QuantityOfInterest&) const;

  /// Of the parameters of a Kronecker sum with a continuous y; throws Error for others. Made on the first call where
  /// another form has the rest.
  const ModalDerivative& of_sum() const;
  /// Null without boundary values.
  const GalerkinDerivative* of_boundary_values() const { return galerkin_ ? &*galerkin_ : nullptr; }
  /// Null without located switches.
  const SwitchedDerivative* switched() const { return switched_ ? &*switched_ : nullptr; }

 private:
  void make_continuous(const Result&, Backend&, bool all_times);
  const RowMatrix* states() const;

  Scene scene_;
  Vector t_;
  DerivativeForm form_ = DerivativeForm::discrete;
  std::optional<SolutionDerivative> discrete_;
  std::unique_ptr<SpaceTimeDerivative> space_time_;
  std::unique_ptr<ModalDerivative> modal_;
  std::optional<SwitchedDerivative> switched_;
  std::optional<GalerkinDerivative> galerkin_;
  struct OfSum {
    std::mutex made;
    std::unique_ptr<ModalDerivative> derivative;
  };
  std::optional<Result> result_;  ///< of a Kronecker sum, for of_sum_
  std::unique_ptr<OfSum> of_sum_ = std::make_unique<OfSum>();
};

/// How far a derivative is from that of the solution. Derivatives of a discrete solution are exact for its steps. Their
/// distance from those of the solution is no larger than twice what half the step changes, where it falls with the step
/// or faster: a switch between two time points moves derivatives by a share of the step, even where it moves the
/// solution by its square. Where switches are located, the integration with a hundred times its tolerance is compared.
class DerivativeError {
 public:
  /// Of `derivative`, which is one of this result and has to outlive this object. Solves the scene with half the step.
  /// Throws Error where this solution is not found, or has no derivative.
  DerivativeError(const Scene&, const Result&, Backend&, const ResultDerivative& derivative);

  /// The estimated error of each entry of derivative.jvp(change, states).
  SolutionChange of_jvp(const DataChange&, bool states = false) const;
  /// The estimated error of each entry of derivative.vjp(function, by_x0).
  DataChange of_vjp(const SolutionChange&, bool by_x0 = true) const;

 private:
  const ResultDerivative& derivative_;
  std::optional<ResultDerivative> finer_;
  std::optional<SwitchedDerivative> coarser_;
};

}  // namespace bromwich
