#include "core/solve/event_control.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/solve/event_rows.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

namespace bromwich {

namespace {

constexpr double first_tolerance = 1e-7;  ///< of the first integration at most, for the last coefficients of steps
constexpr double ratio = 1e-3;            ///< of the tolerances of two integrations
constexpr double finest_tolerance = 1e-12;
constexpr double agreed = 0.8;       ///< of the tolerance
constexpr double negligible = 1e-7;  ///< of the tolerance: smaller errors need not be known
constexpr double assumed = 1e-4;     ///< the tolerance where none is given
constexpr double of_events = 10;     ///< times the tolerance of the last coefficients: errors by located events
constexpr Index most_halvings = 6;   ///< of the steps between rows
constexpr double fewest_in_T[] = {48, 64, 80};  ///< steps of each integration: no two look at the same times

// Mean over time of how far y and x are from linear between the rows, relative to their sizes.
double bend(const EventSolution& s, const Result& r, const ComponentSizes& sizes) {
  const Index J = r.steps;
  Vector of_y = Vector::Zero(r.y.cols()), of_x = Vector::Zero(r.x.cols());
  for (Index j = 0; j < J; ++j) {
    const double t = (r.t[j] + r.t[j + 1]) / 2;
    if (r.y.row(j).allFinite()) of_y += (s.y(t, true) - (r.y.row(j) + r.y.row(j + 1)).transpose() / 2).cwiseAbs();
    if (of_x.size() > 0)
      of_x += (s.x(t, true)(r.x_components) - (r.x.row(j) + r.x.row(j + 1)).transpose() / 2).cwiseAbs();
  }
  const auto mean = [J](const Vector& sum, const Vector& size) {
    return sum.size() == 0 ? 0.0 : (sum.array() > 0).select(sum.cwiseQuotient(size), 0).maxCoeff() / double(J);
  };
  return std::max(mean(of_y, sizes.of_y(r)), mean(of_x, sizes.of_x(r)));
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
        tolerance_(goal.tolerance > 0 ? goal.tolerance : assumed),
        lcp_class_(selection_class(scene.M, scene.lcp_class)),
        components_(recorded_components(scene, options)) {}

  Result run() {
    const Index J = options_.steps > 0 ? options_.steps : scene_.default_steps;
    rows_.emplace(scene_, backend_,
                  chooses_grid() ? std::min(std::max(J, scene_.default_steps), options_.max_steps) : J);
    if (rows_->start() == Start::none) {
      Result r = rows_->at_zero();
      rows_->fill({}, components_, options_.trace, r);
      return r;
    }
    std::vector<EventSolution> found;
    double next = std::min(first_tolerance, 1e-4 * tolerance_);
    for (bool known = false; !known; next = std::max(finest_tolerance, next * ratio)) {
      tolerances_.push_back(next);
      found.push_back(integrate());
      if (!found.back().complete) return ended_early(found.back());
      known = judge(found);
    }
    return finished(found[1]);
  }

 private:
  bool chooses_grid() const { return goal_.tolerance > 0; }

  EventSolution integrate() const {
    EventOptions o;
    o.tolerance = tolerances_.back();
    o.longest_step = scene_.T / fewest_in_T[tolerances_.size() - 1];
    o.most_work = goal_.most_work;
    o.interrupted = [this] { return (options_.interrupted && options_.interrupted()) || out_of_time(); };
    if (options_.progress) {
      const Index rows = options_.steps > 0 ? options_.steps : scene_.default_steps;
      o.progress = [this, rows](double t) { options_.progress({Index(t / scene_.T * double(rows)), 0, rows}); };
    }
    return integrate_with_events(scene_, lcp_class_, scene_.breakpoints, o);
  }

  bool out_of_time() const {
    return options_.max_seconds > 0 &&
           std::chrono::steady_clock::now() - start_ > std::chrono::duration<double>(options_.max_seconds);
  }

  // Whether the error of the second solution is known, in of_y_ and of_x_.
  bool judge(const std::vector<EventSolution>& found) {
    if (found.size() < 2) return false;
    const std::size_t last = found.size() - 1;
    Result coarse, fine;
    rows_->fill(found[last - 1], components_, false, coarse);
    rows_->fill(found[last], components_, false, fine);
    const Distance d = distance(coarse, 1, fine, 1, sizes_);
    of_mean_ = !found[1].continuous || !found[last].continuous;
    of_y_ = of_mean_ ? d.mean : d.y;
    of_x_ = goal_.of_x ? d.of_x() : 0;
    if (!goal_.of_y) of_y_ = 0;
    const double difference = std::max(of_y_, of_x_);
    const double floor = of_events * tolerances_[1];
    if (last == 1) {
      // The first solution differs from the second by its own error; that of the second is smaller as its tolerance is.
      const double smaller = tolerances_[1] / tolerances_[0];
      const bool resolved = found[1].defect <= 2 * tolerances_[1];
      if (!resolved || !(difference <= agreed * tolerance_) || !(smaller * difference <= negligible * tolerance_))
        return false;
      of_y_ *= smaller;
      of_x_ *= smaller;
    }
    if (goal_.of_y) of_y_ = std::max(of_y_, floor);
    if (goal_.of_x && fine.x.cols() > 0) of_x_ = std::max(of_x_, floor);
    return true;
  }

  void describe(const EventSolution& s, Result& r) const {
    r.method = Method::events;
    r.backend = backend_.name();
    r.starts_with_impulse = rows_->start() == Start::impulse;
    r.kernel = text("event-driven: Radau IIA with 7 stages, %zu steps, %ld events", s.pieces.size(), long(s.events));
    if (s.jumps > 0) r.kernel += text(", %ld jumps of the state", long(s.jumps));
    if (s.accumulations > 0) r.kernel += text(", %ld accumulations of events passed", long(s.accumulations));
    if (r.starts_with_impulse) r.kernel += impulse_note;
    r.iterations = 1;
    r.lcp = rows_->at_zero().lcp;
    r.bytes = sizeof(double) * (std::size_t(4 * r.y.size() + r.x.size()) +
                                s.pieces.size() * 8 * std::size_t(scene_.states() + scene_.constraints()));
  }

  Result ended_early(const EventSolution& s) {
    Result r;
    rows_->fill(s, components_, options_.trace, r);
    describe(s, r);
    const bool late = s.interrupted && out_of_time();
    r.status = s.interrupted && !late ? Status::interrupted : Status::tolerance_not_met;
    r.reason = late ? text("%.2g s are spent (--max-seconds) at t = %.6g", options_.max_seconds, s.until) : s.reason;
    return r;
  }

  Result finished(const EventSolution& s) {
    Result r;
    for (Index halvings = 0;; ++halvings) {
      rows_->fill(s, components_, options_.trace, r);
      const Index next = 2 * r.steps;
      if (!chooses_grid() || !s.continuous || halvings == most_halvings || next > options_.max_steps ||
          bend(s, r, sizes_) <= tolerance_)
        break;
      rows_.emplace(scene_, backend_, next);
    }
    describe(s, r);
    r.residual = rows_->residual(r);
    r.error_estimate = std::max(of_y_, of_x_);
    const bool met = *r.error_estimate <= agreed * tolerance_ || !chooses_grid();
    r.status = met ? Status::solved : Status::tolerance_not_met;
    if (!met)
      r.reason = text("integrations with tolerances of %.0e and %.0e differ by %.1e", tolerances_[1], tolerances_[2],
                      *r.error_estimate);
    else if (*r.error_estimate > agreed * tolerance_)
      add_warning(r, text("the error is about %.1e, of data that magnify rounding", *r.error_estimate));
    if (!chooses_grid()) return r;
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
  const ComponentSizes& sizes_;
  const EventGoal goal_;
  double tolerance_;
  LcpClass lcp_class_;
  std::vector<Index> components_;
  std::optional<EventRows> rows_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::vector<double> tolerances_;  ///< of the integrations
  double of_y_ = INFINITY, of_x_ = INFINITY;
  bool of_mean_ = false;
};

}  // namespace

Result solve_by_events(const Scene& scene, Backend& backend, const InnerOptions& options, const ComponentSizes& sizes,
                       const EventGoal& goal) {
  Timer timer;
  Result result;
  if (const std::string why = unsuited_to_events(scene); why.empty())
    result = EventControl(scene, backend, options, sizes, goal).run();
  else
    result.reason = "method events: " + why + "; use method march or euler";
  result.method = Method::events;
  Seconds& s = result.seconds;
  s.total = s.solve = s.other = timer.lap();
  return result;
}

}  // namespace bromwich
