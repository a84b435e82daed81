#include "bench/studies/study.hpp"

#include "app/commands.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace bromwich::app {

namespace {
constexpr double nan = std::numeric_limits<double>::quiet_NaN();
}

void Samples::add(double total_seconds, double setup_seconds, double solve_seconds) {
  total.push_back(total_seconds);
  setup.push_back(setup_seconds);
  solve.push_back(solve_seconds);
}

double median(std::vector<double> values) {
  if (values.empty()) return nan;
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

double minimum(const std::vector<double>& values) {
  return values.empty() ? nan : *std::min_element(values.begin(), values.end());
}

double maximum(const std::vector<double>& values) {
  return values.empty() ? nan : *std::max_element(values.begin(), values.end());
}

Json spread(const std::vector<double>& values) {
  return {{"median", median(values)}, {"min", minimum(values)}, {"max", maximum(values)}};
}

Json to_json(const Samples& samples) {
  Json json = spread(samples.total);
  json["setup"] = median(samples.setup);
  json["solve"] = median(samples.solve);
  return json;
}

void refuse_scene(const BenchRequest& request) {
  if (request.scene || !request.settings.empty() || request.steps > 0)
    throw Error("SCENE", "is given", "leave it and its parameters out: this benchmark has its own");
}

Json to_json(const Errors& errors) {
  const auto json = [](const Deviation& d) { return Json{{"max", d.max}, {"rms", d.rms}}; };
  return {{"y", json(errors.y)}, {"trace", json(errors.trace)}};
}

std::string table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> widths;
  for (const auto& row : rows) {
    widths.resize(std::max(widths.size(), row.size()), 0);
    for (std::size_t c = 0; c < row.size(); ++c) widths[c] = std::max(widths[c], row[c].size());
  }
  std::string text;
  const auto out = std::back_inserter(text);
  for (const auto& row : rows) {
    for (std::size_t c = 0; c < row.size(); ++c)
      if (c == 0)
        fmt::format_to(out, "{:<{}}", row[c], widths[c]);
      else
        fmt::format_to(out, "  {:>{}}", row[c], widths[c]);
    text += '\n';
  }
  return text;
}

std::string on_each_backend(const BenchRequest& request, Backend& host, BenchReport& report,
                            const std::function<std::string(Backend&)>& study) {
  const bool device = !cuda_devices().empty();
  if (request.backend == "cuda" && !device)
    throw Error("--backend", "found 'cuda' but no CUDA device", "leave it out, or see what bromwich info says");
  std::string text = request.backend == "cuda" ? "" : study(host);
  if (!device || request.backend == "cpu") return text;
  const auto cuda = make_cuda_backend(make_cpu_backend(host.device().threads));
  report.parameters = {{"device", cuda->device().name}};
  return text + study(*cuda);
}

void print_with_notes(std::string text, const BenchReport& report) {
  for (const std::string& note : report.notes) text += note + "\n";
  print(text);
}

std::string scientific(double value) { return std::isnan(value) ? "-" : fmt::format("{:.2e}", value); }

}  // namespace bromwich::app
