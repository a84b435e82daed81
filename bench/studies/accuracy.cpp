#include "bench/studies/accuracy.hpp"

#include "app/scene_choice.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace bromwich::app {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

Result fine_march(const Scene& scene, Backend& backend, Index steps) {
  check_memory(scene, steps, 0);
  Options options;
  options.method = Method::march;
  options.steps = steps;
  options.trace = true;
  Result result = solve(scene, backend, options);
  if (result.status != Status::solved)
    throw Error("SCENE",
                fmt::format("the reference solution of {} with {} steps ended as {} ({})", scene.name, steps,
                            to_string(result.status), result.reason),
                "compare methods on another scene or with other parameters");
  return result;
}

Errors between(const Result& result, const RowMatrix& y, const RowMatrix& trace) {
  return {deviation(result.y, y), deviation(result.trace, trace)};
}

Errors against_exact(const Scene& scene, const Result& result) {
  const Index J = result.y.rows() - 1, n = scene.constraints();
  RowMatrix y(J + 1, n), trace(J + 1, n);
  Vector x(scene.states()), exact(n);
  for (Index j = 0; j <= J; ++j) {
    scene.exact(scene.T * double(j) / double(J), x, exact);
    y.row(j) = exact.transpose();
    trace.row(j) = observe(scene.dynamics, x).transpose();
  }
  return between(result, y, trace);
}

}  // namespace

Deviation deviation(const RowMatrix& values, const RowMatrix& reference) {
  if (values.rows() < 2 || values.rows() != reference.rows() || values.cols() != reference.cols()) return {nan, nan};
  const Index first = (values.rows() - 1 + 15) / 16;
  const auto difference = (values - reference).bottomRows(values.rows() - first);
  const double squares = difference.squaredNorm();
  // The sum propagates a NaN, the maximum need not.
  if (!std::isfinite(squares)) return {nan, nan};
  return {difference.lpNorm<Eigen::Infinity>(), std::sqrt(squares / double(difference.size()))};
}

RowMatrix common_rows(const RowMatrix& values, Index stride) {
  if (values.rows() == 0) return values;
  return values(Eigen::seq(0, values.rows() - 1, stride), Eigen::all);
}

Truth::Truth(const Scene& scene, Backend& backend, Index steps) : scene_(scene), source_("the exact solution") {
  if (scene.exact) return;
  Result fine = fine_march(scene, backend, steps);
  y_ = std::move(fine.y);
  trace_ = std::move(fine.trace);
  source_ = fmt::format("march with {} steps", steps);
  known_to_ = of(fine_march(scene, backend, steps / 2));
}

Errors Truth::of(const Result& result) const {
  const Index J = result.y.rows() - 1;
  if (J < 1) return {{nan, nan}, {nan, nan}};
  if (scene_.exact) return against_exact(scene_, result);
  if (J % steps() == 0) {
    const Index stride = J / steps();
    return {deviation(common_rows(result.y, stride), y_), deviation(common_rows(result.trace, stride), trace_)};
  }
  if (steps() % J != 0)
    throw Error("--steps", fmt::format("{} do not divide the {} of the reference", J, steps()),
                "use a power of two times the benchmark's own steps");
  return between(result, common_rows(y_, steps() / J), common_rows(trace_, steps() / J));
}

}  // namespace bromwich::app
