#include "core/events/event_sources.hpp"

#include "core/numerics/irregular.hpp"
#include "core/scene/memory.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

// t is known to its last digit: on a step far shorter than t, such as the edge of a pulse, a steep source shows this.
// Rounding of t and of what is computed from it, such as the place in a period: 4 eps t; times the slope 2 / h of a
// coefficient; times 4 for the coefficients of rounded values. Last coefficients that are no larger become zero.
void drop_rounding_of_time(double t, double h, LegendreCoefficients& c, Vector& unknown) {
  constexpr double seen = 1e-12;  // of a step: rounding of t below is not looked for
  const double rounding = 32 * epsilon * (t + h) / h;
  if (rounding < 32 * seen) return;
  for (Index i = 0; i < c.cols(); ++i) {
    unknown[i] = rounding * c.col(i).tail(c.rows() - 1).cwiseAbs().sum();
    for (Index k = c.rows() - 1; k > 0 && std::abs(c(k, i)) <= unknown[i]; --k) c(k, i) = 0;
  }
}

bool bends(const TimeFunction& source) { return source && !source.linear(); }

constexpr double inside = 1e-11;  ///< of T: a jump at an end of the step, known to rounding, is not on the step

// The larger of the differences seen before and these, as far as they are no rounding.
template <typename Value>
void see(Vector& off, const Value& value, const LegendreCoefficients& c, const LegendreValues& at,
         const Vector& unknown) {
  for (Index i = 0; i < off.size(); ++i) {
    const double difference = std::abs(value[i] - c.col(i).dot(at));
    if (difference > unknown[i]) off[i] = std::max(off[i], difference);
  }
}

}  // namespace

double longest_span(const std::vector<double>& breakpoints, double T) {
  double longest = 0, begin = 0;
  for (const double t : breakpoints) longest = std::max(longest, t - begin), begin = t;
  return std::max(longest, T - begin);
}

double longest_step(const Scene& scene, const std::vector<double>& breakpoints, std::size_t number) {
  constexpr double more = 16;  // each time
  const double of_T = scene.T / (fewest_steps + more * double(number - 1));
  bool lines = true;
  for_each_source(scene, [&lines](const TimeFunction& source, Index) { lines = lines && !bends(source); });
  return lines ? std::max(of_T, 2 * longest_span(breakpoints, scene.T) / double(1 + number)) : of_T;
}

EventSources::EventSources(const Scene& scene, std::shared_ptr<SourceLooks> looks)
    : scene_(scene),
      m_(scene.states()),
      n_(scene.constraints()),
      looks_(looks ? std::move(looks) : std::make_shared<SourceLooks>()) {
  if (scene.f && scene.f_entry != SourceEntry::state) F_ = source_matrix(scene, *scene.dynamics->small_state());
}

bool EventSources::may_bend() const { return bends(scene_.f) || bends(scene_.g); }

void EventSources::value_of_f(double t, Vector& value) const {
  value.setZero(scene_.f ? scene_.sources() : m_);
  if (!scene_.f) return;
  scene_.f(t, value);
  if (F_.size() > 0) value = (F_ * value).eval();
}

void EventSources::value_of_g(double t, Vector& value) const {
  value.setZero(n_);
  if (scene_.g) scene_.g(t, value);
}

Vector EventSources::f(double t) const {
  Vector value;
  value_of_f(t, value);
  return value;
}

Vector EventSources::g(double t) const {
  Vector value;
  value_of_g(t, value);
  return value;
}

EventSources::Polynomials EventSources::sample(double t, double h) const {
  Polynomials p;
  sample(t, h, p);
  return p;
}

void EventSources::sample(double t, double h, Polynomials& p) const {
  const Collocation& c = Collocation::get();
  Vector value;
  const auto one = [&](const TimeFunction& given, Index width, const auto& evaluate, LegendreCoefficients& coefficients,
                       Vector& off, Vector& unknown) {
    off.setZero(width);
    unknown.setZero(width);
    coefficients.setZero(c.samples.size(), width);
    if (!given) return;
    if (given.linear()) {
      evaluate(t + h / 4);
      coefficients.row(0) = value.transpose();
      evaluate(t + 3 * h / 4);
      coefficients.row(1) = value.transpose() - coefficients.row(0);
      coefficients.row(0) += coefficients.row(1) / 2;
      drop_rounding_of_time(t, h, coefficients, unknown);
      return;
    }
    LegendreCoefficients values(c.samples.size(), width);
    for (Index k = 0; k < c.samples.size(); ++k) {
      evaluate(t + h * c.samples[k]);
      values.row(k) = value.transpose();
    }
    const LegendreCoefficients exact = c.from_samples * values;
    coefficients = exact;
    drop_rounding_of_time(t, h, coefficients, unknown);
    for (Index k = 0; k < c.checks.size(); ++k) {
      evaluate(t + h * c.checks[k]);
      see(off, value, exact, c.at_checks.row(k).transpose(), unknown);
    }
  };
  one(
      scene_.f, m_, [&](double at) { value_of_f(at, value); }, p.f, p.off_f, p.unknown_f);
  one(
      scene_.g, n_, [&](double at) { value_of_g(at, value); }, p.g, p.off_g, p.unknown_g);
}

void EventSources::look(double t, double h, double at, Polynomials& p) const {
  const LegendreValues there = legendre(at);
  Vector value;
  if (bends(scene_.f)) {
    value_of_f(t + h * at, value);
    see(p.off_f, value, p.f, there, p.unknown_f);
  }
  if (bends(scene_.g)) {
    value_of_g(t + h * at, value);
    see(p.off_g, value, p.g, there, p.unknown_g);
  }
}

void EventSources::look_at_ends(double t, double h, Polynomials& p) const {
  const double at = inside * scene_.T / h;
  if (at > Collocation::get().samples[0]) return;
  look(t, h, at, p);
  look(t, h, 1 - at, p);
}

void EventSources::look_up(Index k, double at_time) const {
  SourceLooks& l = *looks_;
  if (l.known.empty()) {
    l.known.assign(SourceLooks::count, 0);
    l.f.resize(bends(scene_.f) ? SourceLooks::count : 0, m_);
    l.g.resize(bends(scene_.g) ? SourceLooks::count : 0, n_);
  }
  if (l.known[std::size_t(k)]) return;
  Vector value;
  if (bends(scene_.f)) {
    value_of_f(at_time, value);
    l.f.row(k) = value.transpose();
  }
  if (bends(scene_.g)) {
    value_of_g(at_time, value);
    l.g.row(k) = value.transpose();
  }
  l.known[std::size_t(k)] = 1;
}

Index EventSources::look_between(double t, double h, Polynomials& p) const {
  constexpr Index all = SourceLooks::count;
  if (scene_.no_pulses) return 0;
  const double T = scene_.T, margin = inside * T;
  const Index first = std::clamp<Index>(Index(t / T * all), 0, all - 1),
              last = std::clamp<Index>(Index((t + h) / T * all), 0, all - 1);
  if (last - first < Collocation::get().checks.size()) return 0;  // the checks see as much
  for (Index k = first; k <= last; ++k) {
    const double time = (double(k) + 0.1 + 0.8 * irregular(double(k))) / double(all) * T;
    if (!(time > t + margin && time < t + h - margin)) continue;
    look_up(k, time);
    const LegendreValues there = legendre((time - t) / h);
    if (bends(scene_.f)) see(p.off_f, looks_->f.row(k), p.f, there, p.unknown_f);
    if (bends(scene_.g)) see(p.off_g, looks_->g.row(k), p.g, there, p.unknown_g);
  }
  return last - first + 1;
}

}  // namespace bromwich
