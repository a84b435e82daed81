#include "app/reference_error.hpp"

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich::app {

namespace {

/// The largest |found - known| so far, over entries where both are numbers.
void compare(double found, double known, std::optional<double>& largest) {
  if (std::isfinite(found) && std::isfinite(known)) largest = std::max(largest.value_or(0), std::abs(found - known));
}

/// t = (1 - weight) t_row + weight t_(row+1).
struct Position {
  Index row = 0;
  double weight = 0;
};

Position position(const Result& result, double t) {
  const auto behind = std::upper_bound(result.t.begin(), result.t.end(), t);
  const Index row = std::clamp<Index>(behind - result.t.begin() - 1, 0, result.t.size() - 2);
  const double weight = (t - result.t[row]) / (result.t[row + 1] - result.t[row]);
  // A time point written with fewer digits still matches.
  if (weight < 1e-6) return {row, 0};
  if (weight > 1 - 1e-6) return {row + 1, 0};
  return {row, weight};
}

double between(const RowMatrix& values, const Position& at, Index column) {
  const double left = values(at.row, column);
  return at.weight > 0 ? (1 - at.weight) * left + at.weight * values(at.row + 1, column) : left;
}

/// The whole state at one time; NaN if not known.
Vector state_at(const SceneChoice& choice, Backend& backend, const Result& result, const Position& at) {
  Vector x = Vector::Constant(choice.scene.states(), std::numeric_limits<double>::quiet_NaN());
  for (std::size_t i = 0; i < result.x_components.size(); ++i)
    x[result.x_components[i]] = between(result.x, at, Index(i));
  if (x.allFinite() || result.status != Status::solved || by_euler(result) || result.goal || choice.system) return x;
  try {
    std::vector<Index> rows{at.row};
    if (at.weight > 0) rows.push_back(at.row + 1);
    const Matrix found = states_at(choice.scene, backend, result, rows);
    x = at.weight > 0 ? Vector((1 - at.weight) * found.col(0) + at.weight * found.col(1)) : Vector(found.col(0));
  } catch (const Error&) {  // not every kernel can compute states afterwards; they are then not compared
  }
  return x;
}

bool known(const std::vector<double>& values) {
  return std::any_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); });
}

ReferenceError against_reference(const SceneChoice& choice, Backend& backend, const Result& result) {
  ReferenceError error;
  const Reference& reference = *choice.reference;
  if (!reference.t) return error;
  const Position at = position(result, *reference.t);
  for (std::size_t i = 0; i < reference.y.size(); ++i)
    compare(between(result.y, at, Index(i)), reference.y[i], error.y);
  if (!known(reference.x)) return error;
  const Vector x = state_at(choice, backend, result, at);
  for (std::size_t i = 0; i < reference.x.size(); ++i) compare(x[Index(i)], reference.x[i], error.x);
  return error;
}

ReferenceError against_exact(const Scene& scene, const Result& result) {
  ReferenceError error;
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = (result.t.size() + 14) / 16; j < result.t.size(); ++j) {  // y(0) may be undetermined
    scene.exact(result.t[j], x, y);
    for (Index i = 0; i < y.size(); ++i) compare(result.y(j, i), y[i], error.y);
    for (std::size_t i = 0; i < result.x_components.size(); ++i)
      compare(result.x(j, Index(i)), x[result.x_components[i]], error.x);
  }
  return error;
}

}  // namespace

bool has_reference(const SceneChoice& choice) { return choice.reference || choice.scene.exact; }

ReferenceError reference_error(const SceneChoice& choice, Backend& backend, const Result& result) {
  ReferenceError error;
  if (choice.reference) error = against_reference(choice, backend, result);
  if (!choice.scene.exact || (error.x && error.y)) return error;
  const ReferenceError exact = against_exact(choice.scene, result);
  return {error.x ? error.x : exact.x, error.y ? error.y : exact.y};
}

}  // namespace bromwich::app
