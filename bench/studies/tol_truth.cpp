#include "bench/studies/tol_truth.hpp"

#include "core/accuracy/magnification.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

namespace bromwich::app {

namespace {

constexpr double most_numbers = 4e7;  ///< of a reference

/// Difference of rows 1, 2, ... of `found` from rows stride, 2 stride, ... of `known`, of each component relative to
/// max(max |known|, 1e-3 of the largest component).
double error_of_rows(const RowMatrix& found, const RowMatrix& known, Index stride) {
  if (found.cols() == 0) return NAN;
  Vector error = Vector::Zero(found.cols()), size = error;
  for (Index j = 1; j < found.rows(); ++j) {
    const auto apart = (found.row(j) - known.row(stride * j)).cwiseAbs();
    if (!apart.allFinite()) return INFINITY;
    error = error.cwiseMax(apart.transpose());
    size = size.cwiseMax(known.row(stride * j).cwiseAbs().transpose());
  }
  size = size.cwiseMax(1e-3 * size.maxCoeff());
  return (error.array() > 0).select(error.cwiseQuotient(size), 0).maxCoeff();
}

/// 1/T times the integral of y from 0 on, by trapezoids.
RowMatrix mean_of_values(const RowMatrix& y) {
  RowMatrix sum = RowMatrix::Zero(y.rows(), y.cols());
  for (Index j = 1; j < y.rows(); ++j)
    sum.row(j) = sum.row(j - 1) + (y.row(j - 1) + y.row(j)) / (2 * double(y.rows() - 1));
  return sum;
}

RowMatrix mean_of(const Result& r) { return integral_of_y(r) / r.t[r.t.size() - 1]; }

Result within(double seconds, const Scene& scene, Backend& backend, Options options) {
  const auto start = std::chrono::steady_clock::now();
  options.interrupted = [start, seconds] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() > seconds;
  };
  return solve(scene, backend, options);
}

double from_values(const std::vector<double>& known, const RowMatrix& found, Index row) {
  double largest = NAN;
  for (std::size_t i = 0; i < known.size() && Index(i) < found.cols(); ++i)
    if (std::isfinite(known[i]))
      largest = std::fmax(largest,
                          std::abs(found(row, Index(i)) - known[i]) /
                              std::max(found.col(Index(i)).cwiseAbs().maxCoeff(), 1e-3 * found.cwiseAbs().maxCoeff()));
  return largest;
}

}  // namespace

void TolTruth::sample_exact(const Scene& scene, Index steps) {
  y_.resize(steps + 1, scene.constraints());
  x_.resize(steps + 1, scene.states());
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 0; j <= steps; ++j) {
    scene.exact(scene.T * double(j) / double(steps), x, y);
    y_.row(j) = y.transpose();
    x_.row(j) = x.transpose();
  }
  mean_ = mean_of_values(y_);
  source_ = "the exact solution";
}

TolTruth::TolTruth(const SceneChoice& choice, Backend& backend, const Options& options, Index finest,
                   double seconds_for_finest, double seconds)
    : finest_(finest), from_file_(NAN) {
  const Scene& scene = choice.scene;
  const double columns = 2 * double(scene.constraints()) +
                         (scene.exact || options.states == StateSelection::all ? double(scene.states()) : 0);
  if (scene.exact) {
    const Index times = Index(std::clamp(most_numbers / (columns * double(finest)), 1.0, 12.0));
    sample_exact(scene, times * finest);
    return;
  }
  Options one = options;
  one.tolerance = 0;
  for (const Index times : {12, 6}) {
    one.steps = times * finest;
    if (double(one.steps) * columns > most_numbers || double(times) * seconds_for_finest > seconds) continue;
    Result fine = within(seconds, scene, backend, one);
    if (fine.status != Status::solved) continue;
    y_ = fine.y;
    x_ = fine.x;
    mean_ = mean_of(fine);
    source_ = fmt::format("{} with {} steps", to_string(fine.method), fine.steps);
    one.steps /= 2;
    finest_ = fine.steps;
    known_to_ = of(within(seconds, scene, backend, one));
    finest_ = finest;
    if (choice.reference && choice.reference->t) {
      const Index row = Index(std::lround(*choice.reference->t / scene.T * double(fine.steps)));
      from_file_ = std::fmax(from_values(choice.reference->x, x_, row), from_values(choice.reference->y, y_, row));
    }
    return;
  }
  throw Error("SCENE", fmt::format("no reference for {} with {} steps is solved in time", scene.name, finest),
              "measure errors on another scene");
}

TolErrors TolTruth::of(const Result& result) const {
  const Index J = result.y.rows() - 1;
  if (J > finest_ || result.y.rows() != result.steps + 1) return {NAN, NAN, NAN};
  if (result.status != Status::solved && result.status != Status::tolerance_not_met) return {NAN, NAN, NAN};
  const Index stride = (y_.rows() - 1) / J;
  const RowMatrix found = mean_of(result);
  RowMatrix x(x_.rows(), Index(result.x_components.size()));
  for (Index c = 0; c < x.cols(); ++c) x.col(c) = x_.col(result.x_components[std::size_t(c)]);
  return {error_of_rows(result.y, y_, stride), error_of_rows(found, mean_, stride), error_of_rows(result.x, x, stride)};
}

}  // namespace bromwich::app
