#pragma once
// Numbers of a component over a span of time, columns of the table of a sweep: mean, root mean square, least and
// largest value, and ripple, the largest less the least.

#include "app/columns.hpp"
#include "catalogue/catalogue.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

enum class MeasureKind { mean, rms, min, max, ripple };

struct Measure {
  MeasureKind kind = MeasureKind::mean;
  Column column;
  std::optional<double> from, to;  ///< of the span; empty: 0 and T
  std::string name;                ///< as it was written, "mean(v)"
};

/// Words between commas outside of parentheses, without blanks: "a,mean(b,1,2)" are two.
std::vector<std::string> split_outside(const std::string&);

/// The words of --columns of a sweep: "v,mean(v),ripple(v,1e-3,2e-3)". Columns of its own go to `columns`. Times are
/// numbers or expressions of the parameters. Throws Error that names --columns.
std::vector<Measure> parse_measures(const std::string& words, const Scene&, const ParameterValues& parameters,
                                    std::vector<Column>& columns);

/// Of values at the times t, linear between them; NaN where a value of the span is not finite.
double measured(const Measure&, const Vector& t, const Vector& values);

}  // namespace bromwich::app
