#include "core/events/event_sources.hpp"

#include <cmath>

namespace bromwich {

namespace {

// t is known to its last digit: on a step far shorter than t, such as the edge of a pulse, a steep source shows this.
// Rounding of t and of what is computed from it, such as the place in a period: 4 eps t; times the slope 2 / h of a
// coefficient; times 4 for the coefficients of rounded values. Last coefficients that are no larger become zero.
Vector drop_rounding_of_time(double t, double h, LegendreCoefficients& c) {
  constexpr double seen = 1e-12;  // of a step: rounding of t below is not looked for
  const double rounding = 32 * epsilon * (t + h) / h;
  Vector unknown = Vector::Zero(c.cols());
  if (rounding < 32 * seen) return unknown;
  for (Index i = 0; i < c.cols(); ++i) {
    unknown[i] = rounding * c.col(i).tail(c.rows() - 1).cwiseAbs().sum();
    for (Index k = c.rows() - 1; k > 0 && std::abs(c(k, i)) <= unknown[i]; --k) c(k, i) = 0;
  }
  return unknown;
}

// The larger of the differences seen before and these, as far as they are no rounding.
void see(Vector& off, const Vector& value, const LegendreCoefficients& c, const LegendreValues& at,
         const Vector& unknown) {
  for (Index i = 0; i < off.size(); ++i) {
    const double difference = std::abs(value[i] - c.col(i).dot(at));
    if (difference > unknown[i]) off[i] = std::max(off[i], difference);
  }
}

}  // namespace

EventSources::EventSources(const Scene& scene) : scene_(scene), m_(scene.states()), n_(scene.constraints()) {
  if (scene.f && scene.f_entry != SourceEntry::state) F_ = source_matrix(scene, *scene.dynamics->small_state());
}

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
  const Collocation& c = Collocation::get();
  Vector value;
  const auto one = [&](bool given, Index width, const auto& evaluate, LegendreCoefficients& coefficients, Vector& off,
                       Vector& unknown) {
    off = unknown = Vector::Zero(width);
    coefficients.setZero(c.samples.size(), width);
    if (!given) return;
    LegendreCoefficients values(c.samples.size(), width);
    for (Index k = 0; k < c.samples.size(); ++k) {
      evaluate(t + h * c.samples[k]);
      values.row(k) = value.transpose();
    }
    const LegendreCoefficients exact = c.from_samples * values;
    coefficients = exact;
    unknown = drop_rounding_of_time(t, h, coefficients);
    for (Index k = 0; k < c.checks.size(); ++k) {
      evaluate(t + h * c.checks[k]);
      see(off, value, exact, c.at_checks.row(k).transpose(), unknown);
    }
  };
  Polynomials p;
  one(
      bool(scene_.f), m_, [&](double at) { value_of_f(at, value); }, p.f, p.off_f, p.unknown_f);
  one(
      bool(scene_.g), n_, [&](double at) { value_of_g(at, value); }, p.g, p.off_g, p.unknown_g);
  return p;
}

void EventSources::look(double t, double h, double at, Polynomials& p) const {
  const LegendreValues there = legendre(at);
  Vector value;
  if (scene_.f) {
    value_of_f(t + h * at, value);
    see(p.off_f, value, p.f, there, p.unknown_f);
  }
  if (scene_.g) {
    value_of_g(t + h * at, value);
    see(p.off_g, value, p.g, there, p.unknown_g);
  }
}

void EventSources::look_at_ends(double t, double h, Polynomials& p) const {
  constexpr double inside = 1e-11;  // of T: a jump at an end of the step, known to rounding, is not on the step
  const double at = inside * scene_.T / h;
  if (at > Collocation::get().samples[0]) return;
  look(t, h, at, p);
  look(t, h, 1 - at, p);
}

void EventSources::look_between(double t, double h, Index count, Polynomials& p) const {
  constexpr double golden = 0.6180339887498949;
  for (Index k = 0; k < count; ++k) {
    const double irregular = golden * double(k) - std::floor(golden * double(k));
    look(t, h, (double(k) + 0.1 + 0.8 * irregular) / double(count), p);
  }
}

}  // namespace bromwich
