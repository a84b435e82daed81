#pragma once
// Arguments and output of `bromwich solve --method goal`, in addition to the common ones.

#include "app/commands.hpp"
#include "app/output_csv.hpp"
#include "app/output_json.hpp"
#include "core/goal/goal.hpp"

#include <memory>
#include <optional>

namespace bromwich::app {

/// Options of method goal from --quantity, --scheme, --adjoint, --weights, --marking and --cycles; null for other
/// methods. Throws Error for unknown words, and for these arguments with another method.
/// Without --quantity, the quantity is that of the scene file, if it has one.
std::shared_ptr<const GoalOptions> goal_options(const GoalArguments&, Method,
                                                std::shared_ptr<const QuantityOfInterest> of_file = {});

/// "loc", "glob", "loc+RHO", "file"
std::shared_ptr<const QuantityOfInterest> parse_quantity(const std::string& word,
                                                         std::shared_ptr<const QuantityOfInterest> of_file = {});
/// "exact", "jacobi:K", "doubling", "scan"
AdjointChoice parse_adjoint(const std::string& word);
StepScheme parse_scheme(const std::string& word);

/// The energies of a result of a port-Hamiltonian scene: those of method goal, or computed from the states of another
/// method. Throws Error if a state is missing or the scene has no energy.
Energies energies(const Scene&, const Result&);

/// {quantity, ..., history: [...]}; null for other methods.
Json goal_to_json(const Result&);
/// {initial, final, supplied, dissipated, violation: sum of the absolute values}
Json energies_to_json(const EnergyBalance&);

}  // namespace bromwich::app
