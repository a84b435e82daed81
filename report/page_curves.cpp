// Curves of y, w and the states, and when constraints are active.

#include "report/charts.hpp"
#include "report/page_parts.hpp"
#include "report/page_pieces.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich::report {

namespace {

constexpr double negligible = 1e-12;   ///< y below this part of the largest counts as 0, as for switches
constexpr std::size_t most_bars = 30;  ///< constraints with a bar of their own
constexpr std::size_t most_other_columns = 6;
constexpr Index most_steps_seen = 120;  ///< rows up to which y is drawn in steps if it may jump from row to row

}  // namespace

namespace {

struct Kind {
  const char *symbol, *heading, *one;  ///< `one`: what a component is called
};
constexpr std::array<Kind, 3> kinds{{{"x", "x: the states", "state"},
                                     {"y", "y: the complementary variables", "constraint"},
                                     {"w", "w = N x + M y + g", "constraint"}}};

double largest_of(const Eigen::Ref<const RowMatrix>& values) {
  double largest = 0;
  for (const double v : values.reshaped())
    if (std::isfinite(v)) largest = std::max(largest, std::abs(v));
  return largest;
}

/// With its times as the axes show them.
Report with_drawn_times(Report report) {
  if (report.table.t.size() == 0) return report;
  const ScaledUnit unit = drawn_time(report);
  report.table.t /= unit.size;
  report.table.time_unit = unit.name;
  return report;
}

/// y, and w = N x + M y + g, at t = 0 where the state jumps there.
bool has_impulse(const Report& report, const Quantity& q) {
  return (q.symbol == "y" || q.symbol == "w") && is_set(report.summary, "starts_with_impulse");
}

/// An impulse is no value, and nothing else would be seen beside it.
RowMatrix without_impulse(const Report& report, const Quantity& q) {
  RowMatrix values = q.values;
  if (has_impulse(report, q) && values.rows() > 1) values.row(0).setConstant(NAN);
  return values;
}

/// Columns that share an axis: of one unit, and of sizes that are seen beside each other.
std::vector<std::vector<Index>> panels(const Quantity& q, const RowMatrix& values) {
  constexpr double seen_beside = 40;  ///< times smaller: a few pixels
  constexpr std::size_t most_panels = 4;
  std::vector<std::pair<double, Index>> sizes;
  for (Index i = 0; i < values.cols(); ++i) {
    sizes.emplace_back(largest_of(values.col(i)), i);
  }
  std::stable_sort(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<std::vector<Index>> groups;
  std::vector<double> of_group;
  for (const auto& entry : sizes) {
    const double size = entry.first;  // clang 14 takes no structured binding into a lambda
    const Index i = entry.second;
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
    const ScaledUnit unit = with_prefix(q.units[std::size_t(panel.front())], largest_of(values(Eigen::all, panel)));
    const bool one = panel.size() == 1;
    const std::string label = one ? q.names[std::size_t(panel.front())] : q.symbol;
    LineChart chart{label + " over time", {time_label(report)}, {with_unit(label, unit.name)}, {}, {}};
    for (const Index i : panel)
      chart.lines.push_back({q.names[std::size_t(i)], report.table.t, values.col(i) / unit.size, steps});
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
  if (has_impulse(report, q))
    words += fmt::format(" The state jumps at t = 0: {} not shown.",
                         q.symbol == "y" ? "the value of y there is an impulse and" : "w there has an impulse and is");
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

std::string curves_part(const Report& given) {
  const Report report = with_drawn_times(given);
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

std::string active_part(const Report& given) {
  const Report report = with_drawn_times(given);
  const Quantity* y = report.table.find("y");
  if (!y || report.table.t.size() < 2) return "";
  const std::vector<Index> rows = bound_rows(report.summary, y->values.cols());
  if (rows.empty()) return "";
  const RowMatrix values = without_impulse(report, *y);
  const double zero = negligible * largest_of(values);
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

}  // namespace bromwich::report
