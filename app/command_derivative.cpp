// `bromwich derivative`: derivatives of a solution with respect to parameters of its scene.

#include "app/arguments.hpp"
#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/fit.hpp"
#include "app/interaction.hpp"
#include "app/machine.hpp"
#include "app/output_file.hpp"
#include "app/output_json.hpp"
#include "app/parameter_columns.hpp"
#include "app/scene_choice.hpp"
#include "app/text.hpp"
#include "circuits/cards.hpp"
#include "circuits/circuit.hpp"
#include "core/base/error.hpp"
#include "core/solve/dense_output.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

namespace bromwich::app {

namespace {

constexpr Index most_listed_states = 64;  ///< that are written without --columns

// Values and derivatives of the columns at the times, and of the quantity.
struct Table {
  std::vector<double> t;
  std::vector<Column> columns;
  Matrix values;               ///< times x columns
  std::vector<Matrix> slopes;  ///< the same for each parameter
  std::optional<QuantityByParameters> quantity;
};

std::vector<Column> columns_of(const DerivativeArguments& a, const Scene& scene) {
  std::vector<Column> columns;
  if (!a.columns.empty()) {
    columns = parse_columns(a.columns, scene);
    for (const Column& c : columns)
      if (c.kind == ColumnKind::trace) throw Error("--columns", fmt::format("found {}", c.name), "ask for y, w and x");
    return columns;
  }
  std::vector<Index> states;
  for (Index i = 0; i < scene.states() && scene.states() <= most_listed_states; ++i) states.push_back(i);
  return default_columns(scene, states);
}

Options options_of(const DerivativeArguments& a, const SceneChoice& choice, const std::vector<Column>& columns) {
  Options options;
  options.method = a.method.empty() ? Method::automatic : parse_method(a.method);
  SolveArguments control;
  control.steps = a.steps, control.tolerance = a.tolerance;
  if (!a.steps.empty()) options.steps = parse_steps(a.steps);
  parse_error_control(control, options, choice.scene, choice.circuit != nullptr);
  options.states = states_of(columns).empty() ? StateSelection::none : StateSelection::all;
  options.trace = true;
  options.memory_limit = memory_bytes();
  if (options.method == Method::goal) throw Error("--method", "found 'goal'", "take another method, such as march");
  return options;
}

Table table_of(const SceneChoice& choice, const ParameterDerivative& d, const Result& result, Backend& backend,
               const std::vector<Column>& columns, const std::vector<double>& times) {
  Table table{times, columns, Matrix(Index(times.size()), Index(columns.size())), {}, {}};
  const Result at = at_times(choice.scene, backend, result, times);
  for (Index j = 0; j < table.values.rows(); ++j)
    for (Index k = 0; k < table.values.cols(); ++k)
      table.values(j, k) = value_of(choice.scene, at, j, columns[std::size_t(k)]);
  const bool states = !states_of(columns).empty();
  for (Index i = 0; i < d.parameters(); ++i) {
    const SolutionChange change = d.jvp(i, states);
    Matrix& slopes = table.slopes.emplace_back(table.values.rows(), table.values.cols());
    for (Index k = 0; k < slopes.cols(); ++k)
      slopes.col(k) = column_of(change, d.times(), choice.scene, columns[std::size_t(k)], times);
  }
  if (choice.quantity) table.quantity = d.quantity();
  return table;
}

std::string margin_in_words(const DerivativeMargin& m) {
  std::string words = m.constraint < 0
                          ? "no constraint is near y = w = 0"
                          : fmt::format("{:.2e}: y and w of constraint {} come nearest to 0 together at t = {:.6g}",
                                        m.margin, m.constraint, m.time);
  if (std::isfinite(m.transversality))
    words += fmt::format("; transversality {:.2e} at t = {:.6g}", m.transversality, m.grazing_time);
  return words;
}

std::string in_words(const SceneChoice& choice, const ParameterDerivative& d, const Result& r, const Table& table) {
  std::string text = fmt::format("scene       {}, {} steps by {}\n", choice.scene.name, r.steps, to_string(r.method));
  text += fmt::format("{}\n", d.in_words());
  text += fmt::format("margin      {}\n", margin_in_words(d.of_data().margin()));
  std::vector<std::string> head{"quantity", "t", "value"};
  for (const std::string& name : d.names())
    head.push_back(fmt::format("d/d{} at {:.6g}", name, choice.parameters.at(name)));
  std::vector<std::vector<std::string>> rows{head};
  const auto number = [](double v) { return fmt::format("{:.8g}", v); };
  for (Index j = 0; j < table.values.rows(); ++j)
    for (Index k = 0; k < table.values.cols(); ++k) {
      rows.push_back({table.columns[std::size_t(k)].name, fmt::format("{:.6g}", table.t[std::size_t(j)]),
                      number(table.values(j, k))});
      for (const Matrix& slopes : table.slopes) rows.back().push_back(number(slopes(j, k)));
    }
  if (table.quantity) {
    rows.push_back({"I", "", number(table.quantity->value)});
    for (const double slope : table.quantity->gradient) rows.back().push_back(number(slope));
  }
  std::vector<std::size_t> widths(head.size(), 0);
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  for (const auto& row : rows) {
    std::string line = fmt::format("{:<{}}", row[0], widths[0]);
    for (std::size_t i = 1; i < row.size(); ++i) line += fmt::format("  {:>{}}", row[i], widths[i]);
    text += line + "\n";
  }
  return text;
}

Json to_json(const SceneChoice& choice, const ParameterDerivative& d, const Result& r, const Table& table) {
  const DerivativeMargin& m = d.of_data().margin();
  Json json{{"schema", "bromwich-derivative/1"},
            {"scene", choice.scene.name},
            {"status", to_string(r.status)},
            {"method", to_string(r.method)},
            {"steps", r.steps},
            {"form", to_string(d.of_data().form())},
            {"data", "central differences"},
            {"distance", d.distance()},
            {"margin", {{"margin", m.margin}, {"t", m.time}, {"constraint", m.constraint}}}};
  if (std::isfinite(m.transversality))
    json["margin"].update({{"transversality", m.transversality}, {"grazing_time", m.grazing_time}});
  for (const std::string& name : d.names()) json["parameters"][name] = choice.parameters.at(name);
  json["t"] = table.t;
  for (std::size_t k = 0; k < table.columns.size(); ++k) {
    const std::string& column = table.columns[k].name;
    const auto values = [&](const Matrix& of) {
      return std::vector<double>(of.col(Index(k)).begin(), of.col(Index(k)).end());
    };
    json["values"][column] = values(table.values);
    for (std::size_t i = 0; i < table.slopes.size(); ++i)
      json["derivatives"][d.names()[i]][column] = values(table.slopes[i]);
  }
  if (table.quantity) {
    json["quantity"]["value"] = table.quantity->value;
    for (std::size_t i = 0; i < d.names().size(); ++i)
      json["quantity"]["derivatives"][d.names()[i]] = table.quantity->gradient[Index(i)];
  }
  return json;
}

void write_csv(const OutputFile& file, const ParameterDerivative& d, const Table& table) {
  file.write([&](std::FILE* out) {
    std::fputs("t", out);
    for (const Column& c : table.columns) {
      fmt::print(out, ",{}", c.name);
      for (const std::string& name : d.names()) fmt::print(out, ",d{}/d{}", c.name, name);
    }
    std::fputs("\n", out);
    for (std::size_t j = 0; j < table.t.size(); ++j) {
      fmt::print(out, "{}", table.t[j]);
      for (Index k = 0; k < table.values.cols(); ++k) {
        fmt::print(out, ",{}", table.values(Index(j), k));
        for (const Matrix& slopes : table.slopes) fmt::print(out, ",{}", slopes(Index(j), k));
      }
      std::fputs("\n", out);
    }
  });
}

}  // namespace

int run_derivative(const DerivativeArguments& a) {
  const Words words = split_words(a.words, a.settings);
  const ParameterValues settings = parse_settings(words.settings, scene_name(words));
  SceneSource source(scene_name(words));
  const SceneChoice choice = source.with(settings);
  if (a.by.empty()) throw Error("--by", "found none", "give parameters of the scene, such as R,C");
  const std::string by = is_netlist(scene_name(words)) ? circuits::lower(a.by) : a.by;  // netlists ignore case
  const std::vector<std::string> names = parse_parameters("--by", by, choice.parameters);
  const std::vector<Column> columns = columns_of(a, choice.scene);
  const Options options = options_of(a, choice, columns);
  const double T = choice.scene.T;
  std::vector<double> times = a.at.empty() ? std::vector<double>{T} : parse_times(a.at, T);
  std::optional<OutputFile> file;
  if (!a.out.empty()) file.emplace("--out", a.out, ".csv");
  const auto backend =
      choose_backend("cpu", choice.scene, options, 0, a.threads.empty() ? 0 : parse_threads(a.threads));

  const Result result = solve(choice.scene, *backend, options);
  if (result.status != Status::solved) {
    complain(fmt::format("{}: {}", to_string(result.status), one_line(result.reason)));
    return exit_not_solved;
  }
  std::vector<VariedParameter> parameters;
  for (const std::string& name : names)
    parameters.push_back(scene_parameter(source, settings, name, choice.parameters.at(name)));
  try {
    const ParameterDerivative d(choice.scene, result, *backend, parameters,
                                a.located ? std::optional(true) : std::nullopt, times);
    if (file) {
      if (a.at.empty()) times.assign(result.t.begin(), result.t.end());
      write_csv(*file, d, table_of(choice, d, result, *backend, columns, times));
      if (a.at.empty()) times = {T};
    }
    const Table table = table_of(choice, d, result, *backend, columns, times);
    print(a.json ? dump(to_json(choice, d, result, table)) : in_words(choice, d, result, table));
  } catch (const Error& refusal) {
    if (refusal.argument() != "derivative" && refusal.argument() != "M") throw;
    complain(refusal.what());
    return exit_not_solved;
  }
  return exit_solved;
}

}  // namespace bromwich::app
