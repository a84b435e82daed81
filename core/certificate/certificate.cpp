#include "core/certificate/certificate.hpp"

#include "core/accuracy/impact_sides.hpp"
#include "core/base/interruption.hpp"
#include "core/certificate/defect.hpp"
#include "core/certificate/distances.hpp"
#include "core/dynamics/dense.hpp"
#include "core/events/event_driven.hpp"
#include "core/events/event_sources.hpp"
#include "core/lcp/lcp_class.hpp"

#include <numeric>

namespace bromwich {

namespace {

constexpr double reference_tolerance = 1e-9;  ///< of the located solution
constexpr double most_work = 4e8;             ///< likewise, operations: 0.1 s, about; as much for 1000 breakpoints

// Both over all steps of a result, many steps at once where they are alike.
void compare(const Result& r, const std::vector<double>& breakpoints, const RowMatrix& states, Defect& defect,
             Distances& distances) {
  const Index J = r.steps;
  StepParts steps(r.t, breakpoints, Defect::division);
  std::vector<Part> parts;
  const auto pass_kept = [&](Index next) {
    const Index count = defect.kept(), first = next - count;
    if (count == 0) return;
    const RowMatrix x = defect.pass_kept(first);
    distances.add(first, states.size() > 0 ? states.middleRows(first, count) : x);
    check_interruption();
  };
  for (Index j = 1; j <= J; ++j) {
    if (steps.next_is_plain() && defect.keep(r.t[j - 1], r.t[j])) {
      steps.pass();
      if (defect.kept() == Defect::at_once) pass_kept(j + 1);
      continue;
    }
    pass_kept(j);
    parts.clear();
    steps.pass(&parts);
    for (const Part& part : parts) defect.pass(part);
    distances.add(j, states.size() > 0 ? RowMatrix(states.row(j)) : RowMatrix(defect.x().transpose()));
  }
  pass_kept(J + 1);
}

// March over impacts has these to the square of the step: rows beside them on the side of the located solution.
void take_sides_of(const EventSolution& located, Result& r, RowMatrix& states) {
  std::vector<Index> all(std::size_t(states.cols()));
  std::iota(all.begin(), all.end(), Index(0));
  const auto other = [&](Index j) {
    return RowOfSolution{located.x(r.t[j], false), located.integral_of_y(r.t[j], false)};
  };
  take_sides(*r.impacts, r.t, all, other, states, r.y_integral);
}

Certificate beside(const EventSolution& located, const Scene& scene, const Result& r,
                   const std::vector<double>& breakpoints, const RowMatrix& states) {
  const Matrix M = to_dense(scene.M);
  Matrix effect(scene.states() + scene.constraints(), scene.constraints());
  effect << scene.dynamics->small_state()->B, M;
  const LinearSteps y(r);
  Defect defect(scene, M, y, scene.T / double(r.steps));
  Distances distances(located, scene, r, y, effect);
  compare(r, breakpoints, states, defect, distances);
  Certificate c;
  defect.summarise(c);
  distances.summarise(defect, c);
  return c;
}

}  // namespace

std::optional<Certificate> certify(const Scene& scene, const Result& r, const std::vector<double>& breakpoints,
                                   const RowMatrix& states) {
  if (!unsuited_to_events(scene).empty() || scene.constraints() == 0) return std::nullopt;
  if (r.steps < 1 || r.y.rows() != r.steps + 1 || !r.y.bottomRows(r.steps).allFinite()) return std::nullopt;
  if (states.size() > 0 && (states.rows() != r.steps + 1 || states.cols() != scene.states())) return std::nullopt;
  EventOptions options;
  options.tolerance = reference_tolerance;
  options.longest_step = longest_step(scene, breakpoints, 1);
  options.most_work = most_work * (1 + double(breakpoints.size()) / 1000);
  const EventSolution located =
      integrate_with_events(scene, selection_class(scene.M, scene.lcp_class), breakpoints, options);
  if (!located.complete || !located.unique) return std::nullopt;
  if (!r.impacts || r.impacts->empty() || states.size() == 0) return beside(located, scene, r, breakpoints, states);
  Result moved = r;
  RowMatrix rows = states;
  take_sides_of(located, moved, rows);
  return beside(located, scene, moved, breakpoints, rows);
}

}  // namespace bromwich
