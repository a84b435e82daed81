#include "core/result/result.hpp"

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

namespace {

// The integral of y over the step to row j.
RowMatrix::RowXpr::PlainObject step_integral(const Result& r, Index j) {
  const double h = r.t[j] - r.t[j - 1];
  if (r.y_left.rows() >= j) {
    const IntervalRule rule = r.interval_rules.empty() ? IntervalRule::galerkin : r.interval_rules[std::size_t(j) - 1];
    const double left = rule == IntervalRule::galerkin ? 0.5 : rule == IntervalRule::radau ? 0.75 : 0;
    return h * (left * r.y_left.row(j - 1) + (1 - left) * r.y.row(j));
  }
  const bool linear = r.continuous && !by_euler(r) && r.y.row(j - 1).allFinite();
  if (linear) return h / 2 * (r.y.row(j - 1) + r.y.row(j));
  return h * r.y.row(j);
}

}  // namespace

RowMatrix integral_of_y(const Result& r) {
  if (r.y_integral.size() > 0) return r.y_integral;
  RowMatrix sum = RowMatrix::Zero(r.y.rows(), r.y.cols());
  for (Index j = 1; j < sum.rows() && sum.cols() > 0; ++j) sum.row(j) = sum.row(j - 1) + step_integral(r, j);
  return sum;
}

Result with_idle_constraint(Result result) {
  result.y = RowMatrix::Zero(result.t.size(), 1);
  return result;
}

void add_warning(Result& result, const std::string& sentence) {
  if (result.warning.find(sentence) != std::string::npos) return;
  if (!result.warning.empty()) result.warning += "; ";
  result.warning += sentence;
}

double ErrorEstimate::total() const {
  return discretisation + (std::isnan(kernel) ? 0 : kernel) + iteration + rounding;
}

void Seconds::add_around(double before, double behind) {
  setup += before;
  solve += behind;
  other += behind;
  total += before + behind;
}

Seconds operator+(const Seconds& a, const Seconds& b) {
  return {a.total + b.total,
          a.setup + b.setup,
          a.solve + b.solve,
          a.lcp + b.lcp,
          a.convolution + b.convolution,
          a.transform + b.transform,
          a.other + b.other,
          a.sweeps + b.sweeps,
          a.certification + b.certification};
}

}  // namespace bromwich
