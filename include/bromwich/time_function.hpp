#pragma once
// Vector-valued functions of time, and sums of a few fixed shapes, each times a function of time:
//
//     s(t) = V a(t),      V: width x k,   a: k functions of t.
//
// Only V and the values a(t_j) are stored; s(t_j) is formed where it is needed.

#include "types.hpp"

#include <cstddef>
#include <functional>
#include <memory>
#include <type_traits>
#include <utility>

namespace bromwich {

struct SeparableSource;

/// Writes the value at `t` into the second argument. Empty means zero.
class TimeFunction {
 public:
  TimeFunction() = default;
  TimeFunction(std::nullptr_t) {}
  template <class Function>
  requires(!std::is_base_of_v<TimeFunction, std::decay_t<Function>> &&
           !std::is_same_v<SeparableSource, std::decay_t<Function>> &&
           std::is_invocable_v<std::decay_t<Function>&, double, Eigen::Ref<Vector>>) TimeFunction(Function&& function)
      : function_(std::forward<Function>(function)) {}
  TimeFunction(SeparableSource);

  explicit operator bool() const { return bool(function_); }
  void operator()(double t, Eigen::Ref<Vector> value) const { function_(t, value); }

  /// Its shapes and their functions; null if it is not such a sum.
  const SeparableSource* separable() const { return separable_.get(); }
  /// Whether it is known to be a line between the breakpoints of its scene: a LinearSource, or a sum of such.
  bool linear() const;

 private:
  std::function<void(double t, Eigen::Ref<Vector> value)> function_;
  std::shared_ptr<const SeparableSource> separable_;
};

struct SeparableSource {
  Matrix shapes;      ///< V
  TimeFunction time;  ///< a, k values

  void operator()(double t, Eigen::Ref<Vector> value) const;
};

/// A function that is a line between the breakpoints of its scene, such as pulses and piecewise linear tables.
struct LinearSource {
  TimeFunction function;

  void operator()(double t, Eigen::Ref<Vector> value) const { function(t, value); }
};

}  // namespace bromwich
