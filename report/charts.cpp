#include "report/charts.hpp"

#include "report/scale.hpp"
#include "report/thinning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

namespace bromwich::report {

namespace {

constexpr double width = 760;         ///< of all pictures, in the units of their text, 12 high
constexpr double height = 230;        ///< between the axes
constexpr double row_height = 17;     ///< of a line of text
constexpr double letter = 6.6;        ///< mean width
constexpr double right_margin = 22;   ///< half of a label of the last tick
constexpr double below_axis = 42;     ///< tick labels and the label of the axis
constexpr Index curve_buckets = 700;  ///< about one for each pixel

/// Values from dark to bright, also in grey (viridis).
constexpr const char* shades[] = {"#440154", "#471164", "#482071", "#472e7c", "#443b84", "#3f4889",
                                  "#3a548c", "#34608d", "#2f6c8e", "#2a768e", "#26818e", "#228b8d",
                                  "#1f958b", "#1fa088", "#24aa83", "#2fb47c", "#42be71", "#58c765",
                                  "#70cf57", "#8bd646", "#a8db34", "#c5e021", "#e2e418", "#fde725"};
constexpr Index shade_count = Index(std::size(shades));

/// Letters, not bytes.
double text_width(const std::string& text) {
  const auto letters = std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; });
  return letter * double(letters);
}

class Svg {
 public:
  Svg(const std::string& title, double height_of_all) {
    add(R"(<svg role="img" viewBox="0 0 {:.0f} {:.0f}" xmlns="http://www.w3.org/2000/svg"><title>{}</title>)", width,
        height_of_all, escaped(title));
  }
  template <class... Arguments>
  void add(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Arguments>(arguments)...);
  }
  void words(double x, double y, const char* anchor, const std::string& text, const char* more = "") {
    add(R"(<text x="{:.1f}" y="{:.1f}" text-anchor="{}"{}>{}</text>)", x, y, anchor, more, escaped(text));
  }
  /// The label of an axis at the left edge.
  void upward(double y, const std::string& text) {
    add(R"x(<text class="label" x="13" y="{0:.1f}" text-anchor="middle" transform="rotate(-90 13 {0:.1f})">{1}</text>)x",
        y, escaped(text));
  }
  void segment(const char* style, double x1, double y1, double x2, double y2) {
    add(R"(<path class="{}" d="M{:.1f} {:.1f}L{:.1f} {:.1f}"/>)", style, x1, y1, x2, y2);
  }
  std::string end() {
    text_ += "</svg>\n";
    return std::move(text_);
  }

 private:
  std::string text_;
};

void draw_x_axis(Svg& svg, const Scale& x, double top, double bottom, const std::string& label) {
  for (const Tick& tick : x.ticks(7)) {
    svg.segment("grid", x(tick.value), top, x(tick.value), bottom);
    svg.words(x(tick.value), bottom + 15, "middle", tick.label);
  }
  svg.words((x.from() + x.to()) / 2, bottom + 34, "middle", label, R"( class="label")");
}

void draw_y_axis(Svg& svg, const Scale& y, const std::vector<Tick>& ticks, double left, double right,
                 const std::string& label) {
  for (const Tick& tick : ticks) {
    svg.segment("grid", left, y(tick.value), right, y(tick.value));
    svg.words(left - 6, y(tick.value) + 4, "end", tick.label);
  }
  const double middle = (y.from() + y.to()) / 2;
  svg.upward(middle, label);
}

double left_margin(const std::vector<Tick>& ticks) {
  double widest = 0;
  for (const Tick& tick : ticks) widest = std::max(widest, text_width(tick.label));
  return std::max(62.0, 32 + widest);  // axes of pictures below one another begin at the same place
}

// ---- lines ----

/// Where the names of the lines stand, above the axes, in as many rows as they need.
struct Legend {
  struct Entry {
    std::string name;
    std::string style;
    double x = 0, y = 0;
  };
  std::vector<Entry> entries;
  double bottom = 6;

  explicit Legend(const LineChart& chart) {
    if (chart.lines.size() > 1 || !chart.levels.empty())
      for (std::size_t i = 0; i < chart.lines.size(); ++i)
        entries.push_back({chart.lines[i].name, fmt::format("line s{}", i)});
    for (const Level& level : chart.levels) entries.push_back({level.name, "level"});
    double x = 40, y = row_height;
    for (Entry& entry : entries) {
      const double needed = 46 + text_width(entry.name);
      if (x > 40 && x + needed > width - 8) {
        x = 40;
        y += row_height;
      }
      entry.x = x;
      entry.y = y;
      x += needed;
    }
    if (!entries.empty()) bottom = y + 10;
  }
  void draw(Svg& svg) const {
    for (const Entry& entry : entries) {
      svg.segment(entry.style.c_str(), entry.x, entry.y - 4, entry.x + 26, entry.y - 4);
      svg.words(entry.x + 31, entry.y, "start", entry.name);
    }
  }
};

std::vector<double> values_of(const LineChart& chart, bool of_x) {
  std::vector<double> values;
  for (const Line& line : chart.lines) {
    const Vector& v = of_x ? line.x : line.y;
    values.insert(values.end(), v.data(), v.data() + v.size());
  }
  if (!of_x)
    for (const Level& level : chart.levels) values.push_back(level.value);
  return values;
}

/// Time axes end where time does.
Range whole_range(const std::vector<double>& values) {
  Range range{INFINITY, -INFINITY};
  for (const double v : values) {
    range.lo = std::min(range.lo, v);
    range.hi = std::max(range.hi, v);
  }
  return range.lo < range.hi ? range : range_of(values);
}

/// The path of a curve; points that an axis cannot show are gaps.
std::string path_of(const Line& line, const Scale& x, const Scale& y, bool positive) {
  std::string path;
  bool drawn = false;
  double before = 0;
  for (const Index j :
       line.orbit ? thinned_orbit(line.x, line.y, curve_buckets) : thinned(line.x, line.y, curve_buckets)) {
    const bool shown = std::isfinite(line.y[j]) && (!positive || line.y[j] > 0);
    if (shown) {
      const double at = x(line.x[j]), up = y(line.y[j]);
      if (drawn && line.steps) fmt::format_to(std::back_inserter(path), "L{:.1f} {:.1f}", before, up);
      fmt::format_to(std::back_inserter(path), "{}{:.1f} {:.1f}", drawn ? 'L' : 'M', at, up);
      before = at;
    }
    drawn = shown;
  }
  return path;
}

void draw_marks(Svg& svg, const Line& line, std::size_t number, const Scale& x, const Scale& y, bool positive) {
  for (Index j = 0; j < line.x.size(); ++j)
    if (std::isfinite(line.y[j]) && (!positive || line.y[j] > 0))
      svg.add(R"(<circle class="mark m{}" cx="{:.1f}" cy="{:.1f}" r="3"/>)", number, x(line.x[j]), y(line.y[j]));
}

}  // namespace

std::string line_chart(const LineChart& chart) {
  const Legend legend(chart);
  const double top = legend.bottom + 4, bottom = top + height;
  const Range xs = chart.x.logarithmic ? range_of(values_of(chart, true), true) : whole_range(values_of(chart, true));
  const Range ys = range_of(values_of(chart, false), chart.y.logarithmic);
  const Scale y(ys.lo, ys.hi, bottom, top, chart.y.logarithmic);
  const std::vector<Tick> ticks = y.ticks(5);
  const double left = left_margin(ticks);
  const Scale x(xs.lo, xs.hi, left, width - right_margin, chart.x.logarithmic);
  Svg svg(chart.title, bottom + below_axis);
  draw_x_axis(svg, x, top, bottom, chart.x.text);
  draw_y_axis(svg, y, ticks, left, x.to(), chart.y.text);
  svg.add(R"(<rect class="frame" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", left, top, x.to() - left,
          height);
  for (const Level& level : chart.levels) svg.segment("level", left, y(level.value), x.to(), y(level.value));
  for (std::size_t i = 0; i < chart.lines.size(); ++i) {
    const Line& line = chart.lines[i];
    svg.add(R"(<path class="line s{}" d="{}"><title>{}</title></path>)", i, path_of(line, x, y, chart.y.logarithmic),
            escaped(line.name));
    if (line.marks) draw_marks(svg, line, i, x, y, chart.y.logarithmic);
  }
  legend.draw(svg);
  return svg.end();
}

// ---- heat maps ----

namespace {

constexpr Index map_columns = 310, most_bands = 115;  ///< cells of about two pixels

/// Runs of equal shade in all bands, one path for each shade; the first band lies at the bottom.
void draw_cells(Svg& svg, const RowMatrix& cells, const Range& range, const HeatMap& map) {
  std::vector<std::string> paths(map.marked ? std::size_t(1) : std::size_t(shade_count));
  const auto shade = [&](double value) -> Index {
    if (std::isnan(value)) return -1;
    if (map.marked) return value > 0 ? 0 : -1;
    const double part = (value - range.lo) / (range.hi - range.lo);
    return std::clamp<Index>(Index(part * double(shade_count)), 0, shade_count - 1);
  };
  for (Index i = 0; i < cells.rows(); ++i)
    for (Index k = 0; k < cells.cols();) {
      const Index s = shade(cells(i, k));
      const Index begin = k;
      while (k < cells.cols() && shade(cells(i, k)) == s) ++k;
      if (s >= 0)
        fmt::format_to(std::back_inserter(paths[std::size_t(s)]), "M{} {}h{}", begin, cells.rows() - 1 - i, k - begin);
    }
  for (std::size_t s = 0; s < paths.size(); ++s) {
    if (paths[s].empty()) continue;
    if (map.marked)
      svg.add(R"(<path class="on" d="{}"/>)", paths[s]);
    else
      svg.add(R"(<path stroke="{}" d="{}"/>)", shades[s], paths[s]);
  }
}

/// The scale of colours, at the right.
void draw_colours(Svg& svg, const Range& range, double top, double bottom, const std::string& label) {
  const double left = width - 92, cell = (bottom - top) / double(shade_count);
  for (Index s = 0; s < shade_count; ++s)
    svg.add(R"(<rect x="{:.1f}" y="{:.2f}" width="14" height="{:.2f}" fill="{}"/>)", left,
            bottom - double(s + 1) * cell, cell + 0.3, shades[s]);
  const Scale scale(range.lo, range.hi, bottom, top);
  for (const Tick& tick : scale.ticks(5)) svg.words(left + 19, scale(tick.value) + 4, "start", tick.label);
  svg.words(width - 4, top - 8, "end", label, R"( class="label")");
}

Range map_range(const RowMatrix& cells) {
  Range range{INFINITY, -INFINITY};
  for (const double v : cells.reshaped())
    if (std::isfinite(v)) range = {std::min(range.lo, v), std::max(range.hi, v)};
  if (apart(range.lo, range.hi)) return range;
  return std::isfinite(range.lo) ? Range{range.lo, range.lo == 0 ? 1 : range.lo + std::abs(range.lo)} : Range{0, 1};
}

}  // namespace

std::string heat_map(const HeatMap& map) {
  const double top = map.marked ? 10 : 26, bottom = top + height;
  const double last = double(map.values.cols() - 1);
  const RowMatrix cells = on_cells(map.t, map.values, map_columns, most_bands);
  const Range range = map_range(cells);
  // Components lie at the middles of their bands.
  const Scale y(-0.5, last + 0.5, bottom, top);
  std::vector<Tick> ticks;
  for (Tick& tick : Scale(0, std::max(1., last), bottom, top).ticks(5))
    if (tick.value == std::floor(tick.value) && tick.value <= last) ticks.push_back(std::move(tick));
  if (!map.rows.empty())
    for (Tick& tick : ticks) tick.label = short_number(map.rows[std::size_t(tick.value)]);
  const double left = left_margin(ticks), right = map.marked ? width - right_margin : width - 106;
  const Range xs = whole_range({map.t.data(), map.t.data() + map.t.size()});
  const Scale x(xs.lo, xs.hi, left, right);
  Svg svg(map.title, bottom + below_axis);
  draw_x_axis(svg, x, bottom, bottom + 4, map.x);
  for (const Tick& tick : ticks) {
    svg.segment("grid", left - 4, y(tick.value), left, y(tick.value));
    svg.words(left - 7, y(tick.value) + 4, "end", tick.label);
  }
  svg.upward((top + bottom) / 2, map.y);
  svg.add(R"x(<g class="cells" transform="translate({:.2f} {:.3f}) scale({:.5f} {:.5f})">)x", left,
          top + 0.5 * height / double(cells.rows()), (right - left) / double(map_columns),
          height / double(cells.rows()));
  draw_cells(svg, cells, range, map);
  svg.add("</g>");
  svg.add(R"(<rect class="frame" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", left, top, right - left,
          height);
  if (!map.marked) draw_colours(svg, range, top, bottom, map.value);
  return svg.end();
}

// ---- bars ----

namespace {

double widest_of(const std::vector<std::string>& names) {
  double widest = 0;
  for (const std::string& name : names) widest = std::max(widest, text_width(name));
  return widest;
}

}  // namespace

std::string time_bars(const TimeBars& chart) {
  constexpr double thin = 1.5;  ///< of a bar: a single row is seen
  const double top = 8, row = 20, bottom = top + row * double(chart.names.size());
  const double left = 14 + widest_of(chart.names);
  const Scale x(chart.first, chart.last, left, width - right_margin);
  Svg svg(chart.title, bottom + below_axis);
  draw_x_axis(svg, x, top, bottom, chart.x);
  for (std::size_t i = 0; i < chart.names.size(); ++i) {
    const double y = top + row * double(i);
    svg.words(left - 6, y + 14, "end", chart.names[i]);
    const auto draw = [&](const char* style, const std::vector<std::pair<double, double>>& bars) {
      for (const auto& [from, to] : bars)
        svg.add(R"(<rect class="{}" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", style, x(from), y + 4,
                std::max(thin, x(to) - x(from)), row - 8);
    };
    if (!chart.light.empty()) draw("bar light", chart.light[i]);
    draw("bar", chart.bars[i]);
    if (!chart.ticks.empty())
      for (const double t : chart.ticks[i]) svg.segment("tick", x(t), y + 1, x(t), y + row - 1);
  }
  svg.add(R"(<rect class="frame" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", left, top, x.to() - left,
          bottom - top);
  return svg.end();
}

std::string number_bars(const NumberBars& chart) {
  std::vector<double> values;
  std::vector<std::string> names;
  for (const auto& [name, value] : chart.bars) {
    values.push_back(value);
    names.push_back(name);
  }
  for (const Level& level : chart.levels) values.push_back(level.value);
  Range range = range_of(values, true);
  range.lo /= 10;  // the smallest is seen, too
  const double top = 26, row = 24, bottom = top + row * double(names.size()), left = 14 + widest_of(names);
  const Scale x(range.lo, range.hi, left, width - 90, true);
  Svg svg(chart.title, bottom + below_axis);
  draw_x_axis(svg, x, top, bottom, chart.x);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double y = top + row * double(i), end = values[i] > 0 ? x(values[i]) : left;
    svg.words(left - 6, y + 16, "end", names[i]);
    svg.add(R"(<rect class="bar" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", left, y + 5, end - left,
            row - 10);
    svg.words(x.to() + 6, y + 16, "start", short_number(values[i], 3), R"( class="value")");
  }
  for (const Level& level : chart.levels) {
    svg.segment("level", x(level.value), top, x(level.value), bottom);
    svg.words(x(level.value), top - 8, "middle", level.name);
  }
  svg.add(R"(<rect class="frame" x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}"/>)", left, top, x.to() - left,
          bottom - top);
  return svg.end();
}

std::string parts_of_whole(const std::string& title, const std::vector<double>& parts) {
  double whole = 0;
  for (const double part : parts) whole += part;
  Svg svg(title, 34);
  double x = 4;
  for (std::size_t i = 0; i < parts.size() && whole > 0; ++i) {
    const double length = (width - 8) * parts[i] / whole;
    if (length >= 0.2)
      svg.add(R"(<rect class="part part-{}" x="{:.1f}" y="4" width="{:.1f}" height="26"/>)", i, x, length);
    x += length;
  }
  return svg.end();
}

}  // namespace bromwich::report
