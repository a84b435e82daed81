#include "core/solve/dense_output.hpp"

#include "core/base/error.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/states.hpp"
#include "core/scene/mass_matrix.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/mixed.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_point = 1e-9;  ///< of a step: written with fewer digits a time point still is one

/// t = t_row + part h, 0 <= part < 1.
struct Place {
  Index row;
  double part;
};

Place place(const Result& result, double T, double t) {
  if (!(t >= 0) || !(t <= T * (1 + epsilon)))
    throw Error("times", "found " + std::to_string(t), "give times from 0 to T = " + std::to_string(T));
  const double steps = t / T * double(result.steps), nearest = std::round(steps);
  if (std::abs(steps - nearest) <= same_point) return {Index(nearest), 0};
  if ((!result.continuous && result.y_left.size() == 0) || by_euler(result))
    throw Error("times", std::to_string(t) + " is no time point, and y is not linear between them",
                "ask for multiples of T/" + std::to_string(result.steps));
  return {Index(steps), steps - std::floor(steps)};
}

Vector y_at(const RowMatrix& y, const Place& at) {
  if (at.part == 0) return y.row(at.row).transpose();
  return ((1 - at.part) * y.row(at.row) + at.part * y.row(at.row + 1)).transpose();
}

// One step of the length that is left, from x_j as its initial state.
Vector carried(const Scene& scene, Backend& backend, const RowMatrix& y, const Vector& x, double t, double s,
               const Place& at) {
  RowMatrix ends(2, y.cols());
  ends << y.row(at.row), y_at(y, at).transpose();
  return states_at_rows(discretise(part_of(scene, t, s, x), backend, 1), ends, {1}).col(0);
}

// y and x of a result with continuous y, linear between its time points, or of its time points alone.
void sample(const Scene& scene, Backend& backend, const Result& result, const std::vector<Place>& places,
            Result& sampled) {
  const double h = scene.T / double(result.steps);
  Index valid = 1;  // rows of y that are; y_0 may be open where the rest is known
  while (valid < result.y.rows() && result.y.row(valid).allFinite()) ++valid;
  for (Index k = 0; k < Index(places.size()); ++k) {
    const Place& at = places[std::size_t(k)];
    sampled.y.row(k) = y_at(result.y, at).transpose();
    if (at.part == 0) {
      sampled.x.row(k) = result.x.row(at.row);
    } else if (sampled.x.cols() > 0 && at.row + 1 < valid) {
      const Vector x = states_at(scene, backend, result, {at.row}).col(0);
      sampled.x.row(k) = carried(scene, backend, result.y, x, double(at.row) * h, at.part * h, at)(result.x_components);
    }
  }
}

// The scene without free rows, from a result of all rows: x follows from y of the others, y itself is linear in all.
Result at_times(const Scene& scene, const EliminatedScene& eliminated, Backend& backend, const Result& result,
                const std::vector<double>& times) {
  Result sampled = at_times(eliminated.scene, backend, eliminated.reduced(result), times);
  sampled.y.resize(Index(times.size()), result.y.cols());
  for (std::size_t k = 0; k < times.size(); ++k)
    sampled.y.row(Index(k)) = y_at(result.y, place(result, scene.T, times[k])).transpose();
  return sampled;
}

}  // namespace

Result at_times(const Scene& scene, Backend& backend, const Result& result, const std::vector<double>& times) {
  if (result.goal) throw Error("result", "is of method goal", "its time points are the answer");
  if (const auto reduced = without_mass(scene)) return at_times(*reduced, backend, result, times);
  if (scene.dynamics->has_mass() && result.method == Method::galerkin)  // which works with dense matrices
    return at_times(written_out(scene), backend, result, times);
  if (scene.constraints() == 0) {
    Result sampled = at_times(with_idle_constraint(scene), backend, with_idle_constraint(result), times);
    sampled.y.resize(sampled.y.rows(), 0);
    return sampled;
  }
  const bool galerkin = result.method == Method::galerkin;
  if (const auto eliminated = scene.free_rows.empty() || galerkin ? std::nullopt : eliminate_free(scene))
    return at_times(scene, *eliminated, backend, result, times);
  std::vector<Place> places;
  for (const double t : times) places.push_back(place(result, scene.T, t));
  Result sampled = result;
  const Index count = Index(times.size());
  sampled.t = Eigen::Map<const Vector>(times.data(), count);
  sampled.y.resize(count, result.y.cols());
  sampled.x = RowMatrix::Constant(count, Index(result.x_components.size()), NAN);
  sampled.trace.resize(0, 0);
  sampled.y_integral.resize(0, 0);
  if (result.y_left.size() > 0) {
    const GalerkinOutput output = galerkin_at(scene, result, times);
    sampled.y = output.y;
    sampled.x = output.x(Eigen::all, result.x_components);
    sampled.y_left.resize(0, 0);
  } else {
    sample(scene, backend, result, places, sampled);
  }
  return sampled;
}

}  // namespace bromwich
