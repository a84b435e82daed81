#include "app/goal_arguments.hpp"

#include "app/text.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich::app {

namespace {

Error unknown_word(const char* argument, const std::string& word, const std::string& known,
                   const std::vector<std::string>& words) {
  return {argument, fmt::format("found '{}'", word) + suggestion(word, words), "use " + known};
}

CellWeights parse_weights(const std::string& word) {
  for (const CellWeights weights : {CellWeights::local, CellWeights::interpolated, CellWeights::global})
    if (word == to_string(weights)) return weights;
  throw unknown_word("--weights", word, "local, interpolated or global", {"local", "interpolated", "global"});
}

std::string given_argument(const GoalArguments& a) {
  for (const auto& [name, word] :
       {std::pair("--quantity", &a.quantity), std::pair("--scheme", &a.scheme), std::pair("--adjoint", &a.adjoint),
        std::pair("--weights", &a.weights), std::pair("--marking", &a.marking), std::pair("--cycles", &a.cycles),
        std::pair("--first-steps", &a.first_steps)})
    if (!word->empty()) return name;
  return "";
}

Index parse_count(const char* argument, const std::string& word, long long least, long long most) {
  const auto value = bromwich::parse_count(word);
  if (!value || *value < least || *value > most)
    throw Error(argument, fmt::format("found '{}'", word), fmt::format("give an integer from {} to {}", least, most));
  return Index(*value);
}

}  // namespace

std::shared_ptr<const QuantityOfInterest> parse_quantity(const std::string& word,
                                                         std::shared_ptr<const QuantityOfInterest> of_file) {
  if (word == "file") {
    if (of_file) return of_file;
    throw Error("--quantity", "found 'file' and the scene states no quantity", "add a section [quantity] to its file");
  }
  if (word == "loc") return local_balance();
  if (word == "glob") return global_balance();
  if (word.starts_with("loc+")) {
    const auto rho = parse_double(word.substr(4));
    if (rho && *rho >= 0 && std::isfinite(*rho)) return weighted_balance(*rho);
  }
  throw unknown_word("--quantity", word, "glob, loc, loc+RHO with a number RHO from 0 on, such as loc+10, or file",
                     {"loc", "glob", "file"});
}

AdjointChoice parse_adjoint(const std::string& word) {
  if (word == "exact") return {};
  if (word == "substitution") return {AdjointMethod::substitution, 1};
  if (word == "doubling") return {AdjointMethod::doubling, 1};
  if (word == "scan") return {AdjointMethod::scan, 1};
  if (word == "jacobi") return {AdjointMethod::jacobi, 1};
  if (word.starts_with("jacobi:"))
    if (const auto sweeps = parse_integer(word.substr(7)); sweeps && *sweeps >= 1 && *sweeps <= 1000000)
      return {AdjointMethod::jacobi, Index(*sweeps)};
  throw unknown_word("--adjoint", word, "exact, substitution, scan, doubling, or jacobi:K with K sweeps",
                     {"exact", "substitution", "scan", "doubling", "jacobi"});
}

StepScheme parse_scheme(const std::string& word) {
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint, StepScheme::exponential})
    if (word == to_string(scheme)) return scheme;
  throw unknown_word("--scheme", word, "euler, midpoint or exponential", {"euler", "midpoint", "exponential"});
}

std::shared_ptr<const GoalOptions> goal_options(const GoalArguments& a, Method method,
                                                std::shared_ptr<const QuantityOfInterest> of_file) {
  if (method != Method::goal) {
    if (const std::string name = given_argument(a); !name.empty())
      throw Error(name, fmt::format("is given with method {}", to_string(method)), "add --method goal");
    return nullptr;
  }
  auto goal = std::make_shared<GoalOptions>();
  goal->quantity = a.quantity.empty() ? of_file : parse_quantity(a.quantity, of_file);
  if (!a.scheme.empty()) goal->scheme = parse_scheme(a.scheme);
  if (!a.adjoint.empty()) goal->adjoint = parse_adjoint(a.adjoint);
  if (!a.weights.empty()) goal->weights = parse_weights(a.weights);
  if (a.marking == "divide") {
    goal->refinement = Refinement::division;
  } else if (!a.marking.empty() && a.marking != "auto") {
    const auto share = parse_double(a.marking);
    if (!share || !(*share > 0) || !(*share <= 1))
      throw Error("--marking", fmt::format("found '{}'", a.marking),
                  "give auto, divide, or a number above 0, at most 1, such as 0.5");
    goal->marking = *share;
  }
  if (!a.cycles.empty()) goal->cycles = parse_count("--cycles", a.cycles, 1, 1000);
  if (!a.first_steps.empty()) goal->first_cells = parse_count("--first-steps", a.first_steps, 1, 1 << 20);
  return goal;
}

Energies energies(const Scene& scene, const Result& result) {
  if (result.goal) return {result.goal->balance, result.goal->power};
  if (!scene.port) throw Error("--energies", "the scene is not port-Hamiltonian", "leave it out");
  if (scene.constraints() > 0)
    throw Error("--energies", "the scene has complementarity", "use --method goal, which counts its power");
  if (result.x.cols() != scene.states() || result.x.rows() != result.t.size())
    throw Error("--energies", "not all states are computed", "add --states all");
  const bool euler = by_euler(result);
  const PortSystem system(*scene.port, scene.T);
  const Trajectory path{system, euler ? StepScheme::euler : StepScheme::midpoint, result.t, result.x};
  return {energy_balance(path), power_balance(path)};
}

Json goal_to_json(const Result& result) {
  if (!result.goal) return nullptr;
  const GoalReport& goal = *result.goal;
  const auto nullable = [](const std::optional<double>& value) { return value ? Json(*value) : Json(nullptr); };
  Json json{{"quantity", goal.quantity}, {"scheme", goal.scheme},         {"adjoint", goal.adjoint},
            {"weights", goal.weights},   {"exact", nullable(goal.exact)}, {"history", Json::array()}};
  for (const GoalCycle& cycle : goal.history)
    json["history"].push_back({{"steps", cycle.cells},
                               {"step_sizes", cycle.sizes},
                               {"quantity", cycle.quantity},
                               {"estimate", cycle.estimate},
                               {"estimate_absolute", cycle.absolute},
                               {"effectivity", nullable(cycle.effectivity)},
                               {"seconds", cycle.seconds}});
  json["energy"] = energies_to_json(goal.balance);
  return json;
}

Json energies_to_json(const EnergyBalance& b) {
  if (b.energy.size() == 0) return nullptr;  // a step has no solution
  return {{"initial", b.energy[0]},
          {"final", b.energy[b.energy.size() - 1]},
          {"supplied", b.supplied.sum()},
          {"dissipated", b.dissipated.sum()},
          {"violation", b.violation.cwiseAbs().sum()}};
}

}  // namespace bromwich::app
