// Switches of a SwitchedTape: the change of the state at each, and what has to stay zero there.

#include "core/base/text.hpp"
#include "derivatives/switched_tape.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

using namespace switched;

namespace {

constexpr double left_of_larger = 1e-5;   ///< 1e-10 with agreed_at_switch, ten times the tolerance of the integration
constexpr double left_of_sources = 1e-2;  ///< 1e-7 likewise, how far changes of f and g are from lines

std::string rest_in_words(Index i, double from) {
  return text("y_%ld = w_%ld = 0 from t = %.6g on, and has to stay so", long(i), long(i), from);
}

}  // namespace

// The change of the state after the switch, as rows of that before; dt is one row.
SwitchedTape::Bounded SwitchedTape::saltation(const Switch& s, const Piece* before, Bounded& dt) const {
  Bounded D = before ? before->mode->kept : Bounded::identity(m_, n_);
  dt = Bounded::of(Jet::zero(1, m_, n_));
  if (s.moves) {
    dt = Matrix{{-1 / s.rate}} * Bounded::of(s.row).after(D);
    D = D + Matrix(s.rate_before) * dt;
  }
  D.clear(s.set);
  for (const Impulse& p : s.impulses) {
    const SwitchedMode& mode = p.mode->rows;
    const Matrix& B = p.mode->system().B;
    Bounded moved = D;
    if (s.moves) moved = D + Matrix(-p.rate) * dt;
    const Bounded off = Bounded::of(mode.constraints).after(moved) + Bounded::of(p.rebound).after(D),
                  impulse = mode.impulse * (off + Matrix(p.rebound_rate) * dt);
    for (const Index i : mode.active) {
      if (std::abs(p.p[i]) > vanishing_component * p.p.cwiseAbs().maxCoeff()) continue;
      const Matrix row = Matrix::Identity(n_, n_).row(i);
      if (!(row * impulse).vanishes())
        not_differentiable_at_switch(text("the impulse of constraint %ld vanishes at t = %.6g", long(i), s.t),
                                     other_switch_data);
    }
    D = D + B * impulse;
  }
  if (s.moves) D = D + Matrix(-s.rate_after) * dt;
  return D;
}

// `rows`: what has to stay zero, of the state before the switch. `at_start`: of x0 itself.
void SwitchedTape::add_condition(const std::string& found, const Bounded& rows, bool at_start) {
  if (only_along_.empty()) only_along_ = found;
  const bool by_state = !small_against(rows.value.x, rows.terms.x), by_all = by_state && !at_start;
  conditioned_.start |= by_all || by_state;
  conditioned_.rates |=
      by_all || !small_against(rows.value.f, rows.terms.f) || !small_against(rows.value.df, rows.terms.df);
  conditioned_.rows |= by_all || !small_against(rows.value.g, rows.terms.g) ||
                       !small_against(rows.value.dg, rows.terms.dg) || !small_against(rows.value.ddg, rows.terms.ddg);
}

// Whether the set after the switch stays the one after it: what vanishes there has to vanish with it, for all changes
// or as a condition on them.
void SwitchedTape::check(Switch& s, const Piece* before, const Piece& after) {
  const Matrix& derivative = Collocation::get().derivative;
  const auto condition = [&](const Condition& c, const Bounded& rows) {
    // Impacts one after the other lead to other states than those at once, however short the time between them. What
    // does not depend on the state, as the friction of an open contact, does not impact.
    const bool impacts = s.moves && !s.impulses.empty() && !small_against(rows.value.x, rows.terms.x);
    if (!along_some_ || impacts)
      not_differentiable_at_switch(c.found, impacts ? "" : "take derivatives along changes that keep it so");
    add_condition(c.found, rows, !before && s.impulses.empty());
    s.conditions.push_back(c);
  };
  const auto rate_of_component = [&](const Piece& p, double at, Index i) {
    return legendre(at).dot(derivative * polynomial(p, i)) / p.length;
  };
  Bounded dt;
  const Bounded D = saltation(s, before, dt);
  const auto check_component = [&](bool first, const Piece& p, double at, Index i, const Bounded& state) {
    if (!vanishes(p, at, i) || is_alike_beyond(*p.mode, i)) return;
    const double rate = rate_of_component(p, at, i);
    Bounded c = component(*p.mode, i).after(state);
    // A rate that is only rounding has the terms of one that is not.
    if (s.moves) {
      c.value = sum_of_jets(c.value, Matrix{{rate}} * dt.value);
      c.terms = sum_of_jets(c.terms, Matrix{{std::max(std::abs(rate), size_of(p, i) / T_)}} * dt.terms);
    }
    if (c.vanishes()) return;
    condition({first, i, rate,
               text("y_%ld = w_%ld = 0 at t = %.6g, where another constraint switches or the data change", long(i),
                    long(i), s.t)},
              c);
  };
  if (before) {
    Switch none;
    Bounded no_dt;
    const Bounded state = saltation(none, before, no_dt);
    for (Index i = 0; i < n_; ++i)
      if (i != s.component) check_component(true, *before, before->until, i, state);
  }
  for (Index i = 0; i < n_; ++i) check_component(false, after, 0, i, D);
  const SwitchedMode& mode = after.mode->rows;
  if (mode.constraints.x.rows() == 0) return;
  if (const Bounded rows = Bounded::of(mode.constraints).after(D); !rows.vanishes())
    condition({false, -1, 0, text("the state meets several constraints at once at t = %.6g", s.t)}, rows);
}

// Of a change of the state: what is left of larger ones is zero to the accuracy of the integration.
Vector SwitchedTape::terms_of(const State& z) {
  return z.largest.size() > 0 ? Vector(z.x.cwiseAbs() + left_of_larger * z.largest) : Vector(z.x.cwiseAbs());
}

// Throws where rows of a change are not zero: x and the sources there, what x is made of, and what else is added to
// the first row, with its terms. `found`: the reason.
void SwitchedTape::check_zero(const Bounded& rows, const Sources& sources, JetValues u, const Vector& terms_of_x,
                              double added, double terms_added, const std::string& found) const {
  Vector value = evaluate(rows.value, u);
  u = sizes_of(std::move(u));
  u.f += left_of_sources * sources.terms_of_f;
  u.g += left_of_sources * sources.terms_of_g;
  u.x = terms_of_x;
  Vector size = terms(rows.terms, u);
  if (value.size() > 0) value[0] += added, size[0] += terms_added;
  if (((value.cwiseAbs() - agreed_at_switch * size).array() > 0).any())
    not_differentiable_at_switch(found, "ask for a change that keeps it so");
}

// The conditions of one side of a switch with a change: x of the state there, and what it is made of.
void SwitchedTape::check_conditions(const Switch& s, bool before, const Piece& p, double at, const Sources& sources,
                                    const Vector& x, const Vector& terms_of_x, double dt) const {
  for (const Condition& c : s.conditions) {
    if (c.before != before) continue;
    const bool alone = c.component >= 0;
    JetValues u = values_of(sources, p, at);
    u.x = x;
    const double rate = alone ? std::max(std::abs(c.rate), size_of(p, c.component) / T_) : 0;
    check_zero(alone ? component(*p.mode, c.component) : Bounded::of(p.mode->rows.constraints), sources, u, terms_of_x,
               alone ? c.rate * dt : 0, rate * std::abs(dt), c.found);
  }
}

// What rests at this share of a part, with the change z there.
void SwitchedTape::check_rest(const Part& part, double share, const Sources& sources, const State& z) const {
  const Piece& p = piece_of(part);
  for (const Index i : part.rests) {
    const Bounded rows = component(*p.mode, i).after(p.mode->kept);
    JetValues u = values_of(sources, p, part.from + share * part.width);
    u.x = z.x;
    check_zero(rows, sources, u, terms_of(z), 0, 0, rest_in_words(i, p.begin));
  }
}

}  // namespace bromwich
