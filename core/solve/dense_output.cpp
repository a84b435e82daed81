#include "core/solve/dense_output.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/states.hpp"
#include "core/kernel/step_defects.hpp"
#include "core/result/located.hpp"
#include "core/result/located_solution.hpp"
#include "core/scene/breakpoints.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/solve/adapted_march.hpp"
#include "core/solve/dense_steps.hpp"
#include "core/solve/given_steps.hpp"
#include "core/solve/mixed.hpp"
#include "core/solve/reductions.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

Vector y_at(const RowMatrix& y, const Place& at) {
  if (at.part == 0) return y.row(at.row).transpose();
  return ((1 - at.part) * y.row(at.row) + at.part * y.row(at.row + 1)).transpose();
}

// The integral of y from the time point before. y_0 may be open.
Vector over_part(const RowMatrix& y, const Place& at, double h) {
  if (at.part == 0) return Vector::Zero(y.cols());
  const Vector end = y_at(y, at), begin = y.row(at.row).transpose();
  return at.part * h * (begin.allFinite() ? Vector((begin + end) / 2) : Vector(y.row(at.row + 1).transpose()));
}

// One step of the length that is left, from x_j as its initial state.
Vector carried(const Scene& scene, Backend& backend, const RowMatrix& y, const Vector& x, double t, double s,
               const Place& at) {
  RowMatrix ends(2, y.cols());
  ends << y.row(at.row), y_at(y, at).transpose();
  return states_at_rows(discretise(part_of(scene, t, s, x), backend, 1), ends, {1}).col(0);
}

// The whole state at the time points before the places between them, one column for each place.
Matrix states_before(const Scene& scene, Backend& backend, const Result& result, const std::vector<Place>& places) {
  std::vector<Index> rows;
  for (const Place& at : places) rows.push_back(at.row);
  if (Index(result.x_components.size()) == scene.states()) return result.x(rows, Eigen::all).transpose();
  return states_at_rows(discretise(scene, backend, result.steps), result.y, rows, result.defects.get());
}

// Whether y is no line between a row and the next: the active set changes there, a source jumps or has a kink, or the
// step was taken in parts. Small states can be stepped everywhere.
class Bends {
 public:
  Bends(const Result& result, const std::vector<double>& breakpoints, double T, bool everywhere)
      : result_(result), h_(T / double(result.steps)), breaks_(breakpoints), everywhere_(everywhere) {}

  bool inside(Index row) const {
    if (everywhere_) return true;
    if (((result_.y.row(row).array() > 0) != (result_.y.row(row + 1).array() > 0)).any()) return true;
    const auto next = std::lower_bound(breaks_.begin(), breaks_.end(), double(row) * h_);
    if (next != breaks_.end() && *next <= double(row + 1) * h_) return true;
    return result_.defects && std::binary_search(result_.defects->steps.begin(), result_.defects->steps.end(), row + 1);
  }

 private:
  const Result& result_;
  double h_;
  const std::vector<double>& breaks_;
  bool everywhere_;
};

// y and x of a result with continuous y, of its time points and between them.
void sample(const Scene& given, Backend& backend, const Result& result, const std::vector<Place>& places,
            Result& sampled) {
  const Scene scene = on_grid(places) ? given : with_all_breakpoints(given);
  const double h = scene.T / double(result.steps);
  const Bends bends(result, scene.breakpoints, scene.T, scene.dynamics->small_state() != nullptr);
  Index valid = 1;  // rows of y that are; y_0 may be open where the rest is known
  while (valid < result.y.rows() && result.y.row(valid).allFinite()) ++valid;
  std::vector<Index> between;
  std::vector<Place> there;
  for (Index k = 0; k < Index(places.size()); ++k) {
    const Place& at = places[std::size_t(k)];
    sampled.y.row(k) = y_at(result.y, at).transpose();
    sampled.y_integral.row(k) = over_part(result.y, at, h).transpose();
    if (at.part == 0) {
      sampled.x.row(k) = result.x.row(at.row);
    } else if (at.row + 1 < valid && (sampled.x.cols() > 0 || bends.inside(at.row))) {
      between.push_back(k);
      there.push_back(at);
    }
  }
  if (between.empty()) return;
  const Matrix before = states_before(scene, backend, result, there);
  RowsBetween rows(scene, backend, h);
  for (std::size_t i = 0; i < between.size(); ++i) {
    check_interruption();
    const Place& at = there[i];
    const double t = double(at.row) * h, s = at.part * h;
    if (bends.inside(at.row) &&
        rows.take(t, before.col(Index(i)), result.y.row(at.row).transpose(), s, between[i], sampled))
      continue;
    const Vector x = carried(scene, backend, result.y, before.col(Index(i)), t, s, at);
    sampled.x.row(between[i]) = x(result.x_components);
    if (sampled.trace.cols() > 0) sampled.trace.row(between[i]) = observe(scene.dynamics, x).transpose();
  }
}

// The result with all states at its time points; it is solved again where they were not recorded.
Result with_all_states(const Scene& scene, Backend& backend, const Result& result) {
  if (Index(result.x_components.size()) == scene.states()) return result;
  constexpr double most_bytes = 4e9;
  if (const double bytes = sizeof(double) * double(result.steps + 1) * double(scene.states()); bytes > most_bytes)
    throw Error("times", text("the state at all time points takes %.1f GB", bytes / 1e9),
                text("ask for multiples of T/%td, or for fewer steps", result.steps), ErrorKind::does_not_fit);
  InnerOptions options;
  options.method = result.method;
  options.steps = result.steps;
  options.states = StateSelection::all;
  options.confirm = false;
  return solve_on_steps(scene, backend, options);
}

// Rows at these times, still unknown.
Result rows_at(const std::vector<double>& times, const Result& result) {
  Result rows = result;
  const Index count = Index(times.size());
  rows.t = Eigen::Map<const Vector>(times.data(), count);
  rows.y = rows.y_integral = RowMatrix::Constant(count, result.y.cols(), NAN);
  rows.x = RowMatrix::Constant(count, Index(result.x_components.size()), NAN);
  rows.trace = RowMatrix::Constant(count, result.trace.cols(), NAN);
  return rows;
}

bool any_inside(const std::vector<double>& times, double begin, double end) {
  const auto next = std::upper_bound(times.begin(), times.end(), begin);
  return next != times.end() && *next < end;
}

// Method galerkin: values at nodes are those of the result. The states between them begin at the node before. Where
// sources jump in an interval or an active set changes, y is no line there: a march goes on from the node.
void sample_intervals(const Scene& given, Backend& backend, const Result& result, Result& sampled) {
  std::vector<Index> between;
  std::vector<double> there;
  for (Index k = 0; k < sampled.t.size(); ++k) {
    const Index node = node_at(result.t, sampled.t[k]);
    if (node < 0) {
      between.push_back(k);
      there.push_back(sampled.t[k]);
      continue;
    }
    sampled.y.row(k) = result.y.row(node);
    sampled.y_integral.row(k).setZero();
    if (result.x.rows() > node) sampled.x.row(k) = result.x.row(node);
    if (result.trace.rows() > node) sampled.trace.row(k) = result.trace.row(node);
  }
  if (between.empty()) return;
  const Scene scene = with_all_breakpoints(given);
  Result whole = with_all_states(scene, backend, result);
  if (whole.t.size() != result.t.size() || whole.t != result.t) whole = result;
  const bool known = Index(whole.x_components.size()) == scene.states() && whole.x.rows() == whole.t.size();
  const GalerkinOutput output = galerkin_at(scene, whole, there);
  RowsBetween rows(scene, backend, scene.T / double(result.t.size() - 1));
  for (std::size_t i = 0; i < between.size(); ++i) {
    check_interruption();
    const Index k = interval_at(result.t, there[i]);
    sampled.y.row(between[i]) = output.y.row(Index(i));
    sampled.y_integral.row(between[i]) = output.integral.row(Index(i));
    sampled.x.row(between[i]) = output.x.row(Index(i))(result.x_components);
    if (sampled.trace.cols() > 0)
      sampled.trace.row(between[i]) = observe(scene.dynamics, output.x.row(Index(i)).transpose()).transpose();
    const bool bends = any_inside(scene.breakpoints, result.t[k], result.t[k + 1]) ||
                       ((result.y_left.row(k).array() > 0) != (result.y.row(k + 1).array() > 0)).any();
    if (known && bends && scene.dynamics->small_state() && whole.x.row(k).allFinite())
      rows.take(result.t[k], whole.x.row(k).transpose(), result.y.row(k).transpose(), there[i] - result.t[k],
                between[i], sampled);
  }
}

// Between located switches: values of the polynomials, at jumps the limits from the left.
Result of_polynomials(const Scene& scene, const Result& result, const std::vector<double>& times) {
  const LocatedSolution* located = result.located.get();
  Result sampled = rows_at(times, result);
  sampled.modes = RowMatrix::Constant(sampled.t.size(), result.modes.cols(), -1);
  ScenesInModes scenes(scene);
  for (std::size_t k = 0; k < times.size(); ++k) {
    if (!located || located->pieces.empty() || times[k] > located->until * (1 + 4 * epsilon)) continue;
    const Vector x = located->x(times[k], true);
    const std::vector<Index>& modes = located->piece(times[k], true).modes;
    for (Index i = 0; i < sampled.modes.cols(); ++i) sampled.modes(Index(k), i) = double(modes[std::size_t(i)]);
    sampled.y.row(Index(k)) = located->y(times[k], true).cwiseMax(0).transpose();
    sampled.y_integral.row(Index(k)) = located->integral_of_y(times[k], true).transpose();
    sampled.x.row(Index(k)) = x(result.x_components).transpose();
    if (sampled.trace.cols() > 0)
      sampled.trace.row(Index(k)) = observe(scenes.at_row(sampled.modes, Index(k)).dynamics, x).transpose();
  }
  return sampled;
}

// Method march under a tolerance: it is marched once more, with rows at these times, which divide its steps further.
// NaN where that fails.
void sample_own_steps(const Scene& given, const InnerOptions& reduced, const Result& result, Result& sampled) {
  std::vector<double> rows(sampled.t.begin(), sampled.t.end());
  rows.insert(rows.end(), {0.0, given.T});
  for (double& t : rows) t = std::min(t, given.T);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  InnerOptions options = reduced;
  options.tolerance = result.errors->tolerance;
  options.max_steps = std::max(options.max_steps, 2 * result.errors->grids.back());
  const Scene scene = with_all_breakpoints(given);
  const auto fine = march_to_tolerance(scene, options, result.steps, result,
                                       Eigen::Map<const Vector>(rows.data(), Index(rows.size())));
  sampled.y.setConstant(NAN);
  if (!fine) {
    sampled.status = Status::tolerance_not_met;
    sampled.reason = "the march that gives rows at these times did not meet the tolerance";
  }
  for (Index k = 0; fine && k < sampled.t.size(); ++k) {
    const Index row = std::lower_bound(rows.begin(), rows.end(), std::min(sampled.t[k], scene.T)) - rows.begin();
    sampled.y.row(k) = fine->y.row(row);
    sampled.y_integral.row(k) = fine->y_integral.row(row);
    sampled.x.row(k) = fine->x.row(row);
    if (sampled.trace.cols() > 0) sampled.trace.row(k) = fine->trace.row(row);
  }
}

Result sample_reduced(const Scene& scene, Backend& backend, const InnerOptions& options, const Result& result,
                      const std::vector<double>& times);

// To the integral of y over a part of a step, that of all steps before.
void add_integral_before(const Result& result, const std::vector<Place>& places, Result& sampled) {
  const RowMatrix whole = integral_of_y(result);
  for (std::size_t k = 0; k < places.size(); ++k) sampled.y_integral.row(Index(k)) += whole.row(places[k].row);
}

// The scene without free rows, from a result of all rows: x follows from y of the others, y itself is linear in all.
Result without_free_rows(const Scene& scene, const EliminatedScene& eliminated, Backend& backend,
                         const InnerOptions& options, const Result& result, const std::vector<double>& times) {
  Result sampled = sample_reduced(eliminated.scene, backend, options, eliminated.reduced(result), times);
  const RowMatrix of_kept = sampled.y_integral;
  sampled.y.resize(Index(times.size()), result.y.cols());
  sampled.y_integral.resizeLike(sampled.y);
  sampled.trace = RowMatrix::Constant(Index(times.size()), result.trace.cols(), NAN);
  std::vector<Place> places;
  for (const double t : times) places.push_back(place(result, scene.T, t));
  for (Index k = 0; k < sampled.t.size(); ++k) {
    sampled.y.row(k) = y_at(result.y, places[std::size_t(k)]).transpose();
    sampled.y_integral.row(k) = over_part(result.y, places[std::size_t(k)], scene.T / double(result.steps)).transpose();
  }
  add_integral_before(result, places, sampled);
  if (!eliminated.kept.empty()) sampled.y_integral(Eigen::all, eliminated.kept) = of_kept;
  return sampled;
}

// Of a scene in its simplest form, solved with these options.
Result sample_reduced(const Scene& scene, Backend& backend, const InnerOptions& options, const Result& result,
                      const std::vector<double>& times) {
  const bool whole = scene.free_rows.empty() || result.method == Method::galerkin || by_steps(scene, result);
  if (const auto eliminated = whole ? std::nullopt : eliminate_free(scene))
    return without_free_rows(scene, *eliminated, backend, options, result, times);
  std::vector<Place> places;
  for (const double t : times) places.push_back(place(result, scene.T, t));
  Result sampled = rows_at(times, result);
  if (has_own_steps(result) && !on_grid(places)) {
    sample_own_steps(scene, options, result, sampled);
    return sampled;
  }
  if (result.y_left.size() > 0) {
    sample_intervals(scene, backend, result, sampled);
    sampled.y_left.resize(0, 0);
    for (std::size_t k = 0; k < times.size(); ++k) {
      const Index node = node_at(result.t, times[k]);
      places[k].row = node >= 0 ? node : interval_at(result.t, times[k]);
    }
  } else if (by_steps(scene, result)) {
    sample_by_steps(scene, backend, result, places, sampled);
  } else {
    sample(scene, backend, result, places, sampled);
  }
  add_integral_before(result, places, sampled);
  return sampled;
}

// Whether row j is at j T / steps: not so where the rows are times that a user asked for.
bool has_row(const Result& result, double T, Index j) {
  const double h = T / double(result.steps);
  return j < result.t.size() && std::abs(result.t[j] - double(j) * h) <= same_point * h;
}

void need_rows_of_steps(const Result& result, double T) {
  bool all = result.t.size() == result.steps + 1;
  for (Index j = 0; all && j <= result.steps; ++j) all = has_row(result, T, j);
  if (!all)
    throw Error("result", "has rows at times that were asked for, not at its steps", "ask the result of the solve");
}

// Rows at time points are those of the result, to the last digit.
void keep_rows(const Result& result, double T, Result& sampled) {
  const RowMatrix integral = integral_of_y(result);
  for (Index k = 0; k < sampled.t.size(); ++k) {
    Index row = -1;
    if (result.y_left.size() > 0)
      row = node_at(result.t, sampled.t[k]);
    else if (const Place at = place(result, T, sampled.t[k]); at.part == 0 && has_row(result, T, at.row))
      row = at.row;
    if (row < 0) continue;
    sampled.y.row(k) = result.y.row(row);
    sampled.y_integral.row(k) = integral.row(row);
    if (result.x.rows() > row) sampled.x.row(k) = result.x.row(row);
    if (result.trace.rows() > row) sampled.trace.row(k) = result.trace.row(row);
    if (result.modes.rows() > row) sampled.modes.row(k) = result.modes.row(row);
  }
}

}  // namespace

Result at_times(const Scene& scene, Backend& backend, const Result& result, const std::vector<double>& times) {
  if (result.goal) throw Error("result", "is of method goal", "its time points are the answer");
  for (const double t : times) place(result, scene.T, t);
  if (locates_switches(result)) {
    Result sampled = of_polynomials(scene, result, times);
    keep_rows(result, scene.T, sampled);
    return sampled;
  }
  if (result.y_left.size() == 0) need_rows_of_steps(result, scene.T);
  InnerOptions options;
  options.method = result.method;
  options.states = StateSelection::list;
  options.components = result.x_components;
  options.trace = result.trace.cols() > 0;
  const Reductions reduced(scene, options, reductions_of_scene());
  Result known = result;
  reduced.there(known);
  Result sampled = sample_reduced(reduced.scene(), backend, reduced.options(), known, times);
  reduced.back(sampled);
  if (scene.constraints() > 0) keep_rows(result, scene.T, sampled);
  return sampled;
}

}  // namespace bromwich
