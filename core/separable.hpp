#pragma once
// Sources that are sums of a few fixed shapes, each times a function of time:
//
//     s(t) = V a(t),      V: width x k,   a: k functions of t.
//
// A TimeFunction that holds one is recognised, and its table over time is made from V without a call for each entry.

#include "types.hpp"

namespace bromwich {

struct SeparableSource {
  Matrix shapes;      ///< V
  TimeFunction time;  ///< a, k values

  void operator()(double t, Eigen::Ref<Vector> value) const;
};

/// s(t_j) as rows.
RowMatrix sample(const SeparableSource&, const Vector& t);

}  // namespace bromwich
