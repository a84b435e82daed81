#pragma once
// What `bromwich solve --method goal` takes beside the other arguments, and what it adds to the output.

#include "app/commands.hpp"
#include "app/output_csv.hpp"
#include "app/output_json.hpp"
#include "core/goal/goal.hpp"

#include <memory>
#include <optional>

namespace bromwich::app {

/// Options of method goal from --quantity, --scheme, --adjoint, --weights, --marking and --cycles; null where the
/// method is another one. Throws Error for words that are none of those known, and for these arguments with another
/// method.
/// The quantity is that of the scene file, where it has one and --quantity is not given.
std::shared_ptr<const GoalOptions> goal_options(const GoalArguments&, Method,
                                                std::shared_ptr<const QuantityOfInterest> of_file = {});

/// "loc", "glob", "loc+RHO", "file"
std::shared_ptr<const QuantityOfInterest> parse_quantity(const std::string& word,
                                                         std::shared_ptr<const QuantityOfInterest> of_file = {});
/// "exact", "jacobi:K", "doubling", "scan"
AdjointChoice parse_adjoint(const std::string& word);
StepScheme parse_scheme(const std::string& word);

/// The energies of a result of a port-Hamiltonian scene: those of method goal, or of the states of another method, all
/// of which have to be there. Throws Error where there are none to be had.
Energies energies(const Scene&, const Result&);

/// {quantity, ..., history: [...]}; null for other methods.
Json goal_to_json(const Result&);
/// {initial, final, supplied, dissipated, violation: sum of the absolute values}
Json energies_to_json(const EnergyBalance&);

}  // namespace bromwich::app
