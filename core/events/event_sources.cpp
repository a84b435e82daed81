#include "core/events/event_sources.hpp"

#include <cmath>

namespace bromwich {

namespace {

// t is known to its last digit: on a step far shorter than t, such as the edge of a pulse, a steep source shows this.
// The last coefficients that are no larger are zero. Rounding of t and of what is computed from it, such as the place
// in a period: 4 eps t; times the slope 2 / h of a coefficient; times 4 for the coefficients of rounded values.
void drop_rounding_of_time(double t, double h, Matrix& c, Vector& off) {
  constexpr double seen = 1e-12;  // of a step: rounding of t below is not looked for
  const double rounding = 32 * epsilon * (t + h) / h;
  if (rounding < 32 * seen) return;
  for (Index i = 0; i < c.cols(); ++i) {
    const double unknown = rounding * c.col(i).tail(c.rows() - 1).cwiseAbs().sum();
    for (Index k = c.rows() - 1; k > 0 && std::abs(c(k, i)) <= unknown; --k) c(k, i) = 0;
    if (off[i] <= unknown) off[i] = 0;
  }
}

}  // namespace

EventSources::EventSources(const Scene& scene) : scene_(scene), m_(scene.states()), n_(scene.constraints()) {
  if (scene.f && scene.f_entry != SourceEntry::state) F_ = source_matrix(scene, *scene.dynamics->small_state());
}

Vector EventSources::f(double t) const {
  if (!scene_.f) return Vector::Zero(m_);
  Vector phi = Vector::Zero(scene_.sources());
  scene_.f(t, phi);
  return F_.size() > 0 ? Vector(F_ * phi) : phi;
}

Vector EventSources::g(double t) const {
  Vector v = Vector::Zero(n_);
  if (scene_.g) scene_.g(t, v);
  return v;
}

EventSources::Polynomials EventSources::sample(double t, double h) const {
  const Collocation& c = Collocation::get();
  const auto one = [&](bool given, Index width, const auto& value, Matrix& coefficients, Vector& off) {
    off = Vector::Zero(width);
    coefficients.setZero(c.samples.size(), width);
    if (!given) return;
    Matrix values(c.samples.size(), width);
    for (Index k = 0; k < c.samples.size(); ++k) values.row(k) = value(t + h * c.samples[k]).transpose();
    coefficients = c.from_samples * values;
    const Matrix expected = c.at_checks * coefficients;
    for (Index k = 0; k < c.checks.size(); ++k)
      off = off.cwiseMax((value(t + h * c.checks[k]) - expected.row(k).transpose()).cwiseAbs());
    drop_rounding_of_time(t, h, coefficients, off);
  };
  Polynomials p;
  one(
      bool(scene_.f), m_, [this](double at) { return f(at); }, p.f, p.off_f);
  one(
      bool(scene_.g), n_, [this](double at) { return g(at); }, p.g, p.off_g);
  return p;
}

void EventSources::look(double t, double h, double at, Polynomials& p) const {
  const Vector values = legendre(at);
  if (scene_.f) p.off_f = p.off_f.cwiseMax((f(t + h * at) - p.f.transpose() * values).cwiseAbs());
  if (scene_.g) p.off_g = p.off_g.cwiseMax((g(t + h * at) - p.g.transpose() * values).cwiseAbs());
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
