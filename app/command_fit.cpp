// `bromwich fit`: parameters of a scene from measured values.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/fit.hpp"
#include "app/interaction.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "circuits/cards.hpp"
#include "core/base/error.hpp"
#include "core/solve/dense_output.hpp"
#include "report/charts.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

namespace bromwich::app {

namespace {

/// Of the states: y of ideal switches need not be unique.
constexpr double tolerance_of_circuits = 1e-6;

double bound(const std::string& word, const std::string& scene, const std::string& name, double absent) {
  if (word.empty()) return absent;
  return parse_settings({name + "=" + word}, scene).at(name);
}

// "R,C=1e-7:1e-5": names with bounds, one of which may be left out.
std::vector<FreeParameter> parse_free(const std::string& words, const std::string& scene,
                                      const ParameterValues& parameters) {
  std::vector<std::string> known;
  for (const auto& [name, value] : parameters) known.push_back(name);
  std::vector<FreeParameter> free;
  std::stringstream in(words);
  for (std::string word; std::getline(in, word, ',');) {
    const std::size_t equals = word.find('='), colon = word.find(':');
    FreeParameter p;
    p.name = word.substr(0, equals);
    if (is_netlist(scene)) p.name = circuits::lower(p.name);
    if (!parameters.count(p.name))
      throw Error("--free", fmt::format("'{}' is no parameter of the scene", p.name) + suggestion(p.name, known),
                  known.empty() ? is_netlist(scene) ? "give the netlist a .param" : "give the scene [parameters]"
                                : "use some of " + join(known));
    for (const FreeParameter& other : free)
      if (other.name == p.name) throw Error("--free", fmt::format("'{}' is given twice", p.name), "give it once");
    p.start = parameters.at(p.name);
    if (equals != std::string::npos) {
      if (colon == std::string::npos || colon < equals)
        throw Error("--free", fmt::format("found '{}'", word), "give bounds as R=10:1e4, R=10: or R=:1e4");
      p.low = bound(word.substr(equals + 1, colon - equals - 1), scene, p.name, p.low);
      p.high = bound(word.substr(colon + 1), scene, p.name, p.high);
    }
    if (!(p.low < p.high) || !(p.start >= p.low && p.start <= p.high))
      throw Error("--free", fmt::format("{} starts at {}, which is not within {}", p.name, p.start, word),
                  fmt::format("give other bounds, or another start by --set {}=...", p.name));
    free.push_back(p);
  }
  if (free.empty()) throw Error("--free", "found no name", "give parameters of the scene, such as R,C");
  return free;
}

Json to_json(const std::vector<FreeParameter>& free, const Fit& f) {
  Json json{{"schema", "bromwich-fit/1"}, {"status", f.converged ? "converged" : "not_converged"}, {"ended", f.ended}};
  for (std::size_t i = 0; i < free.size(); ++i) {
    const Index k = Index(i);
    json["parameters"][free[i].name] = {{"value", f.p[k]},
                                        {"start", free[i].start},
                                        {"deviation", f.deviation[k]},
                                        {"interval", {f.low[k], f.high[k]}}};
  }
  for (Index i = 0; i < f.correlation.rows(); ++i) {
    Json row = Json::array();
    for (Index j = 0; j < f.correlation.cols(); ++j) row.push_back(f.correlation(i, j));
    json["correlation"].push_back(row);
  }
  json["deviation_of_data"] = f.deviation_of_data;
  json["data"] = f.data;
  json["evaluations"] = f.evaluations;
  json["jacobians"] = f.jacobians;
  json["derivatives"] = f.derivatives;
  return json;
}

std::string in_words(const std::vector<FreeParameter>& free, const Fit& f) {
  std::string text = fmt::format("status      {}\n", f.ended);
  for (std::size_t i = 0; i < free.size(); ++i) {
    const Index k = Index(i);
    text += std::isfinite(f.deviation[k])
                ? fmt::format("{:<11} {:.6g} +- {:.2g}, 95 % within [{:.6g}, {:.6g}]\n", free[i].name, f.p[k],
                              f.deviation[k], f.low[k], f.high[k])
                : fmt::format("{:<11} {:.6g}, which the data do not determine\n", free[i].name, f.p[k]);
  }
  text += fmt::format("data        {} values, standard deviation {:.3g}\n", f.data, f.deviation_of_data);
  text += fmt::format("derivatives {}\n", f.derivatives);
  text += fmt::format("work        {} solves, {} Jacobians\n", f.evaluations, f.jacobians);
  return text;
}

// A picture of its own, with colours that no page gives.
constexpr const char* style_of_plot =
    "<style>svg{font:12px sans-serif;background:#fff}text{fill:#57606a}.label{fill:#1b1f24}.grid{stroke:#e4e8ec}"
    ".frame{fill:none;stroke:#57606a}.line{fill:none;stroke-width:1.7}.s0{stroke:#0b5cad}.s1{stroke:none}"
    ".m1{fill:#b8430b}</style>";

// One chart below the other: the fitted curve on a fine grid, and the measured values.
std::string drawn(const FitModel& model, Backend& backend, const Options& given, const FitData& data) {
  Options options = given;
  options.states = StateSelection::all;
  options.trace = true;
  const Result curve = solve(model.scene, backend, options);
  const RowMatrix found = values_of(model, curve, data.columns);
  const Vector measured_at = Eigen::Map<const Vector>(data.t.data(), Index(data.t.size()));
  std::string charts;
  double below = 0;
  for (std::size_t k = 0; k < data.columns.size(); ++k) {
    const Column& c = data.columns[k];
    report::LineChart chart{
        c.name + ": fitted and measured",
        {"t"},
        {c.name},
        {{"fitted", curve.t, found.col(Index(k))}, {"measured", measured_at, data.values.col(Index(k)), false, true}},
        {}};
    std::string svg = report::line_chart(chart);
    const std::string box = "viewBox=\"0 0 ";
    const std::size_t at = svg.find(box) + box.size(), space = svg.find(' ', at), end = svg.find('"', space);
    const double height = std::stod(svg.substr(space + 1, end - space - 1));
    svg.insert(svg.find(box), fmt::format("x=\"0\" y=\"{}\" width=\"760\" height=\"{}\" ", below, height));
    charts += svg;
    below += height + 10;
  }
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"760\" height=\"{0}\" viewBox=\"0 0 760 {0}\">{1}{2}</svg>\n",
      below, style_of_plot, charts);
}

// t and the fitted columns at the times of the data, with the data beside them.
void write_fitted(const std::string& name, const FitModel& model, Backend& backend, const Options& given,
                  const FitData& data) {
  Options options = given;
  options.states = StateSelection::all;
  options.trace = true;
  const Result at = at_times(model.scene, backend, solve(model.scene, backend, options), data.t);
  const RowMatrix found = values_of(model, at, data.columns);
  const OutputFile file("--out", name, ".csv");
  file.write([&](std::FILE* out) {
    std::fputs("t", out);
    for (const Column& c : data.columns) fmt::print(out, ",{0},{0}_measured", c.name);
    std::fputs("\n", out);
    for (Index j = 0; j < at.t.size(); ++j) {
      fmt::print(out, "{}", at.t[j]);
      for (std::size_t k = 0; k < data.columns.size(); ++k)
        fmt::print(out, ",{},{}", found(j, Index(k)), data.values(j, Index(k)));
      std::fputs("\n", out);
    }
  });
}

}  // namespace

int run_fit(const FitArguments& a) {
  const Words words = split_words(a.words, a.settings);
  const std::string name = scene_name(words);
  const ParameterValues settings = parse_settings(words.settings, name);
  SceneSource source(name);
  const auto choose = [&](const ParameterValues& values) {
    return a.periodic.empty() ? source.initial_value_scene(values) : choose_periodic_circuit(name, values, a.periodic);
  };
  const SceneChoice choice = choose(settings);
  if (a.data.empty())
    throw Error("--data", "found none", "give a CSV file with the header t,x0,y0 and measured values");
  if (a.free.empty()) throw Error("--free", "found none", "give parameters of the scene, such as R,C");
  const std::vector<FreeParameter> free = parse_free(a.free, name, choice.parameters);
  const FitData data = read_fit_data("--data", a.data, {choice.scene, choice.circuit});
  Options options;
  options.method = a.method.empty() ? Method::automatic : parse_method(a.method);
  if (!a.steps.empty())
    options.steps = parse_steps(a.steps);
  else if (choice.circuit)
    options.tolerance_x = tolerance_of_circuits;
  const auto backend =
      choose_backend("cpu", choice.scene, options, 0, a.threads.empty() ? 0 : parse_threads(a.threads));
  const auto model_of = [&](const Vector& p) {
    ParameterValues values = settings;
    for (std::size_t i = 0; i < free.size(); ++i) values[free[i].name] = p[Index(i)];
    SceneChoice made = choose(values);
    return FitModel{std::move(made.scene), std::move(made.circuit)};
  };
  const Fit found = fit(model_of, free, data, *backend, options);
  if (!a.plot.empty()) {
    const OutputFile file("--plot", a.plot, ".svg");
    const std::string picture = drawn(model_of(found.p), *backend, options, data);
    file.write([&picture](std::FILE* out) { std::fwrite(picture.data(), 1, picture.size(), out); });
  }
  if (!a.out.empty()) write_fitted(a.out, model_of(found.p), *backend, options, data);
  print(a.json ? dump(to_json(free, found)) : in_words(free, found));
  return found.converged ? exit_solved : exit_not_solved;
}

}  // namespace bromwich::app
