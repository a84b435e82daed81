#pragma once
// The times at which an expression may jump or have a kink: where an operation of it switches, such as sign, a
// comparison, abs, max or floor.
//
// Every operation that switches does so where a quantity s passes a level: 0, or the whole numbers. Over a piece of
// [0, T] the range of s and of its slope is known to contain all values (files/range.hpp). Where that rules a change
// out, or s is monotone and switches equally at both ends, nothing happens inside; where the ends differ, a change is
// located to the last bit and the piece is cut there; otherwise it is halved. No pulse is too narrow and no frequency
// too high to be found, as long as the work lasts.

#include "files/formula.hpp"

#include <vector>

namespace bromwich {

struct SwitchTimes {
  /// In [0, T], increasing; at each of them the expression has the value from the right. 0 and T where the values there
  /// are not those beside them.
  std::vector<double> times;
  bool complete = true;  ///< false: the work ran out before all of [0, T] was looked at
};

/// `work`: evaluations that may be spent; what is left is written back.
SwitchTimes switch_times(const Formula& formula, double T, long& work);

}  // namespace bromwich
