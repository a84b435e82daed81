#pragma once
// Values of functions of time that may be empty.

#include "core/base/time_function.hpp"

namespace bromwich {

inline Vector values_of(const TimeFunction& function, double t, Index size) {
  Vector value = Vector::Zero(size);
  if (function) function(t, value);
  return value;
}

inline double value_of(const TimeFunction& function, double t) {
  Eigen::Matrix<double, 1, 1> value(0.0);
  if (function) function(t, value);
  return value[0];
}

}  // namespace bromwich
