#include "bench/trust_summary.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace bromwich::trust {

using nlohmann::ordered_json;

namespace {

/// Replaces digits by one '#', to group reasons of one kind.
std::string kind_of(const std::string& reason) {
  std::string kind;
  for (const char c : reason) {
    const bool digit = (c >= '0' && c <= '9') || ((c == '.' || c == '-' || c == '+') && kind.ends_with('#'));
    if (!digit)
      kind += c;
    else if (!kind.ends_with('#'))
      kind += '#';
  }
  return kind.substr(0, 150);
}
double quantile(const std::vector<double>& sorted, double q) {
  return sorted.empty() ? NAN : sorted[std::size_t(q * double(sorted.size() - 1))];
}

double within(const std::vector<double>& v) {
  const auto good = std::count_if(v.begin(), v.end(), [](double e) { return e >= 0.3 && e <= 3; });
  return v.empty() ? NAN : double(good) / double(v.size());
}
ordered_json as_json(const OfCertificates& c) {
  return {{"off", c.off},
          {"above", c.above},
          {"above_unseen", c.above_unseen},
          {"right", c.right},
          {"below", c.below},
          {"below_doubted", c.below_doubted},
          {"x_compared", c.ratios_x.size()},
          {"x_in_0.3_to_3", within(c.ratios_x)},
          {"x_median", quantile(c.ratios_x, 0.5)},
          {"y_compared", c.ratios_y.size()},
          {"y_in_0.3_to_3", within(c.ratios_y)},
          {"y_median", quantile(c.ratios_y, 0.5)}};
}
}  // namespace

void print(const Outcome& o) {
  std::printf("%-15s seed %u  %s by %s, %ld steps, %s, %s%s [%s]%s\n", o.verdict.c_str(), o.seed, o.status.c_str(),
              o.method.c_str(), long(o.steps), o.family.c_str(), o.told ? "told" : "not told", o.units ? ", units" : "",
              o.sources.c_str(), o.jumps > 0 ? ", state jumps" : "");
  if (o.status == "solved")
    std::printf("    x %.2e at %g, %s %.2e at %g, estimate %.2e\n", o.error.x, o.error.x_at,
                o.error.of_mean ? "mean of y" : "y", o.error.y, o.error.y_at, o.estimate);
  if (!std::isnan(o.moved.x))
    std::printf("    1e-10 in the data moves x by %.1e, y by %.1e, its mean by %.1e\n", o.moved.x, o.moved.y,
                o.moved.mean);
  if (!o.reason.empty()) std::printf("    reason: %s\n", o.reason.c_str());
  if (!o.warning.empty()) std::printf("    warning: %s\n", o.warning.c_str());
  if (!o.why_undecided.empty()) std::printf("    oracle: %s\n", o.why_undecided.c_str());
}
ordered_json as_json(const Outcome& o) {
  const ErrorEstimate e = o.errors.value_or(ErrorEstimate());
  return {{"seed", o.seed},
          {"verdict", o.verdict},
          {"status", o.status},
          {"reason", o.reason},
          {"warning", o.warning},
          {"method", o.method},
          {"family", o.family},
          {"sources", o.sources},
          {"told", o.told},
          {"units", o.units},
          {"error_x", o.error.x},
          {"error_y", o.error.y},
          {"of_mean", o.error.of_mean},
          {"estimate", o.estimate},
          {"estimate_y", e.discretisation},
          {"estimate_x", e.states},
          {"rounding", e.rounding},
          {"order", e.order},
          {"estimates", e.estimates},
          {"steps", o.steps},
          {"moved_x", o.moved.x},
          {"moved_mean", o.moved.mean},
          {"seconds", o.seconds},
          {"oracle", o.why_undecided},
          {"events", o.events},
          {"jumps", o.jumps}};
}
Summary summarise(const std::vector<Outcome>& all, double tolerance) {
  Summary s;
  for (const Outcome& o : all) {
    ++s.verdicts[o.verdict];
    s.right_with_warning += o.verdict == "right" && !o.warning.empty();
    ++(o.told ? s.told : s.not_told)[o.verdict];
    if (o.verdict == "refused") ++s.reasons[o.status + ": " + kind_of(o.reason)];
    if (o.verdict == "undecided") ++s.undecided[o.why_undecided.substr(0, o.why_undecided.find(" at t"))];
    // Smaller errors are dominated by rounding and the comparison itself.
    if (o.status == "solved" && o.verdict != "undecided" && !std::isnan(o.estimate) &&
        o.error.largest() > 1e-6 * tolerance)
      s.effectivity.push_back(o.estimate / o.error.largest());
    if (!std::isnan(o.estimate_x)) s.certificates.add(o);
    s.seconds += o.seconds, s.oracle_seconds += o.oracle_seconds;
  }
  for (std::vector<double>* ratios : {&s.effectivity, &s.certificates.ratios_x, &s.certificates.ratios_y})
    std::sort(ratios->begin(), ratios->end());
  return s;
}
void print(const Summary& s, std::size_t count) {
  std::printf("\n%zu scenes; solves %.1f s, oracle %.1f s\n", count, s.seconds, s.oracle_seconds);
  std::printf("%-17s %7s %7s %9s\n", "", "all", "told", "not told");
  for (const auto& [verdict, all] : s.verdicts)
    std::printf("%-17s %7ld %7ld %9ld\n", verdict.c_str(), all, s.told.contains(verdict) ? s.told.at(verdict) : 0,
                s.not_told.contains(verdict) ? s.not_told.at(verdict) : 0);
  std::printf(
      "right: error <= tol; missed: <= 3 tol; wrong: above; refused: data changed by 1e-10 move it by < tol / 10\n");
  const auto& e = s.effectivity;
  std::printf(
      "effectivity (estimate / error): 2.5 %% %.2g, 25 %% %.2g, median %.2g, 75 %% %.2g, 97.5 %% %.2g; in [0.3, 3]: "
      "%.0f %%\n",
      quantile(e, 0.025), quantile(e, 0.25), quantile(e, 0.5), quantile(e, 0.75), quantile(e, 0.975), 100 * within(e));
  const auto histogram = [](const char* title, const std::map<std::string, long>& counts) {
    std::vector<std::pair<long, std::string>> rows;
    for (const auto& [name, n] : counts) rows.emplace_back(n, name);
    std::sort(rows.rbegin(), rows.rend());
    std::printf("%s\n", title);
    for (const auto& [n, name] : rows) std::printf("%6ld  %s\n", n, name.c_str());
  };
  histogram("refused though well-conditioned:", s.reasons);
  histogram("undecided by the oracle:", s.undecided);
}
ordered_json as_json(const Summary& s) {
  ordered_json quantiles;
  for (const auto& [name, q] :
       {std::pair{"2.5 %", 0.025}, {"25 %", .25}, {"50 %", .5}, {"75 %", .75}, {"97.5 %", 0.975}})
    quantiles[name] = quantile(s.effectivity, q);
  return {{"right_with_warning", s.right_with_warning},
          {"verdicts", s.verdicts},
          {"told", s.told},
          {"not_told", s.not_told},
          {"refused", s.reasons},
          {"undecided", s.undecided},
          {"effectivity", quantiles},
          {"effectivity_in_0.3_to_3", within(s.effectivity)},
          {"certificates", as_json(s.certificates)}};
}

}  // namespace bromwich::trust
