#include "report/page_parts.hpp"

#include "report/charts.hpp"
#include "report/scale.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace bromwich::report {

namespace {

constexpr double negligible = 1e-12;   ///< y below this part of the largest counts as 0, as for switches
constexpr std::size_t most_bars = 30;  ///< constraints with a bar of their own
constexpr std::size_t most_other_columns = 6;
constexpr Index most_steps_seen = 120;  ///< rows up to which y is drawn in steps if it may jump from row to row

std::string number(double value) { return short_number(value, 4); }

std::string figure(const std::string& picture, const std::string& caption) {
  return fmt::format("<figure>\n{}<figcaption>{}</figcaption>\n</figure>\n", picture, escaped(caption));
}

std::string heading(const std::string& words) { return fmt::format("<h2>{}</h2>\n", escaped(words)); }

/// Rows of a table: a label, and words.
class Table {
 public:
  void row(const std::string& label, const std::string& words) {
    if (!words.empty())
      text_ += fmt::format("<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n", escaped(label), escaped(words));
  }
  void rows(const std::string& label, const std::vector<std::string>& lines) {
    if (lines.empty()) return;
    std::string all;
    for (const std::string& line : lines) all += (all.empty() ? "" : "<br/>") + escaped(line);
    text_ += fmt::format("<tr><th scope=\"row\">{}</th><td>{}</td></tr>\n", escaped(label), all);
  }
  std::string end() const { return text_.empty() ? "" : "<table>\n" + text_ + "</table>\n"; }

 private:
  std::string text_;
};

std::string with_unit(const std::string& name, const std::string& unit) {
  return unit.empty() ? name : name + " [" + unit + "]";
}

std::string time_label(const Report& report) { return with_unit("time t", report.table.time_unit); }

/// The unit of all columns, or "" if they differ.
std::string common_unit(const Quantity& q) {
  const bool same = std::adjacent_find(q.units.begin(), q.units.end(), std::not_equal_to<>()) == q.units.end();
  return same && !q.units.empty() ? q.units.front() : "";
}

bool is_set(const Json& summary, const char* key) {
  return summary.is_object() && summary.contains(key) && summary[key].is_boolean() && summary[key].get<bool>();
}

std::vector<std::string> words_at(const Json& summary, const char* key) {
  std::vector<std::string> words;
  if (summary.is_object() && summary.contains(key) && summary[key].is_array())
    for (const Json& word : summary[key])
      if (word.is_string()) words.push_back(word.get<std::string>());
  return words;
}

}  // namespace

// ---- words ----

std::string outcome_part(const Report& report) {
  const std::string status = text_at(report.summary, "status"), warning = text_at(report.summary, "warning");
  const char* kind = status != "solved" ? (status.empty() ? " doubt" : "") : warning.empty() ? " good" : " doubt";
  std::string html =
      fmt::format("<div class=\"status{}\"><strong>{}</strong> – {}", kind,
                  escaped(status.empty() ? "no summary" : status), escaped(status_sentence(report.summary)));
  if (status.empty() && !report.table.remark.empty())
    html += " " + escaped("The file says: " + report.table.remark + ".");
  if (!warning.empty()) html += fmt::format("<br/><strong>Warning:</strong> {}.", escaped(warning));
  return html + "</div>\n";
}

namespace {

std::string parameters(const Json& summary) {
  std::string words;
  if (!summary.contains("parameters") || !summary["parameters"].is_object()) return words;
  for (const auto& [key, value] : summary["parameters"].items())
    words +=
        (words.empty() ? "" : ", ") + key + " = " + (value.is_number() ? number(value.get<double>()) : value.dump());
  return words;
}

std::string sizes(const Report& report) {
  const Json& s = report.summary;
  const auto n = number_at(s, "sizes/constraints"), m = number_at(s, "sizes/states"), T = number_at(s, "sizes/T"),
             J = number_at(s, "steps");
  if (!n || !m || !T || !J) return "";
  return fmt::format("{:.0f} constraint{}, {:.0f} state{}, {:.0f} time steps up to T = {}", *n, *n == 1 ? "" : "s", *m,
                     *m == 1 ? "" : "s", *J,
                     number(*T) + (report.table.time_unit.empty() ? "" : " " + report.table.time_unit));
}

std::string asked(const Json& s) {
  std::string words;
  const auto add = [&](const std::string& word) { words += (words.empty() ? "" : ", ") + word; };
  if (const std::string method = text_at(s, "requested/method"); !method.empty()) add("method " + method);
  if (const auto tol = number_at(s, "requested/tolerance")) add("error below " + number(*tol));
  if (const auto steps = number_at(s, "requested/steps")) add(fmt::format("{:.0f} steps", *steps));
  if (const auto tol = number_at(s, "requested/iteration_tolerance")) add("iterations to " + number(*tol));
  return words;
}

std::string how(const Json& s) {
  const std::string method = text_at(s, "method"), backend = text_at(s, "backend");
  if (method.empty()) return "";
  const auto threads = number_at(s, "threads");
  return fmt::format("{} on {}{}", method, backend,
                     threads ? fmt::format(", {:.0f} thread{}", *threads, *threads == 1 ? "" : "s") : "");
}

}  // namespace

std::string facts_part(const Report& report) {
  const Json& s = report.summary;
  if (!s.is_object()) {
    const Index rows = report.table.t.size();
    return heading("What the file has") + fmt::format("<p>{} rows, {} columns beside the time.</p>\n", rows, [&] {
             std::size_t columns = 0;
             for (const Quantity& q : report.table.quantities) columns += q.names.size();
             return columns;
           }());
  }
  Table table;
  table.row("scene", text_at(s, "scene"));
  table.row("parameters", parameters(s));
  table.row("size", sizes(report));
  table.row("class of M", text_at(s, "class"));
  table.row("spectrum of A", text_at(s, "spectrum"));
  table.row("asked for", asked(s));
  table.row("method", how(s));
  table.rows("what was decided", words_at(s, "decisions"));
  table.row("kernel", text_at(s, "kernel"));
  if (number_at(s, "sizes/constraints") == 0.0) return heading("What was solved") + table.end();
  return heading("What was solved") +
         "<p class=\"note\">E x′ = A x + B y + f(t), 0 ≤ y ⊥ w = N x + M y + g(t) ≥ 0: at every time each "
         "constraint has y = 0 or w = 0.</p>\n" +
         table.end();
}

std::string certificate_part(const Report& report) {
  const std::vector<Certificate> list = certificates(report.summary);
  if (list.empty()) return "";
  std::string rows;
  for (const Certificate& c : list)
    rows += fmt::format("<tr><th scope=\"row\">{}</th><td class=\"number\">{}</td><td>{}</td></tr>\n", escaped(c.name),
                        escaped(c.value), escaped(c.meaning));
  return heading("What was checked") + "<table>\n" + rows + "</table>\n";
}

// ---- curves ----

namespace {

struct Kind {
  const char *symbol, *heading, *one;  ///< `one`: what a component is called
};
constexpr std::array<Kind, 3> kinds{{{"y", "y: the complementary variables", "constraint"},
                                     {"w", "w = N x + M y + g", "constraint"},
                                     {"x", "x: the states", "state"}}};

/// An impulse at t = 0 is no value of y, and nothing else would be seen beside it.
RowMatrix without_impulse(const Report& report, const Quantity& q) {
  RowMatrix values = q.values;
  if (q.symbol == "y" && is_set(report.summary, "starts_with_impulse") && values.rows() > 1)
    values.row(0).setConstant(NAN);
  return values;
}

/// Columns that share an axis: of one unit, and of sizes that are seen beside each other.
std::vector<std::vector<Index>> panels(const Quantity& q, const RowMatrix& values) {
  constexpr double seen_beside = 40;  ///< times smaller: a few pixels
  constexpr std::size_t most_panels = 4;
  std::vector<std::pair<double, Index>> sizes;
  for (Index i = 0; i < values.cols(); ++i) {
    double largest = 0;
    for (const double v : values.col(i))
      if (std::isfinite(v)) largest = std::max(largest, std::abs(v));
    sizes.emplace_back(largest, i);
  }
  std::stable_sort(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::vector<Index>> groups;
  std::vector<double> of_group;
  for (const auto& [size, i] : sizes) {
    std::size_t g = 0;
    const auto fits = [&](std::size_t k) {
      return q.units[std::size_t(groups[k].front())] == q.units[std::size_t(i)] &&
             (size == 0 || size * seen_beside >= of_group[k]);
    };
    while (g < groups.size() && !fits(g)) ++g;
    if (g == groups.size() && g == most_panels) --g;
    if (g == groups.size()) {
      groups.emplace_back();
      of_group.push_back(size);
    }
    groups[g].push_back(i);
  }
  for (auto& group : groups) std::sort(group.begin(), group.end());
  return groups;
}

std::string lines_of(const Report& report, const Quantity& q) {
  const RowMatrix values = without_impulse(report, q);
  const bool few = report.table.t.size() <= most_steps_seen;
  const bool steps = few && q.symbol == "y" && report.summary.is_object() && report.summary.contains("continuous") &&
                     !is_set(report.summary, "continuous");
  std::string pictures;
  for (const std::vector<Index>& panel : panels(q, values)) {
    const std::string unit = q.units[std::size_t(panel.front())];
    const bool one = panel.size() == 1;
    const std::string label = one ? q.names[std::size_t(panel.front())] : q.symbol;
    LineChart chart{label + " over time", {time_label(report)}, {with_unit(label, unit)}, {}, {}};
    for (const Index i : panel) chart.lines.push_back({q.names[std::size_t(i)], report.table.t, values.col(i), steps});
    pictures += line_chart(chart);
  }
  return pictures;
}

std::string map_of(const Report& report, const Quantity& q, const Kind& kind) {
  return heat_map({std::string(kind.symbol) + " over time and " + kind.one, time_label(report),
                   std::string("number of the ") + kind.one, with_unit(kind.symbol, common_unit(q)), report.table.t,
                   without_impulse(report, q), false});
}

std::string curve_caption(const Report& report, const Quantity& q, const Kind& kind) {
  const bool map = q.names.size() > most_lines;
  std::string words;
  if (map)
    words = fmt::format(
        "{} components, each a row of the picture, from {} to {}. Where several values share a cell it "
        "shows the one of largest modulus.",
        q.names.size(), q.names.front(), q.names.back());
  else if (q.names.size() == 1)
    words = with_unit(q.names.front(), q.units.front()) + " over time.";
  else
    words =
        fmt::format("{} components over time{}.", q.names.size(),
                    panels(q, q.values).size() > 1 ? "; those of other units or sizes have an axis of their own" : "");
  if (q.symbol == "y" && is_set(report.summary, "starts_with_impulse"))
    words += " The state jumps at t = 0: the value of y there is an impulse and not shown.";
  if (q.symbol == std::string("x") && map) words += fmt::format(" Numbers count the recorded {}s.", kind.one);
  return words;
}

std::string others(const Report& report, const Quantity& q) {
  std::string html = heading("Other columns");
  for (std::size_t i = 0; i < std::min(q.names.size(), most_other_columns); ++i) {
    LineChart chart{q.names[i] + " over time", {time_label(report)}, {with_unit(q.names[i], q.units[i])}, {}, {}};
    chart.lines.push_back({q.names[i], report.table.t, q.values.col(Index(i))});
    html += figure(line_chart(chart), q.names[i] + " over time.");
  }
  if (q.names.size() > most_other_columns)
    html += fmt::format("<p class=\"note\">{} more columns are not drawn.</p>\n", q.names.size() - most_other_columns);
  return html;
}

}  // namespace

std::string curves_part(const Report& report) {
  std::string html;
  if (report.table.t.size() == 0) return html;
  for (const Kind& kind : kinds) {
    const Quantity* q = report.table.find(kind.symbol);
    if (!q) continue;
    html += heading(kind.heading);
    html += figure(q->names.size() > most_lines ? map_of(report, *q, kind) : lines_of(report, *q),
                   curve_caption(report, *q, kind));
  }
  if (const Quantity* q = report.table.find("")) html += others(report, *q);
  return html;
}

// ---- active sets ----

std::vector<std::pair<double, double>> active_times(const Vector& t, const Eigen::Ref<const Vector>& y, double zero) {
  std::vector<std::pair<double, double>> times;
  for (Index j = 0; j < t.size(); ++j) {
    if (!(y[j] > zero)) continue;
    const Index first = j;
    while (j + 1 < t.size() && y[j + 1] > zero) ++j;
    times.emplace_back(t[first], t[j]);
  }
  return times;
}

namespace {

std::string bars_of(const Report& report, const Quantity& y, const RowMatrix& values, const std::vector<Index>& rows,
                    double zero) {
  const Vector& t = report.table.t;
  TimeBars chart{"active constraints over time", time_label(report), t[0], t[t.size() - 1], {}, {}};
  for (const Index i : rows) {
    chart.names.push_back(y.names[std::size_t(i)]);
    chart.bars.push_back(active_times(t, values.col(i), zero));
  }
  return time_bars(chart);
}

/// Rows whose y has a sign condition.
std::vector<Index> bound_rows(const Json& summary, Index n) {
  const std::vector<double> free = numbers_at(summary, "free_rows");
  std::vector<Index> rows;
  for (Index i = 0; i < n; ++i)
    if (std::find(free.begin(), free.end(), double(i)) == free.end()) rows.push_back(i);
  return rows;
}

}  // namespace

std::string active_part(const Report& report) {
  const Quantity* y = report.table.find("y");
  if (!y || report.table.t.size() < 2) return "";
  const std::vector<Index> rows = bound_rows(report.summary, y->values.cols());
  if (rows.empty()) return "";
  const RowMatrix values = without_impulse(report, *y);
  double largest = 0;
  for (const double v : values.reshaped())
    if (std::isfinite(v)) largest = std::max(largest, std::abs(v));
  const double zero = negligible * largest;
  std::string caption = "A bar stands where y > 0, at every time point of the result. ";
  std::string picture;
  if (rows.size() <= most_bars) {
    picture = bars_of(report, *y, values, rows, zero);
  } else {
    RowMatrix on = values(Eigen::all, rows);
    for (double& v : on.reshaped()) v = v > zero ? 1 : 0;
    picture = heat_map({"active constraints over time", time_label(report), "number of the constraint", "",
                        report.table.t, std::move(on), true});
    caption = "Coloured where y > 0. ";
  }
  Index changes = 0;
  for (const Index i : rows) {
    const auto times = active_times(report.table.t, values.col(i), zero);
    for (const auto& [from, to] : times)
      changes += (from > report.table.t[0] ? 1 : 0) + (to < report.table.t[report.table.t.size() - 1] ? 1 : 0);
  }
  caption += fmt::format("Constraints become active or inactive {} time{}.", changes, changes == 1 ? "" : "s");
  return heading("Active constraints") + figure(picture, caption);
}

// ---- convergence and errors ----

namespace {

Vector counted(std::size_t count) { return Vector::LinSpaced(Index(count), 1, double(count)); }

Vector as_vector(const std::vector<double>& values) {
  return Eigen::Map<const Vector>(values.data(), Index(values.size()));
}

std::string changes_figure(const Json& s, const std::vector<double>& history) {
  const bool cycles = number_at(s, "cycles").value_or(0) > 0;
  const char* one = cycles ? "cycle" : "sweep";
  LineChart chart{fmt::format("change of y in each {}", one), {one}, {"change of y", true}, {}, {}};
  chart.lines.push_back({"largest change", counted(history.size()), as_vector(history), false, history.size() <= 60});
  if (const auto tolerance = number_at(s, "requested/iteration_tolerance"))
    chart.levels.push_back({*tolerance, "iteration tolerance " + number(*tolerance)});
  return figure(line_chart(chart), fmt::format("Largest change of y in each of {} {}{}, relative to max(1, |y|).",
                                               history.size(), one, history.size() == 1 ? "" : "s"));
}

std::string grids_figure(const Json& s, const std::vector<double>& grids, const std::vector<double>& estimates) {
  LineChart chart{"estimated error of each grid", {"time steps", true}, {"estimated error", true}, {}, {}};
  Line line{"estimated error", as_vector(grids), as_vector(estimates), false, true};
  chart.lines.push_back(std::move(line));
  if (const auto tolerance = number_at(s, "errors/tolerance"))
    chart.levels.push_back({*tolerance, "tolerance " + number(*tolerance)});
  std::string words;
  for (const double J : grids) words += fmt::format("{}{:.0f}", words.empty() ? "" : ", ", J);
  return figure(line_chart(chart),
                "Grids of " + words + " steps. The first ones have no estimate: it needs grids to compare.");
}

std::string goal_figure(const Json& s) {
  std::vector<double> cells, quantity, estimate;
  for (const Json& cycle : s["goal"]["history"]) {
    cells.push_back(number_at(cycle, "steps").value_or(NAN));
    quantity.push_back(std::abs(number_at(cycle, "quantity").value_or(NAN)));
    estimate.push_back(std::abs(number_at(cycle, "estimate").value_or(NAN)));
  }
  const std::string name = text_at(s, "goal/quantity");
  LineChart chart{"quantity of interest on each grid", {"time steps", true}, {"modulus", true}, {}, {}};
  chart.lines.push_back({"quantity " + name, as_vector(cells), as_vector(quantity), false, true});
  chart.lines.push_back({"estimated error of it", as_vector(cells), as_vector(estimate), false, true});
  return figure(line_chart(chart), fmt::format("The quantity of interest and its estimated error on {} grids, each "
                                               "refined where the error comes from.",
                                               cells.size()));
}

}  // namespace

std::string convergence_part(const Report& report) {
  const Json& s = report.summary;
  std::string html;
  const auto drawn = [](const std::vector<double>& v) {
    return std::count_if(v.begin(), v.end(), [](double x) { return std::isfinite(x) && x > 0; });
  };
  const bool goal = s.is_object() && s.contains("goal") && s["goal"].is_object() && s["goal"].contains("history");
  if (const auto history = numbers_at(s, "history"); !goal && drawn(history) > 1) html += changes_figure(s, history);
  const auto grids = numbers_at(s, "errors/grids"), estimates = numbers_at(s, "errors/estimates");
  if (grids.size() > 1 && grids.size() == estimates.size() && drawn(estimates) > 0)
    html += grids_figure(s, grids, estimates);
  if (goal && s["goal"]["history"].size() > 1) html += goal_figure(s);
  return html.empty() ? "" : heading("Convergence") + html;
}

std::string error_part(const Report& report) {
  const Json& s = report.summary;
  NumberBars chart{"parts of the estimated error", "estimated error, relative", {}, {}};
  for (const auto& [key, name] : {std::pair("discretisation", "steps, of y"),
                                  {"states", "steps, of x"},
                                  {"kernel", "weights of the kernel"},
                                  {"iteration", "iteration"},
                                  {"rounding", "rounding"},
                                  {"interior", "between time points"}})
    if (const auto value = number_at(s, std::string("errors/") + key); value && *value > 0)
      chart.bars.emplace_back(name, *value);
  const auto tolerance = number_at(s, "errors/tolerance");
  if (chart.bars.empty() || !tolerance) return "";
  if (*tolerance > 0) chart.levels.push_back({*tolerance, "tolerance " + number(*tolerance)});
  const auto total = number_at(s, "error_estimate"), order = number_at(s, "errors/order");
  std::string words = total ? fmt::format("The estimated error is {}, {} the tolerance.", number(*total),
                                          *total <= *tolerance ? "below" : "above")
                            : "The error could not be estimated.";
  if (order) words += fmt::format(" Halving the step was seen to reduce it with order {:.1f}.", *order);
  return heading("Error and tolerance") + figure(number_bars(chart), words);
}

// ---- time ----

std::string time_part(const Report& report) {
  const Json& s = report.summary;
  const auto total = number_at(s, "seconds/total");
  if (!total || !(*total > 0)) return "";
  const auto part = [&](const char* key) { return number_at(s, std::string("seconds/") + key).value_or(0); };
  const double certification = std::min(part("certification"), part("other"));
  const std::vector<std::pair<const char*, double>> parts{
      {"set-up", part("setup")},
      {"complementarity problems, marching", part("lcp")},
      {"convolution with the kernel", part("convolution")},
      {"sine transforms", part("transform")},
      {"certification: checks and solves to confirm", certification},
      {"other", part("other") - certification}};
  std::vector<double> values;
  std::string rows;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& [name, seconds] = parts[i];
    values.push_back(std::max(0., seconds));
    rows += fmt::format(
        "<tr><th scope=\"row\"><svg class=\"swatch\" viewBox=\"0 0 10 10\" aria-hidden=\"true\"><rect "
        "class=\"part-{}\" width=\"10\" height=\"10\"/></svg>{}</th><td class=\"number\">{} "
        "s</td><td>{:.0f} %</td></tr>\n",
        i, name, short_number(seconds, 3), 100 * seconds / *total);
  }
  std::string words = fmt::format("{} s in total.", short_number(*total, 3));
  const auto bytes = number_at(s, "bytes"), predicted = number_at(s, "bytes_predicted");
  if (bytes) words += fmt::format(" Arrays and plans took {} MB", short_number(*bytes * 1e-6, 3));
  if (bytes && predicted && *predicted > 0)
    words += fmt::format(", predicted were {} MB", short_number(*predicted * 1e-6, 3));
  if (bytes) words += ".";
  return heading("Time and memory") + figure(parts_of_whole("parts of the time", values), words) +
         "<table class=\"times\">\n" + rows + "</table>\n";
}

}  // namespace bromwich::report
