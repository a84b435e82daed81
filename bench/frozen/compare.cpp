#include "bench/frozen/compare.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <vector>

namespace bromwich::frozen {

namespace {

using nlohmann::json;

double value(const json& j) { return j.is_number() ? j.get<double>() : NAN; }

struct Counts {
  long cases = 0, same = 0, values = 0, grids = 0, statuses = 0, notices = 0;
  std::vector<double> times;  ///< of b over a
};

double median(std::vector<double> v) {
  if (v.empty()) return NAN;
  std::nth_element(v.begin(), v.begin() + long(v.size() / 2), v.end());
  return v[v.size() / 2];
}

// Estimates and notices of one side, in one line.
std::string words(const json& c) {
  std::string s = c["status"].get<std::string>() + " by " + c["method"].get<std::string>();
  for (const char* key : {"reason", "warning"})
    if (const std::string w = c[key]; !w.empty()) s += "; " + w;
  return s;
}

void print_change(const char* kind, const std::string& name, const json& a, const json& b, const std::string& more) {
  std::printf("%-7s %s%s\n    a: %s\n    b: %s\n", kind, name.c_str(), more.c_str(), words(a).c_str(),
              words(b).c_str());
}

void compare_case(const std::string& name, const json& a, const json& b, double rounding, Counts& n) {
  ++n.cases;
  const double seconds = value(a["seconds"]);
  if (seconds > 0) n.times.push_back(value(b["seconds"]) / seconds);
  if (a["status"] != b["status"]) {
    ++n.statuses;
    print_change("status", name, a, b, "");
    return;
  }
  if (a["warning"].get<std::string>().empty() != b["warning"].get<std::string>().empty()) {
    ++n.notices;
    print_change("notice", name, a, b, "");
  }
  if (a["steps"] != b["steps"]) {
    ++n.grids;
    return;
  }
  const double y = difference(a["y"], b["y"]), x = difference(a["x"], b["x"]);
  if (std::max(x, y) <= rounding) {
    ++n.same;
    return;
  }
  ++n.values;
  char size[64];
  std::snprintf(size, sizeof size, ": x %.1e, y %.1e apart", x, y);
  print_change("values", name, a, b, size);
}

}  // namespace

double difference(const json& a, const json& b) {
  if (a.size() != b.size()) return INFINITY;
  std::vector<double> largest, apart;
  for (std::size_t j = 0; j < a.size(); ++j) {
    if (a[j].size() != b[j].size()) return INFINITY;
    largest.resize(a[j].size()), apart.resize(a[j].size());
    for (std::size_t i = 0; i < a[j].size(); ++i) {
      const double p = value(a[j][i]), q = value(b[j][i]);
      if (std::isnan(p) && std::isnan(q)) continue;
      if (std::isnan(p) || std::isnan(q)) return INFINITY;
      largest[i] = std::max(largest[i], std::abs(p));
      apart[i] = std::max(apart[i], std::abs(p - q));
    }
  }
  double relative = 0;
  for (std::size_t i = 0; i < apart.size(); ++i)
    if (apart[i] > 0) relative = std::max(relative, largest[i] > 0 ? apart[i] / largest[i] : INFINITY);
  return relative;
}

bool compare(const json& a, const json& b, double rounding) {
  std::map<std::string, Counts> sets;
  long missing = 0;
  for (const auto& [name, one] : a["cases"].items()) {
    if (!b["cases"].contains(name)) {
      ++missing;
      continue;
    }
    compare_case(name, one, b["cases"][name], rounding, sets[name.substr(0, name.find('/'))]);
  }
  std::printf("\n%-10s %7s %7s %7s %7s %9s %8s %12s\n", "set", "cases", "same", "values", "grids", "statuses",
              "notices", "median b/a");
  bool same = missing == 0;
  for (const auto& [set, n] : sets) {
    std::printf("%-10s %7ld %7ld %7ld %7ld %9ld %8ld %12.2f\n", set.c_str(), n.cases, n.same, n.values, n.grids,
                n.statuses, n.notices, median(n.times));
    same = same && n.same == n.cases;
  }
  if (missing > 0) std::printf("%ld cases of a are not in b\n", missing);
  std::printf("values: differ by more than %.0e of a component's largest value, on the same grid\n", rounding);
  return same;
}

}  // namespace bromwich::frozen
