#include "mechanics/contact_spans.hpp"

#include "mechanics/source_values.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

// By differences of order four.
double slope(const TimeFunction& function, double t, double h) {
  if (!function) return 0;
  const auto at = [&](double s) { return value_of(function, s); };
  return (at(t - 2 * h) - 8 * at(t - h) + 8 * at(t + h) - at(t + 2 * h)) / (12 * h);
}

/// What acts at one contact, over a time or as an impulse.
struct Action {
  double normal = 0;
  Vector friction;
};

class Report {
 public:
  Report(const Mechanism& m, const ContactSpans& spans)
      : m_(m), s_(m.structure), d_(m.coordinates()), contacts_(m.contacts.size()) {
    found_.located = spans.located;
    found_.contacts.resize(contacts_);
    for (std::size_t i = 0; i < contacts_; ++i)
      found_.contacts[i].friction_impulse = Vector::Zero(m.contacts[i].tangent.rows());
    open_.resize(contacts_);
    found_.energy.initial = stored(spans.first, 0);
    for (const ContactSpan& span : spans.spans) add(span);
    for (std::size_t i = 0; i < contacts_; ++i) close_phase(i);
    found_.energy.stored = stored(spans.last, spans.spans.empty() ? 0 : spans.spans.back().end);
    finish();
  }

  ContactReport take() { return std::move(found_); }

 private:
  Vector velocity(const Vector& x) const { return x.segment(d_, d_); }

  // Kinetic, of K, and of the springs of contacts at t.
  double stored(const Vector& x, double t) const {
    const Vector q = x.head(d_), v = velocity(x);
    double energy = v.dot(s_.M * v) / 2;
    if (s_.K.size() > 0) energy += q.dot(s_.K * q) / 2;
    for (std::size_t i = 0; i < contacts_; ++i) {
      const Contact& c = m_.contacts[i];
      const ContactRows& r = m_.rows[i];
      if (c.kn > 0) {
        const double gap = c.normal.dot(x.head(d_)) + value_of(c.gap, t);
        energy += c.kn * std::pow(std::min(gap, 0.0), 2) / 2;
      }
      if (r.state >= 0) energy += x[r.state] * x[r.state] / (2 * c.kt);
    }
    return energy;
  }

  Action action(std::size_t i, double t, const Vector& x, const Vector& y, double weight_of_bound) const {
    const ContactRows& r = m_.rows[i];
    Action a;
    if (r.normal >= 0) a.normal = y[r.normal];
    a.friction = m_.friction_forces(Vector{{t}}, x.transpose(), y.transpose())
                     .row(0)
                     .segment(first_tangent(i), tangents(i))
                     .transpose();
    // An impulse has no share of a bound that is a force.
    if (m_.contacts[i].bound && m_.contacts[i].facets == 0 && tangents(i) == 1 && r.state < 0 && r.friction >= 0)
      a.friction[0] += (1 - weight_of_bound) * value_of(m_.contacts[i].bound, t);
    return a;
  }
  Index tangents(std::size_t i) const { return m_.contacts[i].tangent.rows(); }
  Index first_tangent(std::size_t i) const {
    Index at = 0;
    for (std::size_t k = 0; k < i; ++k) at += tangents(k);
    return at;
  }

  void add(const ContactSpan& span) {
    for (const ContactSpan::Jump& jump : span.jumps) add_jump(span.begin, jump);
    for (const ContactSpan::Sample& sample : span.samples) add_sample(span, sample);
    for (std::size_t i = 0; i < contacts_; ++i) add_phase(i, span);
  }

  void add_sample(const ContactSpan& span, const ContactSpan::Sample& at) {
    MechanicalEnergy& e = found_.energy;
    const Vector q = at.x.head(d_), v = velocity(at.x);
    const double w = at.weight, h = 1e-3 * (span.end - span.begin);
    e.supplied += w * v.dot(values_of(s_.f, at.t, d_));
    if (s_.C.size() > 0) e.damping += w * v.dot(s_.C * v);
    if (s_.K.size() > 0) e.supplied -= w * (v.dot(s_.K * q) - q.dot(s_.K * v)) / 2;
    e.supplied += w * power_of_relays(at);
    for (std::size_t i = 0; i < contacts_; ++i) {
      const Contact& c = m_.contacts[i];
      ContactSummary& sum = found_.contacts[i];
      const Action a = action(i, at.t, at.x, at.y, 1);
      sum.normal_impulse += w * a.normal;
      sum.friction_impulse += w * a.friction;
      sum.largest_normal = std::max(sum.largest_normal, a.normal);
      const double moving = slope(c.gap, at.t, h);
      e.supplied -= w * a.normal * moving;
      // Steps of a grid hide impacts: what the normal force takes there.
      if (!found_.located && c.kn == 0 && c.normal.size() > 0)
        sum.impact_loss -= w * a.normal * (c.normal.dot(v) + moving);
      if (tangents(i) == 0) continue;
      const Vector V = values_of(c.velocity, at.t, tangents(i));
      e.supplied += w * a.friction.dot(V);
      sum.friction_loss += w * friction_power(i, at, a, Vector(c.tangent * v - V));
    }
  }

  // Of a Jenkins element the sliding part of its motion.
  double friction_power(std::size_t i, const ContactSpan::Sample& at, const Action& a, const Vector& sliding) const {
    const ContactRows& r = m_.rows[i];
    if (r.state >= 0) return -a.friction[0] * (at.y[r.friction] - at.y[r.friction + 1]);
    return -a.friction.dot(sliding);
  }

  double power_of_relays(const ContactSpan::Sample& at) const {
    const Index k = m_.scene.relays;
    if (k == 0) return 0;
    Vector bound = Vector::Ones(k);
    if (m_.relays.bound) m_.relays.bound(at.t, bound);
    return velocity(at.x).dot(m_.relays.B * (bound - 2 * at.y.head(k)));
  }

  // The work of an impulse is that of the mean velocity.
  void add_jump(double t, const ContactSpan::Jump& jump) {
    const Vector v = (velocity(jump.before) + velocity(jump.after)) / 2;
    const Vector x = (jump.before + jump.after) / 2;
    for (std::size_t i = 0; i < contacts_; ++i) {
      const Contact& c = m_.contacts[i];
      const ContactRows& r = m_.rows[i];
      ContactSummary& sum = found_.contacts[i];
      if (r.state >= 0) sum.friction_loss += x[r.state] * (jump.p[r.friction] - jump.p[r.friction + 1]);
      Action a = action(i, t, x, jump.p, 0);
      if (r.state >= 0) a.friction.setZero();
      if (a.normal == 0 && a.friction.isZero(0)) continue;
      const double moving = slope(c.gap, t, 1e-6 * s_.T);
      const Vector V = values_of(c.velocity, t, tangents(i));
      found_.energy.supplied += a.friction.dot(V) - a.normal * moving;
      const double loss = a.normal == 0 ? 0 : -a.normal * (c.normal.dot(v) + moving);
      const double of_friction = a.friction.size() == 0 ? 0 : -a.friction.dot(c.tangent * v - V);
      sum.normal_impulse += a.normal;
      sum.friction_impulse += a.friction;
      sum.impact_loss += loss;
      sum.friction_loss += of_friction;
      if (!jump.impact) continue;
      ++sum.impacts;
      found_.impacts.push_back({Index(i), t, a.normal, a.friction, loss, of_friction});
    }
  }

  ContactState state(std::size_t i, const std::vector<char>& active) const {
    const Contact& c = m_.contacts[i];
    const ContactRows& r = m_.rows[i];
    const auto on = [&](Index row) { return active[std::size_t(row)] != 0; };
    if (r.normal >= 0 && !on(r.normal)) return ContactState::open;
    if (r.friction < 0) return ContactState::slip;
    const bool slips = r.state >= 0       ? on(r.friction) || on(r.friction + 1)
                       : c.facets > 0     ? on(r.friction + c.facets)
                       : tangents(i) == 2 ? on(r.friction)
                                          : !on(r.friction) || on(r.friction + 1);
    return slips ? ContactState::slip : ContactState::stick;
  }

  void add_phase(std::size_t i, const ContactSpan& span) {
    const ContactState now = state(i, span.active);
    if (ContactPhase& phase = open_[i]; phase.end > phase.begin && phase.state == now) {
      phase.end = span.end;
      return;
    }
    close_phase(i);
    open_[i] = {Index(i), span.begin, span.end, now};
  }

  void close_phase(std::size_t i) {
    const ContactPhase& phase = open_[i];
    if (!(phase.end > phase.begin)) return;
    ContactSummary& sum = found_.contacts[i];
    (phase.state == ContactState::open    ? sum.open
     : phase.state == ContactState::stick ? sum.stick
                                          : sum.slip) += phase.end - phase.begin;
    found_.phases.push_back(phase);
  }

  void finish() {
    MechanicalEnergy& e = found_.energy;
    for (const ContactSummary& c : found_.contacts) e.friction += c.friction_loss, e.impacts += c.impact_loss;
    const double size = std::max({std::abs(e.initial), std::abs(e.supplied), std::abs(e.stored), std::abs(e.damping),
                                  std::abs(e.friction), std::abs(e.impacts)});
    const double off = e.initial + e.supplied - e.stored - e.damping - e.friction - e.impacts;
    e.error = size > 0 ? std::abs(off) / size : 0;
    std::stable_sort(found_.phases.begin(), found_.phases.end(),
                     [](const ContactPhase& a, const ContactPhase& b) { return a.contact < b.contact; });
  }

  const Mechanism& m_;
  const Structure& s_;
  Index d_;
  std::size_t contacts_;
  std::vector<ContactPhase> open_;
  ContactReport found_;
};

}  // namespace

bool has_contact_report(const Mechanism& m, const Result& r) {
  return r.status == Status::solved && r.x.cols() == m.scene.states() && (r.located || r.t.size() == r.steps + 1);
}

ContactReport contact_report(const Mechanism& m, const Result& r) { return Report(m, contact_spans(m, r)).take(); }

}  // namespace bromwich
