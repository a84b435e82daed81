#include "app/result_check.hpp"

#include "report/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

namespace bromwich::app {

namespace {

using report::Json;

constexpr double complementary = 1e-6;  ///< relative to the largest w: what a file without a status may miss

class Lines {
 public:
  void add(const std::string& label, const std::string& words) {
    if (!words.empty()) text_ += fmt::format("{:<12}{}\n", label, words);
  }
  std::string text() const { return text_; }

 private:
  std::string text_;
};

std::string range(const report::Quantity& q) {
  const auto finite = q.values.array().isFinite();
  if (!finite.any()) return fmt::format("{} columns without a value", q.names.size());
  const double least = finite.select(q.values, INFINITY).minCoeff(),
               most = finite.select(q.values, -INFINITY).maxCoeff();
  const std::string unit = q.units.empty() || q.units.front().empty() ? "" : " " + q.units.front();
  return fmt::format("{} column{}, between {:.6g} and {:.6g}{}", q.names.size(), q.names.size() == 1 ? "" : "s", least,
                     most, unit);
}

/// max |min(y, w)| over rows and columns, relative to max(1, |w|); NaN without w.
double complementarity(const report::ResultTable& table) {
  const report::Quantity *y = table.find("y"), *w = table.find("w");
  if (!y || !w || y->values.cols() != w->values.cols()) return NAN;
  double worst = 0, size = 1;
  for (Index j = 0; j < y->values.rows(); ++j)
    for (Index i = 0; i < y->values.cols(); ++i) {
      const double smaller = std::min(y->values(j, i), w->values(j, i));
      if (!std::isfinite(smaller)) continue;
      worst = std::max(worst, std::abs(smaller));
      size = std::max(size, std::abs(w->values(j, i)));
    }
  return worst / size;
}

}  // namespace

bool names_result(const std::string& name) {
  const std::string extension = std::filesystem::path(name).extension().string();
  return extension == ".h5" || extension == ".hdf5" || extension == ".nc" || extension == ".npz" ||
         extension == ".csv" || extension == ".vtkhdf";
}

ResultCheck check_result(const std::string& name, const report::ResultTable& table) {
  const Json summary = Json::parse(table.summary, nullptr, false);
  const Index rows = table.t.size();
  const std::string unit = table.time_unit.empty() ? "" : " " + table.time_unit;
  Lines lines;
  lines.add("file", rows > 0 ? fmt::format("{}: {} rows, t from {:.6g} to {:.6g}{}", name, rows, table.t[0],
                                           table.t[rows - 1], unit)
                             : fmt::format("{}: no rows", name));
  lines.add("scene", report::text_at(summary, "scene"));
  const std::string status = report::text_at(summary, "status");
  lines.add("status", status.empty() ? "not in the file" : status);
  if (!status.empty()) lines.add("", report::status_sentence(summary));
  if (!table.remark.empty()) lines.add("", "The file says: " + table.remark);
  lines.add("warning", report::text_at(summary, "warning"));
  lines.add("method", report::text_at(summary, "method"));
  for (const report::Quantity& q : table.quantities) lines.add(q.symbol.empty() ? "others" : q.symbol, range(q));
  const double missed = complementarity(table);
  if (!std::isnan(missed)) lines.add("rows", fmt::format("largest |min(y, w)| {:.2e}, relative to max(1, w)", missed));
  if (summary.is_object())
    for (const report::Certificate& c : report::certificates(summary))
      lines.add("", fmt::format("{}: {}, {}", c.name, c.value, c.meaning));
  const bool ended_early = !table.remark.empty();
  return {lines.text(), status.empty() ? rows > 0 && !ended_early && !(missed > complementary) : status == "solved"};
}

}  // namespace bromwich::app
