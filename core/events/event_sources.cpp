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
    unknown[i] += rounding * c.col(i).tail(c.rows() - 1).cwiseAbs().sum();
    for (Index k = c.rows() - 1; k > 0 && std::abs(c(k, i)) <= unknown[i]; --k) c(k, i) = 0;
  }
}

bool bends(const TimeFunction& source) { return source && !source.linear(); }

constexpr double inside = 1e-11;  ///< of T: a jump at an end of the step, known to rounding, is not on the step

// The larger of the differences seen before and these, as far as they are no rounding.
void see(Vector& off, const Vector& differences, const Vector& unknown) {
  for (Index i = 0; i < off.size(); ++i)
    if (const double difference = std::abs(differences[i]); difference > unknown[i])
      off[i] = std::max(off[i], difference);
}

template <typename Value>
void see(Vector& off, const Value& value, const LegendreCoefficients& c, const LegendreValues& at,
         const Vector& unknown) {
  for (Index i = 0; i < off.size(); ++i)
    if (const double difference = std::abs(value[i] - c.col(i).dot(at)); difference > unknown[i])
      off[i] = std::max(off[i], difference);
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

EventSources::Source::Source(const TimeFunction& given, Index wide, const Matrix& by)
    : time(given), width(wide), linear(given && given.linear()) {
  if (!given) return;
  const SeparableSource* separable = given.separable();
  if (separable) time = separable->time;
  Matrix all = by.size() > 0 ? by : Matrix::Identity(width, width);
  if (separable) all *= separable->shapes;
  count = all.cols();
  shapes = Combination(all);
}

EventSources::EventSources(const Scene& scene, std::shared_ptr<SourceLooks> looks)
    : scene_(scene),
      f_(scene.f, scene.states(),
         scene.f && scene.f_entry != SourceEntry::state ? source_matrix(scene, *scene.dynamics->small_state())
                                                        : Matrix()),
      g_(scene.g, scene.constraints(), {}),
      looks_(looks ? std::move(looks) : std::make_shared<SourceLooks>()) {}

bool EventSources::may_bend() const { return f_.bends() || g_.bends(); }

void EventSources::evaluate(const Source& source, double t, Vector& value) const {
  value.setZero(source.width);
  if (!source.time) return;
  of_time_.setZero(source.count);
  source.time(t, of_time_);
  source.shapes.add(of_time_, value);
}

Vector EventSources::f(double t) const {
  Vector value;
  evaluate(f_, t, value);
  return value;
}

Vector EventSources::g(double t) const {
  Vector value;
  evaluate(g_, t, value);
  return value;
}

EventSources::Polynomials EventSources::sample(double t, double h) const {
  Polynomials p;
  sample(t, h, p);
  return p;
}

void EventSources::sample(double t, double h, Polynomials& p) const {
  sample(f_, t, h, p.f, p.off_f, p.unknown_f);
  sample(g_, t, h, p.g, p.off_g, p.unknown_g);
}

void EventSources::sample(const Source& source, double t, double h, LegendreCoefficients& coefficients, Vector& off,
                          Vector& unknown) const {
  const Collocation& c = Collocation::get();
  off.setZero(source.width);
  unknown.setZero(source.width);
  coefficients.setZero(Eigen::NoChange, source.width);
  if (!source.time) return;
  LegendreCoefficients& in_time = in_time_;
  in_time.setZero(Eigen::NoChange, source.count);
  const auto look_at = [&](double at) {
    of_time_.setZero(source.count);
    source.time(t + h * at, of_time_);
  };
  if (source.linear) {
    look_at(0.25);
    in_time.row(0) = of_time_.transpose();
    look_at(0.75);
    in_time.row(1) = of_time_.transpose() - in_time.row(0);
    in_time.row(0) += in_time.row(1) / 2;
  } else {
    for (Index k = 0; k < c.samples.size(); ++k) {
      look_at(c.samples[k]);
      in_time.row(k) = of_time_.transpose();
    }
    transform(c.from_samples, in_time);
  }
  source.shapes.add(in_time, coefficients);
  // Of terms that may cancel, such as a level and the signal that is compared with it.
  constexpr double of_terms = 4 * epsilon;
  for (Index k = 0; k < source.count; ++k) of_time_[k] = of_terms * in_time.col(k).cwiseAbs().sum();
  source.shapes.add_terms(of_time_, unknown);
  drop_rounding_of_time(t, h, coefficients, unknown);
  if (source.linear) return;
  for (Index k = 0; k < c.checks.size(); ++k) {
    look_at(c.checks[k]);
    for (Index i = 0; i < source.count; ++i) of_time_[i] -= c.at_checks.row(k).dot(in_time.col(i));
    value_.setZero(source.width);
    source.shapes.add(of_time_, value_);
    see(off, value_, unknown);
  }
}

void EventSources::look(double t, double h, double at, Polynomials& p) const {
  const LegendreValues there = legendre(at);
  if (f_.bends()) {
    evaluate(f_, t + h * at, value_);
    see(p.off_f, value_, p.f, there, p.unknown_f);
  }
  if (g_.bends()) {
    evaluate(g_, t + h * at, value_);
    see(p.off_g, value_, p.g, there, p.unknown_g);
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
    l.f.resize(f_.bends() ? SourceLooks::count : 0, f_.width);
    l.g.resize(g_.bends() ? SourceLooks::count : 0, g_.width);
  }
  if (l.known[std::size_t(k)]) return;
  if (f_.bends()) {
    evaluate(f_, at_time, value_);
    l.f.row(k) = value_.transpose();
  }
  if (g_.bends()) {
    evaluate(g_, at_time, value_);
    l.g.row(k) = value_.transpose();
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
    if (f_.bends()) see(p.off_f, looks_->f.row(k), p.f, there, p.unknown_f);
    if (g_.bends()) see(p.off_g, looks_->g.row(k), p.g, there, p.unknown_g);
  }
  return last - first + 1;
}

}  // namespace bromwich
