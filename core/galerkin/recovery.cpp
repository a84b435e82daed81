#include "core/galerkin/recovery.hpp"

#include "core/galerkin/rules.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_node = 1e-9;  ///< of an interval

// x(t + s) from x(t), y linear from a to b: one interval of length s.
Vector carried_state(const Scene& scene, const Vector& x, double t, double s, const Vector& a, const Vector& b) {
  Scene part = part_of(scene, t, s, x);
  part.g = {};
  const GalerkinProblem step = galerkin_problem(part, 1);
  RowMatrix z(1, a.size() + b.size());
  z << a.transpose(), b.transpose();
  return galerkin_states(step, z).row(1).transpose();
}

// The discrete problem that a result solves.
GalerkinProblem problem_of(const Scene& scene, const Result& r) {
  GalerkinProblem p = galerkin_problem(scene, grid_parts(r.t));
  return r.interval_rules.empty() ? p : mixed_problem(RuledProblems(scene, p), r.interval_rules);
}

// Those of the result where it has all of them: nodes at breakpoints are left out of a result, and its coefficients on
// longer intervals alone give other states.
RowMatrix states_at_nodes(const Scene& scene, const Result& r) {
  if (Index(r.x_components.size()) == scene.states() && r.x.rows() == r.t.size()) return r.x;
  return galerkin_states(problem_of(scene, r), galerkin_coefficients(r));
}

}  // namespace

Index interval_at(const Vector& t, double time) {
  const Index behind = Index(std::upper_bound(t.begin(), t.end(), time) - t.begin());
  return std::clamp<Index>(behind - 1, 0, t.size() - 2);
}

Index node_at(const Vector& t, double time) {
  const Index k = interval_at(t, time);
  const double part = std::clamp((time - t[k]) / (t[k + 1] - t[k]), 0.0, 1.0), nearest = std::round(part);
  return std::abs(part - nearest) <= same_node ? k + Index(nearest) : -1;
}

std::vector<GridPart> grid_parts(const Vector& t) {
  constexpr double same_length = 1e-6;
  std::vector<GridPart> parts;
  double h = 0;
  for (Index k = 0; k + 1 < t.size(); ++k) {
    const double next = t[k + 1] - t[k];
    if (parts.empty() || std::abs(next - h) > same_length * h) {
      parts.push_back({});
      h = next;
    }
    parts.back().end = t[k + 1];
    ++parts.back().intervals;
  }
  return parts;
}

RowMatrix galerkin_coefficients(const Result& r) {
  RowMatrix z(r.y_left.rows(), 2 * r.y_left.cols());
  z << r.y_left, r.y.bottomRows(r.y_left.rows());
  return z;
}

GalerkinOutput galerkin_at(const Scene& scene, const Result& r, const std::vector<double>& times) {
  const Index n = r.y_left.cols(), rows = Index(times.size());
  if (!r.y_left.row(0).allFinite()) {  // nothing was found, and the states may be too many to write out
    const RowMatrix unknown = RowMatrix::Constant(rows, n, NAN);
    return {unknown, unknown, RowMatrix::Constant(rows, scene.states(), NAN)};
  }
  const RowMatrix states = states_at_nodes(scene, r);
  GalerkinOutput out{RowMatrix(rows, n), RowMatrix::Zero(rows, n), RowMatrix(rows, states.cols())};
  for (std::size_t i = 0; i < times.size(); ++i) {
    const Index row = Index(i), k = interval_at(r.t, times[i]), node = node_at(r.t, times[i]);
    const double h = r.t[k + 1] - r.t[k], part = std::clamp((times[i] - r.t[k]) / h, 0.0, 1.0);
    if (node >= 0) {
      out.y.row(row) = r.y.row(node);
      out.x.row(row) = states.row(node);
      continue;
    }
    const IntervalRule rule = r.interval_rules.empty() ? IntervalRule::galerkin : r.interval_rules[std::size_t(k)];
    Vector a = r.y_left.row(k).transpose();
    const Vector last = r.y.row(k + 1).transpose();
    if (rule == IntervalRule::radau) {  // y_1 belongs to a third of the interval
      out.y.row(row) = (a + std::max(0.0, 1.5 * part - 0.5) * (last - a)).transpose();
      a = 1.5 * a - 0.5 * last;
    }
    const Vector b = (1 - part) * a + part * last;
    if (rule != IntervalRule::radau) out.y.row(row) = b.transpose();
    out.integral.row(row) = part * h * (rule == IntervalRule::euler ? last : Vector((a + b) / 2)).transpose();
    if (rule == IntervalRule::euler)
      out.x.row(row) = (1 - part) * states.row(k) + part * states.row(k + 1);
    else
      out.x.row(row) = carried_state(scene, states.row(k).transpose(), r.t[k], part * h, a, b).transpose();
  }
  return out;
}

}  // namespace bromwich
