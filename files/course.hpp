#pragma once
// Values over a piece [a, b] of time: at both ends, and ranges that contain all values and slopes between them.
//
// An operation that switches has several branches, called ways, selected by a quantity s: 0 for s < 0 and 1 for s > 0,
// or the whole number to which s is rounded. On one way the operation is smooth.

#include "files/operation.hpp"
#include "files/range.hpp"

namespace bromwich {

struct Course {
  double left = 0, right = 0;  ///< at a and at b
  Range value, slope;
};

Course constant(double value);

/// For an operation that switches: on one way. `width` = b - a.
Course apply(Operation, const Course&, double width);
Course apply(Operation, const Course&, const Course&, double width);
Course apply_on(Operation, double way, const Course& a, const Course& b, double width);
double apply_on(Operation, double way, double a, double b);

/// s, and the way of the operation, a number that increases with s. An operation on one number does not use b.
double switching(Operation, double a, double b);
Course switching(Operation, const Course& a, const Course& b, double width);
double way_of(Operation, double a, double b);

/// s at which a way ends and the next one begins.
double end_of(Operation, double way);
/// Whether all s of this range have the same way.
bool one_way(Operation, Range s);

}  // namespace bromwich
