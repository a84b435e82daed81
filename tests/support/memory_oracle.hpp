#pragma once
// Linear modes z' = A z that are left where a row c z rises above 0, followed mode by mode with matrix exponentials.
// Constants and sines of time are states of z.

#include "core/base/types.hpp"

#include <Eigen/Dense>

#include <cmath>
#include <functional>
#include <vector>

namespace bromwich {

/// By scaling and squaring of a Taylor polynomial: with |h A| <= 1/4 its 18 terms are exact to rounding.
inline Matrix exponential_of(Matrix A) {
  int halvings = 0;
  while (A.cwiseAbs().rowwise().sum().maxCoeff() > 0.25) A /= 2, ++halvings;
  Matrix sum = Matrix::Identity(A.rows(), A.cols()), term = sum;
  for (int k = 1; k <= 18; ++k) sum += term = term * A / k;
  for (; halvings > 0; --halvings) sum = sum * sum;
  return sum;
}

struct OracleMode {
  struct Way {
    Vector c;  ///< left where c . z > 0
    std::size_t to = 0;
    std::function<void(Vector&)> jump = {};
  };
  Matrix A;
  std::vector<Way> ways;
};

struct OracleRun {
  Vector z;
  std::size_t mode = 0;
  std::vector<double> times;       ///< of changes
  std::vector<std::size_t> modes;  ///< that begin then
};

/// From z at 0 to T. Changes are looked for in steps of T / looks, and halved to the rounding of t.
inline OracleRun run_of_modes(const std::vector<OracleMode>& modes, std::size_t mode, Vector z, double T,
                              int looks = 4096) {
  OracleRun run{std::move(z), mode, {}, {}};
  const double h = T / looks;
  for (double t = 0; t < T;) {
    const OracleMode& now = modes[run.mode];
    const double step = std::min(h, T - t);
    const Vector next = exponential_of(step * now.A) * run.z;
    const OracleMode::Way* first = nullptr;
    double at = step;
    for (const OracleMode::Way& way : now.ways) {
      if (!(way.c.dot(next) > 0)) continue;
      double low = 0, high = at;
      if (!(way.c.dot(exponential_of(at * now.A) * run.z) > 0)) continue;
      for (int k = 0; k < 60; ++k) {
        const double middle = (low + high) / 2;
        (way.c.dot(exponential_of(middle * now.A) * run.z) > 0 ? high : low) = middle;
      }
      at = high, first = &way;
    }
    run.z = first ? Vector(exponential_of(at * now.A) * run.z) : next;
    t = first ? t + at : t + step;
    if (T - t < 1e-13 * T) t = T;
    if (!first) continue;
    run.times.push_back(t);
    run.modes.push_back(first->to);
    if (first->jump) first->jump(run.z);
    run.mode = first->to;
  }
  return run;
}

}  // namespace bromwich
