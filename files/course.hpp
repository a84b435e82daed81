#pragma once
// Values over a piece [a, b] of time: at both ends, and ranges that contain all values and slopes between them.
//
// An operation that switches goes one of several ways, by a quantity s: 0 and 1 where s is below and above 0, or the
// whole number that s is rounded to. On one way it is smooth.

#include "files/operation.hpp"
#include "files/range.hpp"

namespace bromwich {

struct Course {
  double left = 0, right = 0;  ///< at a and at b
  Range value, slope;
};

Course constant(double value);

/// On one way where the operation switches. `width` = b - a.
Course apply(Operation, const Course&, double width);
Course apply(Operation, const Course&, const Course&, double width);
Course apply_on(Operation, double way, const Course& a, const Course& b, double width);
double apply_on(Operation, double way, double a, double b);

/// s, and the way that the operation goes, a number that grows with s. Of an operation on one number b is not used.
double switching(Operation, double a, double b);
Course switching(Operation, const Course& a, const Course& b, double width);
double way_of(Operation, double a, double b);

/// s at which a way ends and the next one begins.
double end_of(Operation, double way);
/// Whether s of this range goes one way throughout.
bool one_way(Operation, Range s);

}  // namespace bromwich
