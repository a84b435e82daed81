#include "batch/lane_plan.hpp"
#include "core/numerics/step_propagator.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double same_limit = 1e-9;        ///< of limits of g, as in core/march/split.cpp
constexpr std::size_t most_parts = 200;    ///< with maps of their own
constexpr double followed_sources = 0.01;  ///< error of parts above which a result has a warning

}  // namespace

// As core/march/split.cpp takes them.
bool LanePlan::add_parts(const DiscreteProblem& d, std::string& why) {
  const SourceSteps& s = *d.sources;
  if (s.unresolved > 0 || s.disagreement > followed_sources) {
    why = "sources that the steps do not resolve";
    return false;
  }
  if (2 * Index(d.scene.breakpoints.size()) >= J) return why = "sources that jump in every other step", false;
  StepPropagator propagator(A, h);
  const OneSided values(d.scene.g, n, s.resolution);
  const double g_scale = std::max(d.g.values().size() > 0 ? d.g.values().cwiseAbs().maxCoeff() : 0, 1e-290);
  Matrix F;
  if (d.f.size() > 0) F = source_matrix(d);
  if (d.f.shapes().size() > 0) F = (F * d.f.shapes()).eval();
  std::map<long long, const StepMaps*> known;
  StepMaps& jump = maps_of_parts.emplace_back();
  jump.problem = problem_of(M);
  const auto maps_of = [&](double length) {
    const StepMaps*& found = known[std::llround(std::ldexp(length / h, 40))];
    if (found) return found;
    StepMaps& made = maps_of_parts.emplace_back();
    const Matrix none = Matrix::Zero(m, m), no_y = Matrix::Zero(m, n);
    made.E = Matrix::Identity(m, m), made.L = no_y, made.R = no_y;
    propagator.advance(length, {none, none, none}, made.E);
    propagator.advance(length, {B, -B, no_y}, made.L);
    propagator.advance(length, {no_y, B, no_y}, made.R);
    made.problem = problem_of(M + N * made.R);
    return found = &made;
  };
  for (const RoughStep& rough : s.rough) {
    std::vector<PartOfStep>& steps = parts[rough.step];
    Vector before = d.g.row(rough.step - 1);
    const auto restart = [&](const Vector& after) {
      if ((before - after).cwiseAbs().maxCoeff() > same_limit * g_scale)
        steps.push_back({&jump, false, Vector::Zero(m), after});
    };
    double from = d.t[rough.step - 1];
    std::size_t piece = 0;
    for (const double to : rough.ends) {
      const double length = to - from;
      if (d.scene.g) restart(values.whole(values.after(from, length)));
      before = d.scene.g ? values.whole(values.before(to, length)) : Vector(Vector::Zero(n));
      Matrix x = Matrix::Zero(m, 1);
      for (; piece < rough.pieces.size() && rough.pieces[piece].start < to; ++piece) {
        const Matrix f = F * rough.pieces[piece].phi;
        propagator.advance(rough.pieces[piece].length, {f.col(0), f.col(1), f.col(2)}, x);
      }
      steps.push_back({maps_of(length), true, x, before});
      if (known.size() > most_parts) return why = "sources that are rough in many steps", false;
      from = to;
    }
    restart(d.g.row(rough.step));
  }
  for (const StepMaps& maps : maps_of_parts)
    if (surely_P && maps.R.size() > 0 && !has_one_solution(classify(LcpMatrix(maps.problem->matrix()))))
      return why = "parts of steps of another class than P", false;
  return true;
}

}  // namespace bromwich
