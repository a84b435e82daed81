#pragma once
// One HTML page on a result: self-contained, without scripts, for screens in light and dark and for paper.

#include "report/result_table.hpp"
#include "report/words.hpp"

#include <string>

namespace bromwich::report {

struct Report {
  Json summary;  ///< as `bromwich solve --json` prints it; null if there is none
  ResultTable table;
  std::string source;  ///< the file that was read, or the command line
  std::string version;
};

std::string page(const Report&);

/// The times from and to of every run of rows with y above `zero`. A run reaches from its first to its last row.
std::vector<std::pair<double, double>> active_times(const Vector& t, const Eigen::Ref<const Vector>& y, double zero);

}  // namespace bromwich::report
