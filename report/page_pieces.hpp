#pragma once
// Pieces that several parts of a page are made of.

#include "report/page.hpp"
#include "report/scale.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

namespace bromwich::report {

inline std::string number(double value) { return short_number(value, 4); }

inline std::string figure(const std::string& picture, const std::string& caption) {
  return fmt::format("<figure>\n{}<figcaption>{}</figcaption>\n</figure>\n", picture, escaped(caption));
}

inline std::string heading(const std::string& words) { return fmt::format("<h2>{}</h2>\n", escaped(words)); }

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

inline std::string with_unit(const std::string& name, const std::string& unit) {
  return unit.empty() ? name : name + " [" + unit + "]";
}

inline std::string time_label(const Report& report) { return with_unit("time t", report.table.time_unit); }

/// The unit of times on axes: thousands of that of the table, or parts of it.
inline ScaledUnit drawn_time(const Report& report) {
  const Vector& t = report.table.t;
  return with_prefix(report.table.time_unit, t.size() > 0 ? t.cwiseAbs().maxCoeff() : 1);
}

/// The unit of all columns, or "" if they differ.
inline std::string common_unit(const Quantity& q) {
  const bool same = std::adjacent_find(q.units.begin(), q.units.end(), std::not_equal_to<>()) == q.units.end();
  return same && !q.units.empty() ? q.units.front() : "";
}

inline bool is_set(const Json& summary, const char* key) {
  return summary.is_object() && summary.contains(key) && summary[key].is_boolean() && summary[key].get<bool>();
}

inline std::vector<std::string> words_at(const Json& summary, const char* key) {
  std::vector<std::string> words;
  if (summary.is_object() && summary.contains(key) && summary[key].is_array())
    for (const Json& word : summary[key])
      if (word.is_string()) words.push_back(word.get<std::string>());
  return words;
}

}  // namespace bromwich::report
