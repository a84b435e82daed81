#include "core/solve/event_control.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/events/collocation.hpp"
#include "core/events/event_sources.hpp"
#include "core/kernel/start_rounding.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/result/switching.hpp"
#include "core/solve/error_goal.hpp"
#include "core/solve/event_rows.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich {

namespace {

constexpr double first_tolerance = 1e-8;  ///< of the first integration at most, for the last coefficients of steps
constexpr double first_share = 1e-4;      ///< of the tolerance, likewise
constexpr double least_first = 1e-10;     ///< of the first integration at least, and where no tolerance is given
constexpr double ratio = 1e-3;            ///< of the tolerances of two integrations
constexpr double finest_tolerance = 1e-12, finest_first = 1e-11;
constexpr double agreed = 0.8;             ///< of the tolerance
constexpr double nothing_known = 1;        ///< more is no solution: an error larger than what it is of
constexpr double rounding = 64 * epsilon;  ///< smaller differences say nothing
constexpr Index most_halvings = 6;         ///< of the steps between rows

// Mean over time of how far y and x, those that are controlled, are from linear between the rows, relative to their
// sizes.
double bend(const EventSolution& s, const Result& r, const ComponentSizes& sizes, const EventGoal& goal) {
  const Index J = r.steps;
  Vector of_y = Vector::Zero(r.y.cols()), of_x = Vector::Zero(r.x.cols());
  for (Index j = 0; j < J; ++j) {
    const double t = (r.t[j] + r.t[j + 1]) / 2;
    if (goal.of_y && r.y.row(j).allFinite())
      of_y += (s.y(t, true) - (r.y.row(j) + r.y.row(j + 1)).transpose() / 2).cwiseAbs();
    if (goal.of_x && of_x.size() > 0)
      of_x += (s.x(t, true)(r.x_components) - (r.x.row(j) + r.x.row(j + 1)).transpose() / 2).cwiseAbs();
  }
  const auto mean = [J](const Vector& sum, const Vector& size) {
    return sum.size() == 0 ? 0.0 : (sum.array() > 0).select(sum.cwiseQuotient(size), 0).maxCoeff() / double(J);
  };
  return std::max(mean(of_y, sizes.of_y(r)), mean(of_x, sizes.of_x(r)));
}

// The times behind t = 0 at which the state jumps.
std::vector<double> jump_times(const EventSolution& s) {
  std::vector<double> times;
  for (const EventPiece& p : s.pieces)
    if (p.begin > 0 && (!p.impulses.empty() || !p.set.empty())) times.push_back(p.begin);
  return times;
}

// Rows at which both jump, by times that differ by at most `apart`: there `a` gets the side of its jump that `b` has.
void take_sides(const EventSolution& of_a, const EventSolution& of_b, double apart, Result& a, const Result& b) {
  const std::vector<double> jumps = jump_times(of_a), others = jump_times(of_b);
  if (jumps.size() != others.size()) return;
  const double h = a.t[1] - a.t[0];
  for (std::size_t k = 0; k < jumps.size(); ++k) {
    const Index j = std::min(Index(std::lround(jumps[k] / h)), a.steps);
    if (std::abs(jumps[k] - others[k]) > apart || std::abs(jumps[k] - a.t[j]) > apart) continue;
    const Vector integral = b.y_integral.row(j), x = b.x.row(j);
    const auto off = [&](bool left) {
      return (of_a.integral_of_y(jumps[k], left) - integral).norm() +
             (of_a.x(jumps[k], left)(a.x_components) - x).norm();
    };
    const bool left = off(true) <= off(false);
    a.x.row(j) = of_a.x(jumps[k], left)(a.x_components).transpose();
    a.y_integral.row(j) = of_a.integral_of_y(jumps[k], left).transpose();
  }
}

// Of the first integration.
double tolerance_for(const EventGoal& goal) {
  if (goal.first > 0) return goal.first;
  return goal.tolerance > 0 ? std::clamp(first_share * goal.tolerance, least_first, first_tolerance) : least_first;
}

EventSolution integrate_scene(const Scene& scene, const InnerOptions& options, LcpClass lcp_class, double tolerance,
                              std::size_t number, double most_work, const std::shared_ptr<RegimesOfScene>& kept,
                              const std::function<double(double, double)>& budget = {}) {
  EventOptions o;
  o.budget = budget;
  o.tolerance = tolerance;
  o.longest_step = longest_step(scene, scene.breakpoints, number);
  o.most_work = most_work;
  o.kept = kept;
  o.interrupted = options.interrupted;
  if (options.progress) {
    const Index rows = steps_of(scene, options);
    o.progress = [&scene, &options, rows](double t) { options.progress({Index(t / scene.T * double(rows)), 0, rows}); };
  }
  return integrate_with_events(scene, lcp_class, scene.breakpoints, o);
}

class EventControl {
 public:
  EventControl(const Scene& scene, Backend& backend, const InnerOptions& options, const ComponentSizes& sizes,
               const EventGoal& goal)
      : scene_(scene),
        backend_(backend),
        options_(options),
        sizes_(sizes),
        goal_(goal),
        tolerance_(goal.tolerance > 0 ? goal.tolerance : assumed_tolerance),
        lcp_class_(selection_class(scene.M, scene.lcp_class)),
        components_(recorded_components(scene, options)) {}

  const std::optional<Notice>& cause() const { return cause_; }

  Result run() {
    const Index J = steps_of(scene_, options_);
    rows_.emplace(scene_, backend_, chooses_grid() ? std::min(std::max(J, scene_.steps()), options_.max_steps) : J);
    if (rows_->start() == Start::none) {
      Result r = rows_->at_zero();
      rows_->fill({}, components_, options_.trace, r);
      return r;
    }
    EventSolution coarse;
    tolerances_ = {tolerance_for(goal_)};
    coarse = integrate(tolerances_[0], 1);
    // What counts as zero falls with the tolerance: signs, and which of two solutions it is, may be known then.
    while (may_become_complete(coarse) && tolerances_[0] > finest_first) {
      tolerances_[0] = std::max(finest_first, ratio * tolerances_[0]);
      coarse = integrate(tolerances_[0], 1);
    }
    if (!coarse.complete) return ended_early(std::move(coarse));
    for (;;) {
      tolerances_.push_back(std::max(finest_tolerance, ratio * tolerances_.back()));
      EventSolution fine = integrate(tolerances_.back(), tolerances_.size());
      if (!fine.complete) return with_coarser(std::move(coarse), std::move(fine));
      if (tolerances_.size() == 2) choose_grid(fine);
      compare(coarse, fine);
      if (std::max(of_y_, of_x_) <= agreed * tolerance_ || tolerances_.back() <= finest_tolerance)
        return finished(std::move(fine));
      coarse = std::move(fine);
    }
  }

 private:
  bool chooses_grid() const { return goal_.tolerance > 0; }

  EventSolution integrate(double tolerance, std::size_t number) {
    // Near its begin an integration is measured by the one before.
    const auto budget = [this, before = work_, last = work_of_last_](double work, double t) {
      const double part = t / scene_.T;
      const double whole =
          last > 0 && part < well_begun ? std::max(work, of_finer * last) : work / std::max(part, 1e-3);
      const double later = tolerances_.size() < 2 ? of_finer * whole : 0;
      return goal_.budget(before + work, whole - work + later) - before;
    };
    EventSolution s = integrate_scene(scene_, options_, lcp_class_, tolerance, number, goal_.most_work, kept_,
                                      goal_.budget ? budget : std::function<double(double, double)>());
    work_ += work_of_last_ = s.work;
    return s;
  }
  static constexpr double of_finer = 1.5;    ///< a finer integration beside the one before, in operations
  static constexpr double well_begun = 0.1;  ///< of T

  static bool may_become_complete(const EventSolution& s) {
    return !s.complete && !s.interrupted && s.end != EventEnd::out_of_work;
  }

  // Where the finer integration did not come to its end, a coarser one is compared with the one there is.
  Result with_coarser(EventSolution known, EventSolution failed) {
    if (failed.interrupted || tolerances_.size() != 2) return ended_early(std::move(failed));
    tolerances_ = {tolerances_[0] / ratio, tolerances_[0]};
    const EventSolution coarse = integrate(tolerances_[0], 3);
    if (!coarse.complete) return ended_early(std::move(failed));
    choose_grid(known);
    compare(coarse, known);
    return std::max(of_y_, of_x_) <= agreed * tolerance_ ? finished(std::move(known)) : ended_early(std::move(failed));
  }

  void look_at_sizes(const EventSolution& s) {
    sizes_.seen_y = largest_values(s, &EventPiece::y);
    const DenseDynamics& d = *scene_.dynamics->small_state();
    const Vector rest = at_rest * motion_within(scene_.T, d.A) * (d.B.cwiseAbs() * sizes_.seen_y);
    sizes_.seen_x = largest_values(s, &EventPiece::x).cwiseMax(rest)(components_);
  }

  // So many rows that y and x are linear between them, where they are continuous.
  void choose_grid(const EventSolution& s) {
    if (!chooses_grid() || !s.continuous) return;
    look_at_sizes(s);
    Result r;
    for (Index halvings = 0; halvings < most_halvings; ++halvings) {
      rows_->fill(s, components_, false, r);
      const Index next = 2 * r.steps;
      if (next > options_.max_steps || bend(s, r, sizes_, goal_) <= tolerance_) return;
      rows_.emplace(scene_, backend_, next);
    }
  }

  // The error of the less accurate solution, in of_y_ and of_x_; the other one is returned.
  void compare(const EventSolution& coarse, EventSolution& fine) {
    Result a, &b = of_fine_ = {};
    rows_->fill(coarse, components_, false, a);
    rows_->fill(fine, components_, options_.trace, b);
    take_sides(coarse, fine, tolerances_[tolerances_.size() - 2] * scene_.T, a, b);
    look_at_sizes(fine);
    fine.switches = switches_beside(fine, coarse);
    const Distance d = distance(a, 1, b, 1, sizes_);
    of_mean_ = !coarse.continuous || !fine.continuous;
    doubt_ = largest_share(fine.doubt, of_mean_ ? sizes_.of_mean(b) : sizes_.of_y(b));
    const double of_y = of_mean_ ? d.mean : d.y, most = agreed * tolerance_;
    of_x_ = goal_.of_x && a.x.cols() > 0 ? std::max(rounding, d.of_x()) : 0;
    // Of several y with the same state none is off: what counts is whether the difference moves the state.
    one_of_several_ = goal_.of_y && of_y > most && of_x_ <= most ? other_y(b, true) : std::nullopt;
    of_y_ = goal_.of_y ? std::max({rounding, one_of_several_ ? motion(a, b) : of_y, doubt_}) : 0;
    if (goal_.error_of_start) add_error_of_start(fine, b);
  }

  // With what both differ by; a row's distance where the other one has none.
  std::vector<Switch> switches_beside(const EventSolution& fine, const EventSolution& coarse) const {
    std::vector<Switch> found = switches_of(fine);
    const std::vector<double> apart =
        distances(found, switches_of(coarse), scene_.T / double(steps_of(scene_, options_)));
    for (std::size_t k = 0; k < found.size(); ++k) found[k].error += apart[k];
    return found;
  }

  void add_error_of_start(const EventSolution& fine, const Result& rows) {
    const auto [of_x, of_y] = goal_.error_of_start(fine);
    if (goal_.of_y) of_y_ += largest_share(of_y, of_mean_ ? sizes_.of_mean(rows) : sizes_.of_y(rows));
    if (goal_.of_x && rows.x.cols() > 0) of_x_ += largest_share(of_x(components_), sizes_.of_x(rows));
  }

  // Of the integrals of two y: what of their difference moves the state.
  double motion(const Result& a, const Result& b) const {
    const Matrix& B = scene_.dynamics->small_state()->B;
    if (B.size() == 0) return 0;
    const Vector moved = ((a.y_integral - b.y_integral) * B.transpose()).cwiseAbs().colwise().maxCoeff(),
                 terms = (b.y_integral.cwiseAbs() * B.cwiseAbs().transpose()).colwise().maxCoeff();
    return (terms.array() > 0).select(moved.cwiseQuotient(terms), 0).maxCoeff();
  }

  // Another y with the state of the rows filled last.
  std::optional<Notice> other_y(const Result& r, bool at_corners) const {
    const OtherSolution other = rows_->other(r, at_corners);
    if (other.row < 0 || other.moves_the_state) return std::nullopt;
    return Notice{.code = NoticeCode::other_y, .t = r.t[other.row]};
  }

  void describe(const EventSolution& s, Result& r) const {
    r.method = Method::events;
    r.backend = backend_.name();
    r.starts_with_impulse =
        rows_->start() == Start::impulse || (!scene_.memories.empty() && s.jump_at_start.size() > 0);
    r.kernel = text("event-driven: Radau IIA with 7 stages, %zu steps, %ld events", s.pieces.size(), long(s.events));
    if (s.jumps > 0) r.kernel += text(", %ld jumps of the state", long(s.jumps));
    if (s.accumulations > 0) r.kernel += text(", %ld accumulations of events passed", long(s.accumulations));
    if (r.starts_with_impulse) r.kernel += impulse_note;
    r.iterations = 1;
    r.lcp = rows_->at_zero().lcp;
    r.bytes = sizeof(double) * (std::size_t(4 * r.y.size() + r.x.size()) +
                                s.pieces.size() * 8 * std::size_t(scene_.states() + scene_.constraints()));
  }

  Result ended_early(EventSolution s) {
    if (s.switches.empty()) s.switches = switches_of(s);
    Result r;
    rows_->fill(s, components_, options_.trace, r);
    describe(s, r);
    r.status = s.interrupted ? Status::interrupted : Status::tolerance_not_met;
    r.reason = s.reason;
    if (s.end == EventEnd::several_solutions) cause_ = Notice{.code = NoticeCode::other_state, .t = s.until};
    if (s.end == EventEnd::out_of_work) cause_ = Notice{NoticeCode::too_many_steps};
    r.located = std::make_shared<const LocatedSolution>(std::move(s));
    return r;
  }

  // The one that was compared last.
  Result finished(EventSolution s) {
    Result r = std::move(of_fine_);
    describe(s, r);
    const bool unique = s.unique;
    r.located = std::make_shared<const LocatedSolution>(std::move(s));
    r.residual = options_.units ? 0 : rows_->residual(r);  // in natural units that of the scene as it is stated
    const double error = std::max(of_y_, of_x_);
    if (std::isfinite(error)) r.error_estimate = error;
    const bool good = error <= agreed * tolerance_, met = good || (!chooses_grid() && error <= nothing_known);
    r.status = met ? Status::solved : Status::tolerance_not_met;
    const Notice rounded{error == doubt_ ? NoticeCode::rounding_of_y : NoticeCode::rounding, error};
    if (met && !good)
      tell(r, rounded);
    else if (!met && error == doubt_)
      r.reason = sentence(rounded);
    else if (!met)
      r.reason = text("integrations with tolerances of %.0e and %.0e differ by %.1e",
                      tolerances_[tolerances_.size() - 2], tolerances_.back(), error);
    if (met)
      if (const auto other = one_of_several_ ? one_of_several_ : other_y(r, false)) tell(r, *other);
    if (!unique) tell(r, {NoticeCode::may_be_others});
    if (!chooses_grid() || !r.error_estimate) return r;
    ErrorEstimate e;
    e.tolerance = goal_.tolerance;
    e.of_integral = of_mean_;
    if (goal_.of_y) e.discretisation = of_y_;
    if (goal_.of_x && r.x.cols() > 0) e.states = of_x_;
    e.grids = {r.steps};
    r.errors = e;
    return r;
  }

  const Scene& scene_;
  Backend& backend_;
  const InnerOptions& options_;
  ComponentSizes sizes_;
  const EventGoal goal_;
  double tolerance_;
  LcpClass lcp_class_;
  std::vector<Index> components_;
  std::optional<EventRows> rows_;
  std::vector<double> tolerances_;  ///< of the integrations
  double work_ = 0;                 ///< of those so far
  double work_of_last_ = 0;
  const std::shared_ptr<RegimesOfScene> kept_ = keep_regimes();
  Result of_fine_;  ///< the rows of the solution that was compared last
  double of_y_ = INFINITY, of_x_ = INFINITY, doubt_ = 0;
  bool of_mean_ = false;
  std::optional<Notice> cause_, one_of_several_;
};

}  // namespace

EventGoal event_goal(const InnerOptions& options, double most_work) {
  if (!controls_error(options)) return {0, true, true, most_work};
  const ErrorGoal goal(options);
  return {goal.smallest(), goal.y > 0, goal.x > 0, most_work};
}

EventAttempt try_events(const Scene& scene, Backend& backend, const InnerOptions& options, const ComponentSizes& sizes,
                        const EventGoal& goal) {
  Timer timer;
  EventControl control(scene, backend, options, sizes, goal);
  EventAttempt attempt{control.run(), {}};
  attempt.cause = control.cause();
  attempt.result.method = Method::events;
  Seconds& s = attempt.result.seconds;
  s.total = s.solve = s.other = timer.lap();
  return attempt;
}

Result solve_by_events(const Scene& scene, Backend& backend, const InnerOptions& options, const ComponentSizes& sizes,
                       const EventGoal& goal) {
  return try_events(scene, backend, options, sizes, goal).result;
}

EventReference::EventReference(const Scene& scene, Backend& backend, std::vector<Index> components,
                               std::shared_ptr<const EventSolution> solution)
    : scene_(&scene), backend_(&backend), components_(std::move(components)), solution_(std::move(solution)) {}

std::optional<EventReference> EventReference::find(const Scene& scene, Backend& backend, const InnerOptions& options,
                                                   const ComponentSizes& sizes, const EventGoal& goal, Index J) {
  constexpr double most_apart = 0.1;      // of the tolerance
  constexpr double looked_at = 1.0 / 16;  // of the operations, before more are expected
  if (!unsuited_to_events(scene).empty() || scene.constraints() == 0) return std::nullopt;
  const LcpClass c = selection_class(scene.M, scene.lcp_class);
  const double tolerance = tolerance_for(goal);
  InnerOptions quiet = options;
  quiet.progress = {};
  std::array<std::optional<EventReference>, 2> found;
  std::array<Result, 2> rows;
  const auto kept = keep_regimes();
  for (std::size_t k = 0; k < 2; ++k) {
    const double finer = k == 0 ? tolerance : std::max(finest_tolerance, ratio * tolerance);
    // Where it is expected to need more, it is given up early.
    const auto budget = [most = goal.most_work, T = scene.T](double work, double t) {
      if (work < looked_at * most) return looked_at * most;
      return work / std::max(t / T, 1e-3) > most ? 0 : 1.25 * work;
    };
    auto s =
        std::make_shared<EventSolution>(integrate_scene(scene, quiet, c, finer, k + 1, goal.most_work, kept, budget));
    if (!s->complete) return std::nullopt;
    found[k] = EventReference(scene, backend, recorded_components(scene, options), std::move(s));
    rows[k] = found[k]->on(J);
    if (rows[k].y.rows() != J + 1) return std::nullopt;
  }
  take_sides(*found[0]->solution_, *found[1]->solution_, tolerance * scene.T, rows[0], rows[1]);
  const Distance d = distance(rows[0], 1, rows[1], 1, sizes);
  const bool continuous = found[0]->continuous() && found[1]->continuous();
  const double doubt =
      largest_share(found[1]->solution_->doubt, continuous ? sizes.of_y(rows[1]) : sizes.of_mean(rows[1]));
  const double of_y = goal.of_y ? std::max(continuous ? d.y : d.mean, doubt) : 0, of_x = goal.of_x ? d.of_x() : 0;
  if (!(std::max(of_y, of_x) <= most_apart * goal.tolerance)) return std::nullopt;
  return found[1];
}

Result EventReference::on(Index J) const {
  Result r;
  EventRows rows(*scene_, *backend_, J);
  if (rows.start() != Start::none) rows.fill(*solution_, components_, false, r);
  return r;
}

}  // namespace bromwich
