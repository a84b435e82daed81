#include "app/output_csv.hpp"

#include "app/text.hpp"
#include "core/result/slack.hpp"
#include "core/scene/component_names.hpp"

#include <fmt/compile.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <tuple>
#include <vector>

namespace bromwich::app {

namespace {

constexpr std::size_t flush_bytes = 1 << 20;

void append(fmt::memory_buffer& text, double value) {
  constexpr std::size_t longest = 32;
  char number[longest];
  // A NaN may carry a sign, which readers of the file do not expect. -0 becomes 0.
  const double shown = std::isnan(value) ? std::nan("") : value + 0.0;
  text.append(number, fmt::format_to(number, FMT_COMPILE(",{}"), shown));
}

/// The values of all columns.
class Values {
 public:
  Values(const Scene& scene, const Result& result, const std::vector<Column>& columns,
         const std::vector<TimeSeries>& contacts)
      : result_(result), contacts_(result.t.size(), Index(contacts.size())) {
    for (std::size_t k = 0; k < contacts.size(); ++k) contacts_.col(Index(k)) = contacts[k].values;
    if (std::any_of(columns.begin(), columns.end(), [](const Column& c) { return c.kind == ColumnKind::w; }))
      w_ = slack(scene, result);
    for (const Column& column : columns) sources_.push_back(source(column));
  }

  /// Row j; nan for values that the result does not have.
  void append_row(fmt::memory_buffer& text, Index j) const {
    for (const auto& [values, i] : sources_)
      append(text, j < values->rows() && i < values->cols() ? (*values)(j, i) : std::nan(""));
  }

 private:
  std::pair<const RowMatrix*, Index> source(const Column& column) const {
    const Index i = column.component;
    if (column.kind == ColumnKind::y) return {&result_.y, i};
    if (column.kind == ColumnKind::w) return {&w_, i};
    if (column.kind == ColumnKind::trace) return {&result_.trace, i};
    if (column.kind == ColumnKind::mode) return {&result_.modes, i};
    if (column.kind == ColumnKind::contact) return {&contacts_, i};
    const auto& recorded = result_.x_components;
    return {&result_.x, std::find(recorded.begin(), recorded.end(), i) - recorded.begin()};
  }

  const Result& result_;
  RowMatrix contacts_, w_;
  std::vector<std::pair<const RowMatrix*, Index>> sources_;  ///< one for each column
};

bool any_finite(const RowMatrix& values, Index j) {
  return j < values.rows() && values.row(j).array().isFinite().any();
}

/// Whether a row has a value; only such rows are written for a result that is not solved.
bool valid(const Result& result, Index j) { return any_finite(result.y, j) || any_finite(result.x, j); }

/// The comment after the rows of a result that is not solved.
void append_end(fmt::memory_buffer& text, const Result& result) {
  if (result.status == Status::solved) return;
  Index last = result.t.size() - 1;
  while (last >= 0 && !valid(result, last)) --last;
  const std::string when = last < 0 ? "before t = 0" : fmt::format("at t = {}", result.t[last]);
  fmt::format_to(std::back_inserter(text), "# ended {}: {}, {}\n", when, to_string(result.status),
                 result.reason.empty() ? "no reason was given" : one_line(result.reason));
}

void flush(fmt::memory_buffer& text, std::FILE* file) {
  std::fwrite(text.data(), 1, text.size(), file);
  text.clear();
}

}  // namespace

std::vector<TimeSeries> energy_series(const Energies& energies) {
  const EnergyBalance& steps = energies.balance;
  std::vector<TimeSeries> all{{"energy", "stored energy", steps.energy},
                              {"supplied_power", "power supplied at the time", energies.power.supplied},
                              {"dissipated_power", "power dissipated at the time", energies.power.dissipated}};
  for (const auto& [name, meaning, values] :
       {std::tuple("supplied", "energy supplied over the step that ends at the time", &steps.supplied),
        {"dissipated", "energy dissipated over the step that ends at the time", &steps.dissipated},
        {"violation", "violation of the balance over the step that ends at the time", &steps.violation}}) {
    Vector of_step(values->size() + 1);
    of_step << 0, *values;
    all.push_back({name, meaning, std::move(of_step)});
  }
  return all;
}

std::vector<TimeSeries> mode_series(const Scene& scene, const Result& result) {
  std::vector<TimeSeries> all;
  for (Index k = 0; k < result.modes.cols(); ++k) {
    const Memory& memory = scene.memories[std::size_t(k)];
    std::string meaning = "mode:";
    for (std::size_t i = 0; i < memory.modes.size(); ++i)
      meaning += fmt::format("{} {} {}", i > 0 ? "," : "", i, memory.modes[i].name);
    all.push_back({memory.name, std::move(meaning), result.modes.col(k)});
  }
  return all;
}

void write_csv(const Scene& scene, const Result& sampled, const Result& result, const std::vector<Column>& columns,
               std::FILE* file, const std::vector<TimeSeries>& contacts, const Energies* energies) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  fmt::format_to(out, "t");
  for (const Column& column : columns) fmt::format_to(out, ",{}", column.name);
  const std::vector<TimeSeries> series = energies ? energy_series(*energies) : std::vector<TimeSeries>{};
  for (const TimeSeries& one : series) fmt::format_to(out, ",{}", one.name);
  fmt::format_to(out, "\n");
  const Values values(scene, sampled, columns, contacts);
  for (Index j = 0; j < sampled.t.size(); ++j) {
    if (result.status != Status::solved && !valid(sampled, j)) continue;
    fmt::format_to(out, "{}", sampled.t[j]);
    values.append_row(text, j);
    for (const TimeSeries& one : series) append(text, one.values[j]);
    fmt::format_to(out, "\n");
    if (text.size() > flush_bytes) flush(text, file);
  }
  append_end(text, result);
  flush(text, file);
}

void write_switches_csv(const Scene& scene, const std::vector<Switch>& switches, const Result& result,
                        std::FILE* file) {
  fmt::memory_buffer text;
  const auto out = std::back_inserter(text);
  const auto component = [&](Index i) { return scene.names.y.empty() ? std::to_string(i) : multiplier_name(scene, i); };
  if (scene.relays > 0 && scene.constraints() == 2 * scene.relays) {
    fmt::format_to(out, "t,relay,from,to,error\n");
    for (const RelaySwitch& s : relay_switches(result, switches, scene.relays))
      fmt::format_to(out, "{},{},{},{},{}\n", s.t, component(s.relay), s.from, s.to, s.error);
  } else {
    fmt::format_to(out, "t,component,on,error\n");
    for (const Switch& s : switches)
      fmt::format_to(out, "{},{},{},{}\n", s.t, component(s.component), s.on ? 1 : 0, s.error);
  }
  append_end(text, result);
  flush(text, file);
}

}  // namespace bromwich::app
