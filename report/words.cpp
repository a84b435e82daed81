#include "report/words.hpp"

#include "report/scale.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace bromwich::report {

namespace {

/// Null if missing.
const Json* at(const Json& summary, const std::string& path) {
  const Json* place = &summary;
  for (std::size_t begin = 0; begin <= path.size();) {
    const std::size_t end = std::min(path.find('/', begin), path.size());
    if (!place->is_object()) return nullptr;
    const auto found = place->find(path.substr(begin, end - begin));
    if (found == place->end()) return nullptr;
    place = &*found;
    begin = end + 1;
  }
  return place;
}

bool is_true(const Json& summary, const std::string& path) {
  const Json* value = at(summary, path);
  return value && value->is_boolean() && value->get<bool>();
}

std::string sentence(const std::string& text) { return text.empty() || text.back() == '.' ? text : text + "."; }

std::string rounded(double value) { return short_number(value, 3); }

void add_goal(const Json& summary, std::vector<Certificate>& list) {
  const Json* history = at(summary, "goal/history");
  if (!history || !history->is_array() || history->empty()) return;
  const auto quantity = number_at(history->back(), "quantity"), estimate = number_at(history->back(), "estimate");
  if (quantity) list.push_back({"quantity of interest", rounded(*quantity), text_at(summary, "goal/quantity")});
  if (estimate) list.push_back({"estimated error of it", rounded(*estimate), "absolute, with its sign; not a bound"});
}

}  // namespace

std::optional<double> number_at(const Json& summary, const std::string& path) {
  const Json* value = at(summary, path);
  if (!value || !value->is_number()) return std::nullopt;
  return value->get<double>();
}

std::string text_at(const Json& summary, const std::string& path) {
  const Json* value = at(summary, path);
  return value && value->is_string() ? value->get<std::string>() : "";
}

std::vector<double> numbers_at(const Json& summary, const std::string& path) {
  const Json* list = at(summary, path);
  std::vector<double> numbers;
  if (list && list->is_array())
    for (const Json& value : *list)
      numbers.push_back(value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN());
  return numbers;
}

std::string status_sentence(const Json& summary) {
  const std::string status = text_at(summary, "status"), reason = sentence(text_at(summary, "reason"));
  const auto because = [&](const std::string& words) { return reason.empty() ? words : words + " Reason: " + reason; };
  if (status == "solved") return "The result passed all checks that were made on it.";
  if (status == "tolerance_not_met")
    return because("A check failed or a tolerance was not reached. Use the curves with care.");
  if (status == "infeasible") {
    const auto from = number_at(summary, "infeasible_at");
    if (!from) return because("The scene has no solution.");
    const std::string words =
        fmt::format("The scene has no solution from t = {} on; the curves end there.", short_number(*from));
    return reason.starts_with("no solution from") ? words : because(words);
  }
  if (status == "unsupported") return because("The method does not take this scene.");
  if (status == "nonfinite") return because("Values that are not finite came up.");
  if (status == "running")
    return "The file is of a run that goes on, or that was killed. The curves show what it has written until now.";
  if (status == "failed") return because("The run ended with an error. The curves show what was computed until then.");
  if (status == "interrupted") return because("The curves show what was computed until then.");
  return status.empty() ? "The status is not known: the file has no summary." : because("Status: " + status + ".");
}

std::vector<Certificate> certificates(const Json& summary) {
  std::vector<Certificate> list;
  const auto add = [&](const char* path, const char* name, const std::string& meaning) {
    if (const auto value = number_at(summary, path); value && std::isfinite(*value))
      list.push_back({name, rounded(*value), meaning});
  };
  if (number_at(summary, "sizes/constraints") != 0.0)
    add("residual", "complementarity residual",
        "largest |min(y, w)| of all time points, relative to max(1, |N x + g|): 0 if y ≥ 0, w ≥ 0 and one of the two "
        "is "
        "0");
  add("boundary_residual", "boundary residual", "how far E0 x(0) + ET x(T) is from b, relative to max(1, |b|)");
  add("kernel_error", "kernel error",
      "difference of the weights of the kernel from independently computed ones, relative to the largest");
  const auto tolerance = number_at(summary, "errors/tolerance");
  const std::string of = text_at(summary, "error_estimate_of");
  add("error_estimate", "estimated error",
      fmt::format("of {}, relative{}. An estimate, not a bound", of.empty() ? "y" : of,
                  tolerance ? "; the tolerance is " + rounded(*tolerance) : ""));
  add_goal(summary, list);
  const bool of_goal = !text_at(summary, "goal/quantity").empty();
  const std::string status = text_at(summary, "status");
  const bool ended = !status.empty() && status != "running" && status != "failed";
  if (!of_goal && !number_at(summary, "error_estimate") && ended)
    list.push_back(
        {"estimated error", "not estimated", "one grid does not show the error of its steps; --tol EPS estimates it"});
  add("energy/error", "balance of energy",
      fmt::format(
          "of a structure: energy at 0 and supplied less that at T and lost, relative to the largest of these{}",
          is_true(summary, "energy/located") ? "" : "; from the rows, with the order of the steps"));
  add("algebraic_error", "iteration error", "what further sweeps or cycles would still change, estimated");
  add("magnification", "growth of perturbations",
      "a perturbation grows at most by this factor along the solution, also one by rounding");
  add("reference_error/x", "difference from the reference, x", "largest absolute difference from the known states");
  add("reference_error/y", "difference from the reference, y", "largest absolute difference from the known y");
  const auto solved = number_at(summary, "lcp/solved"), fallbacks = number_at(summary, "lcp/fallbacks");
  if (solved && fallbacks && *solved > 0)
    list.push_back({"complementarity problems", fmt::format("{:.0f}", *solved),
                    fmt::format("solved; {:.0f} needed a fallback after Newton's method", *fallbacks)});
  return list;
}

}  // namespace bromwich::report
