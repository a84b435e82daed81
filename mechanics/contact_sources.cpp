#include "mechanics/contact_sources.hpp"

#include "mechanics/contact_kinds.hpp"
#include "mechanics/source_values.hpp"

#include <algorithm>
#include <utility>

namespace bromwich {

namespace {

bool is_line(const TimeFunction& source) { return !source || source.linear(); }

template <class Values>
TimeFunction made_of(Values values, bool lines) {
  return lines ? TimeFunction(LinearSource{std::move(values)}) : TimeFunction(std::move(values));
}

// The rows of the friction of a contact, which are 0 before.
void put_friction(const Contact& c, const ContactRows& r, double t, Eigen::Ref<Vector> g) {
  if (r.state >= 0) {
    g.segment(r.friction, 2).setConstant(value_of(c.bound, t));
  } else if (c.facets > 0) {
    g.segment(r.friction, c.facets) = -directions(c.facets) * values_of(c.velocity, t, c.tangent.rows());
    g[r.friction + c.facets] = value_of(c.bound, t);
  } else {
    auto sliding = g.segment(is_circle(c) ? circle_row(r) : r.friction, c.tangent.rows());
    if (c.velocity) c.velocity(t, sliding);
    sliding *= -1;
    if (!is_circle(c))
      g[r.friction + 1] = 2 * value_of(c.bound, t);
    else if (r.normal < 0)
      g[r.friction] = -value_of(c.bound, t);
  }
}

}  // namespace

TimeFunction source_of_states(const Structure& s, const std::shared_ptr<const std::vector<Contact>>& contacts,
                              const std::vector<ContactRows>& rows, Index m,
                              const std::shared_ptr<const Eigen::LLT<Matrix>>& mass) {
  bool any = bool(s.f), lines = is_line(s.f);
  for (std::size_t i = 0; i < contacts->size(); ++i) {
    const Contact& c = (*contacts)[i];
    const bool by_spring = rows[i].state >= 0 && c.velocity, by_bound = shifts_by_bound(c, rows[i]);
    any = any || by_spring || by_bound;
    lines = lines && (!by_spring || is_line(c.velocity)) && (!by_bound || is_line(c.bound));
  }
  if (!any) return {};
  const auto values = [f = s.f, contacts, rows, d = s.M.rows(), mass, m](double t, Eigen::Ref<Vector> value) {
    value.setZero();
    auto forces = value.segment(d, d);
    if (f) f(t, forces);
    for (std::size_t i = 0; i < contacts->size(); ++i) {
      const Contact& c = (*contacts)[i];
      if (rows[i].state >= 0)
        value[rows[i].state] = -c.kt * value_of(c.velocity, t);
      else if (shifts_by_bound(c, rows[i]))
        forces -= value_of(c.bound, t) * c.tangent.row(0).transpose();
    }
    if (mass) mass->solveInPlace(forces);
  };
  return made_of(values, lines);
}

TimeFunction source_of_rows(const std::shared_ptr<const std::vector<Contact>>& contacts,
                            const std::vector<ContactRows>& rows) {
  bool any = false, lines = true;
  for (const Contact& c : *contacts) {
    any = any || c.gap || c.velocity || c.bound;
    lines = lines && is_line(c.gap) && is_line(c.velocity) && is_line(c.bound);
  }
  if (!any) return {};
  const auto values = [contacts, rows](double t, Eigen::Ref<Vector> g) {
    g.setZero();
    for (std::size_t i = 0; i < contacts->size(); ++i) {
      const Contact& c = (*contacts)[i];
      if (rows[i].normal >= 0) g[rows[i].normal] = value_of(c.gap, t);
      if (rows[i].friction >= 0) put_friction(c, rows[i], t, g);
    }
  };
  return made_of(values, lines);
}

}  // namespace bromwich
