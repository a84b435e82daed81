// How the state comes onto the constraints of a mode: by an impulse, or because it rests there.
#include "core/events/successor.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr double nothing = 1e-6;  ///< parts of an impulse below this share of it are zero
constexpr double near_zero = 16;  ///< of what counts as zero of w: what would rise to that may not be seen to rise

}  // namespace

// What holds for all active sets that are tried at an impact.
Successor::Impact Successor::impact_at(const EventPoint& p) const {
  const Index n = system_.constraints();
  Impact impact{system_.restitution, {}, {}, {}, Vector::Zero(n)};
  SwitchedMode all;
  all.uses_df = all.uses_dg = all.uses_ddg = true;
  JetValues size, u = sources_at(all, p, size);
  const Jet rates = rates_of_w(system_);
  impact.velocity = evaluate(rates, u);
  const Vector of_velocity = terms(rates, size);
  impact.rounding = 30 * steps_.noise() * of_velocity;
  impact.exact = 64 * epsilon * of_velocity + rates.x.cwiseAbs() * steps_.rounding_of_x(p.sizes);
  if (p.zero_w.size() == 0) return impact;
  u.x = system_.A * p.x + system_.B * p.y + u.f, u.f = u.df, u.g = u.dg, u.dg = u.ddg;
  const Vector rate = evaluate(rates, u);
  for (Index i = 0; i < n; ++i) {
    if (!(opens_[i] > 0)) continue;
    const double falls = std::max(0.0, opens_[i] * p.y[i] - rate[i]);  // -w_i'' without y_i
    impact.unseen[i] = std::sqrt(2 * falls * near_zero * p.zero_w[i]);
    if (impact.e.size() > 0 && impact.e[i] * std::abs(impact.velocity[i]) <= impact.unseen[i]) impact.e[i] = 0;
  }
  return impact;
}

// e w' of constraints with w = `offset`, that is 0, which w' < 0 is about to violate.
Vector Successor::rebounds_of_touching(const EventPoint& p, const Vector& offset) const {
  Vector found = Vector::Zero(offset.size());
  if (system_.restitution.size() == 0) return found;
  const Impact impact = impact_at(p);
  const Vector w = system_.N * p.x + sources_.g(p.t + 1e-15 * T_);
  for (Index i = 0; i < found.size(); ++i)
    if (w[i] == offset[i] && impact.velocity[i] < 0) found[i] = impact.e[i] * impact.velocity[i];
  return found;
}

// The values of x, f and g, and the derivatives that the mode needs, at the begin of the next step. They are those of
// polynomials, known to rounding of the largest values so far and on the step: `size`.
JetValues Successor::sources_at(const SwitchedMode& mode, const EventPoint& p, JetValues& size) const {
  EventStep here;
  const double h = steps_.sample_resolved(mode, p, here);
  const LegendreValues at = legendre(0);
  const auto start = [&](const LegendreCoefficients& c, Index width) {
    return c.size() > 0 ? Vector(c.transpose() * at) : Vector(Vector::Zero(width));
  };
  const Index m = system_.states(), n = system_.constraints();
  const LegendreCoefficients dg = Collocation::get().derivative * here.sources.g / h;
  size = p.sizes.with(here).u;
  size.x = size.x.cwiseMax(p.x.cwiseAbs());
  size.dg = size.dg.cwiseMax(start(dg, n).cwiseAbs());
  return {p.x, start(here.sources.f, m), start(here.df, m), start(here.sources.g, n), start(dg, n), start(here.ddg, n)};
}

// Contacts that the state touches and that fall back before they are seen to be open: they rest, and an impulse of any
// sign, as small as that, takes their velocity.
void Successor::settle(EventPoint& p, bool y_is_known) {
  if (opens_.isZero(0) || p.zero_w.size() == 0) return;
  const Vector offset = touching(p, y_is_known);
  const Impact impact = impact_at(p);
  const Vector w = system_.N * p.x + sources_.g(p.t + 1e-15 * T_);
  std::vector<Index> rest;
  for (Index i = 0; i < offset.size(); ++i)
    if (w[i] == offset[i] && impact.is_unseen(i)) rest.push_back(i);
  const auto any_above = [&](const Vector& zero) {
    return ((impact.velocity.cwiseAbs() - zero)(rest).array() > 0).any();
  };
  if (!any_above(impact.exact)) return;
  Vector impulse = Vector::Zero(offset.size());
  const Vector found =
      Eigen::CompleteOrthogonalDecomposition<Matrix>(NAB_(rest, rest)).solve(Vector(-impact.velocity(rest)));
  impulse(rest) = found;
  p.x += system_.B * impulse;
  p.integral += impulse;
  if (any_above(impact.rounding)) impulses_.push_back({rest, impulse});
}

bool Successor::may_jump(const SwitchedMode& mode, const JetValues& u, const Vector& zero, const Vector& impulse,
                         const Vector& bounce) const {
  // What no impulse moves has to hold; the jump has rounding of its own.
  JetValues after = u;
  after.x += system_.B * impulse;
  const Vector left = evaluate(mode.constraints, after) + bounce;
  if (((left.cwiseAbs() - 4 * zero).array() > 0).any()) return false;
  // Impulses of y and of w are nonnegative.
  if ((impulse.array() < -nothing * impulse.cwiseAbs().maxCoeff()).any()) return false;
  const Vector of_w = system_.M * impulse, terms_of_w = system_.M.cwiseAbs() * impulse.cwiseAbs();
  return !((of_w + nothing * terms_of_w).array() < 0).any();
}

// While an impulse p acts, y is p / h and w is M p / h within a short time h: p and M p have to be complementary to w
// and y behind it. Those w_i with p_i > 0 and y_i with (M p)_i > 0 are zero in the mode. The others have to be
// nonnegative, and what p or M p hides may have any sign: then the mode may end at once.
bool Successor::holds_behind(const SwitchedMode& mode, EventPoint& p, const Vector& impulse) {
  const Vector of_w = system_.M * impulse, terms_of_w = system_.M.cwiseAbs() * impulse.cwiseAbs();
  const double size = impulse.cwiseAbs().maxCoeff();
  std::vector<char> hidden(std::size_t(impulse.size()));
  for (Index i = 0; i < impulse.size(); ++i)
    hidden[std::size_t(i)] = impulse[i] > nothing * size || of_w[i] > nothing * terms_of_w[i];
  if (!opens_.isZero(0)) {
    const Impact after = impact_at(p);
    for (Index i = 0; i < impulse.size(); ++i) hidden[std::size_t(i)] |= char(after.is_unseen(i));
  }
  EventStep behind;
  return steps_.resolve(mode, p, behind, &hidden) && !behind.at_once;
}

// Brings the state onto the constraints of the mode by an impulse.
Successor::Entry Successor::enter(const SwitchedMode& mode, EventPoint& p) {
  if (mode.constraints.x.rows() == 0) return Entry::smooth;
  JetValues size;
  const JetValues u = sources_at(mode, p, size);
  const Vector off = evaluate(mode.constraints, u);
  const Vector rounding = mode.constraints.x.cwiseAbs() * steps_.rounding_of_x(p.sizes);
  const Vector zero = 30 * steps_.noise() * terms(mode.constraints, size) + rounding;
  bool jumps = ((off.cwiseAbs() - zero).array() > 0).any();
  Impact impact;
  if (jumps) impact = impact_at(p);
  Vector bounce = Vector::Zero(off.size());
  if (impact.e.size() > 0) bounce = mode.velocities * impact.e.cwiseProduct(impact.velocity);
  Vector impulse = mode.impulse * (off + bounce);
  // Parts of a jump that constraints which hold would explain have no sign.
  if (jumps) impulse = (impulse.cwiseAbs().array() > (mode.impulse.cwiseAbs() * zero).array()).select(impulse, 0);
  if (jumps && !may_jump(mode, u, zero, impulse, bounce)) return Entry::refused;
  jumps = jumps && !impulse.isZero(0);  // what is off is rounding that no impulse moves, a place at a stop say
  const Vector before = p.x;
  p.x += system_.B * impulse;
  if (jumps && !holds_behind(mode, p, impulse)) {
    p.x = before;
    return Entry::refused;
  }
  p.integral += impulse;
  if (!jumps) return Entry::smooth;
  impulses_.push_back({mode.active, impulse, impact.e});
  p.sizes.include_x(p.x);
  return Entry::jumped;
}

}  // namespace bromwich
