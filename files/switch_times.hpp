#pragma once
// The times at which an expression may jump or have a kink: one of its operations switches, such as sign, a comparison,
// abs, max or floor.
//
// An operation switches where a quantity s crosses a level: 0, or the whole numbers. Over a piece of [0, T] ranges
// contain all values of s and of its slope (files/range.hpp). There is no switch inside if the range excludes it, or if
// s is monotone and has the same way at both ends. If the ends differ, the change is located to the last bit and the
// piece is divided there; otherwise it is halved. So pulses of any width and oscillations of any frequency are found,
// up to the limit of work.

#include "files/formula.hpp"

#include <vector>

namespace bromwich {

struct SwitchTimes {
  /// In [0, T], increasing; at each of them the expression has its right limit. 0 and T are included if the values
  /// there differ from the adjacent limits.
  std::vector<double> times;
  bool complete = true;  ///< false: the limit of work was reached before all of [0, T] was searched
};

/// `work`: allowed number of evaluations; the unused part is written back.
SwitchTimes switch_times(const Formula& formula, double T, long& work);

}  // namespace bromwich
