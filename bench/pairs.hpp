#pragma once
// Two solves of one scene, and how far apart they end.

#include "core/base/error.hpp"
#include "core/result/result.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>

namespace bromwich::study {

struct Ended {
  std::string status, reason;
  Result result;
  double seconds = 0;
};

/// Of solve(); an error ends a solve, too.
template <class Solve>
Ended ended(const Solve& solve) {
  Ended e;
  const auto begin = std::chrono::steady_clock::now();
  try {
    e.result = solve();
    e.status = to_string(e.result.status), e.reason = e.result.reason;
  } catch (const Error& error) {
    e.status = "error", e.reason = error.what();
  }
  e.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return e;
}

/// Relative to the largest value; infinite if the shapes differ or only one has NaN somewhere.
inline double apart(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  double difference = 0, size = 0;
  for (Index i = 0; i < a.size(); ++i) {
    const double u = a.data()[i], v = b.data()[i];
    if (std::isnan(u) != std::isnan(v)) return INFINITY;
    if (std::isnan(u)) continue;
    difference = std::max(difference, std::abs(u - v)), size = std::max({size, std::abs(u), std::abs(v)});
  }
  return size > 0 ? difference / size : 0;
}

}  // namespace bromwich::study
