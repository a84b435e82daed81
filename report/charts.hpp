#pragma once
// Pictures as SVG text, to stand inside an HTML page whose style sheet (page.css) has their colours. Every picture has
// labelled axes; curves differ by dashes as well as by colour.

#include "core/base/types.hpp"

#include <string>
#include <utility>
#include <vector>

namespace bromwich::report {

struct AxisLabel {
  std::string text;
  bool logarithmic = false;
};

struct Line {
  std::string name;
  Vector x, y;         ///< NaN: a gap
  bool steps = false;  ///< constant from point to point, with the value of the right one
  bool marks = false;  ///< a mark on every point
  bool orbit = false;  ///< x does not ascend
};

/// A horizontal line with a name.
struct Level {
  double value = 0;
  std::string name;
};

struct LineChart {
  std::string title;  ///< read out in place of the picture
  AxisLabel x, y;
  std::vector<Line> lines;  ///< at most `most_lines`
  std::vector<Level> levels;
};
inline constexpr std::size_t most_lines = 8;

std::string line_chart(const LineChart&);

/// Values over time (across) and a component number (up).
struct HeatMap {
  std::string title;
  std::string x, y, value;  ///< labels of the axes and of the scale of colours
  Vector t;
  RowMatrix values;               ///< t.size() x components
  bool marked = false;            ///< only whether a value is above 0
  std::vector<double> rows = {};  ///< what the components stand for, in place of their numbers
};
std::string heat_map(const HeatMap&);

/// Times in which something is on, one row for each name.
struct TimeBars {
  std::string title, x;
  double first = 0, last = 1;
  std::vector<std::string> names;
  std::vector<std::vector<std::pair<double, double>>> bars;        ///< from, to
  std::vector<std::vector<std::pair<double, double>>> light = {};  ///< where it is on in another way
  std::vector<std::vector<double>> ticks = {};                     ///< times
};
std::string time_bars(const TimeBars&);

/// Positive numbers on a logarithmic axis, and a number to compare with.
struct NumberBars {
  std::string title, x;
  std::vector<std::pair<std::string, double>> bars;
  std::vector<Level> levels;  ///< vertical lines here
};
std::string number_bars(const NumberBars&);

/// Parts of a whole, one beside the other; part i has the colours of class `part-i`.
std::string parts_of_whole(const std::string& title, const std::vector<double>& parts);

}  // namespace bromwich::report
