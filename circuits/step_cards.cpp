#include "circuits/step_cards.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich::circuits {

namespace {

constexpr double most_values = 1e6;
constexpr double rounding = 1e-9;  ///< of a step: the last value is there though it is missed by so much

[[noreturn]] void refuse(const Card& card, const std::string& found) {
  throw Error(to_string(card.place), ".step " + found,
              "write .step param NAME first last increment, or .step param NAME list 1 2 5");
}

/// Where the name stands among the words; 0: no parameter is stepped.
std::size_t place_of_name(const Card& card) {
  for (std::size_t i = 1; i + 1 < card.words.size() && i <= 2; ++i)
    if (card.words[i] == "param") return i + 1;
  return 0;
}

std::vector<double> range(const Card& card, const std::string& kind, const std::vector<double>& n) {
  if (n.size() != 3) refuse(card, fmt::format("has {} numbers", n.size()));
  const double first = n[0], last = n[1];
  const bool linear = kind == "lin";
  if (!linear && !(first > 0 && last > first && n[2] >= 1))
    refuse(card, fmt::format("{} from {} to {} with {} points", kind, first, last, n[2]));
  const double factor = kind == "dec" ? 10 : 2;
  const double intervals = linear ? (last - first) / n[2] : std::log(last / first) / std::log(factor) * n[2];
  if (!(intervals >= 0)) refuse(card, fmt::format("from {} to {} by {} leads nowhere", first, last, n[2]));
  if (!(intervals < most_values))
    refuse(card, fmt::format("has {:.3g} values, more than {:g}", intervals, most_values));
  std::vector<double> values;
  for (double k = 0; k <= intervals + rounding; ++k)
    values.push_back(linear ? first + k * n[2] : first * std::pow(factor, k / n[2]));
  return values;
}

}  // namespace

std::string stepped_parameter(const Card& card) {
  const std::size_t name = place_of_name(card);
  return name == 0 ? "" : card.words[name];
}

CircuitStep read_step(const Card& card, const Parameters& parameters) {
  const std::size_t name = place_of_name(card);
  CircuitStep step{card.words[name], {}};
  const std::string kind = name == 3 ? card.words[1] : "lin";
  if (kind != "lin" && kind != "dec" && kind != "oct") refuse(card, fmt::format("'{}' is unknown", kind));
  const bool list = name + 1 < card.words.size() && card.words[name + 1] == "list";
  std::vector<double> numbers;
  for (std::size_t i = name + (list ? 2 : 1); i < card.words.size(); ++i)
    numbers.push_back(parameters.value(card.words[i], card.place, ".step"));
  if (list && numbers.empty()) refuse(card, "has an empty list");
  step.values = list ? std::move(numbers) : range(card, kind, numbers);
  return step;
}

}  // namespace bromwich::circuits
