#include "core/result.hpp"

#include <cmath>

namespace bromwich {

const char* to_string(Status status) {
  switch (status) {
    case Status::solved:
      return "solved";
    case Status::tolerance_not_met:
      return "tolerance_not_met";
    case Status::infeasible:
      return "infeasible";
    case Status::unsupported:
      return "unsupported";
    case Status::nonfinite:
      return "nonfinite";
    case Status::interrupted:
      return "interrupted";
  }
  return "unknown";
}

void add_warning(Result& result, const std::string& sentence) {
  if (result.warning.find(sentence) != std::string::npos) return;
  if (!result.warning.empty()) result.warning += "; ";
  result.warning += sentence;
}

double ErrorEstimate::total() const {
  return discretisation + (std::isnan(kernel) ? 0 : kernel) + iteration + rounding;
}

Seconds operator+(const Seconds& a, const Seconds& b) {
  return {
      a.total + b.total,         a.setup + b.setup, a.solve + b.solve,  a.lcp + b.lcp, a.convolution + b.convolution,
      a.transform + b.transform, a.other + b.other, a.sweeps + b.sweeps};
}

}  // namespace bromwich
