#pragma once
// Rows of changes with the sizes of their terms, for derivatives/switched_tape.hpp.

#include "../core/base/error.hpp"
#include "../core/events/mode.hpp"

#include <cmath>
#include <string>
#include <vector>

namespace bromwich {

namespace switched {

inline constexpr double near_switch = 1e-9;          ///< of T: switches and times that are nearer count as equal
inline constexpr double vanishing_component = 1e-7;  ///< of the size of a component
inline constexpr double agreed_at_switch = 1e-5;     ///< of its terms, what has to vanish at a switch to first order
inline const char* const other_switch_data = "change the data slightly";

[[noreturn]] inline void not_differentiable_at_switch(const std::string& found, const std::string& remedy) {
  throw Error("derivative", "not differentiable here: " + found, remedy);
}

inline Jet sum_of_jets(const Jet& a, const Jet& b) {
  return {a.x + b.x, a.f + b.f, a.df + b.df, a.g + b.g, a.dg + b.dg, a.ddg + b.ddg};
}

inline Jet absolute_jet(const Jet& c) {
  return {c.x.cwiseAbs(), c.f.cwiseAbs(), c.df.cwiseAbs(), c.g.cwiseAbs(), c.dg.cwiseAbs(), c.ddg.cwiseAbs()};
}

inline JetValues sizes_of(JetValues u) {
  for (Vector* v : {&u.x, &u.f, &u.df, &u.g, &u.dg, &u.ddg}) *v = v->cwiseAbs();
  return u;
}

/// c with the state replaced by D.
inline Jet composed_jet(const Jet& c, const Jet& D) {
  return {c.x * D.x, c.x * D.f + c.f, c.x * D.df + c.df, c.x * D.g + c.g, c.x * D.dg + c.dg, c.x * D.ddg + c.ddg};
}

inline bool small_against(const Matrix& value, const Matrix& terms) {
  if (value.size() == 0) return true;
  const double floor = 1e-9 * terms.maxCoeff();
  return ((value.cwiseAbs() - agreed_at_switch * (terms.array() + floor).matrix()).array() <= 0).all();
}

}  // namespace switched

/// A Jet, and the same with all terms by absolute value.
struct BoundedJet {
  Jet value, terms;

  static BoundedJet of(const Jet& c) { return {c, switched::absolute_jet(c)}; }
  static BoundedJet identity(Index m, Index n) {  ///< the state itself
    Jet x = Jet::zero(m, m, n);
    x.x.setIdentity();
    return of(x);
  }
  friend BoundedJet operator+(const BoundedJet& a, const BoundedJet& b) {
    return {switched::sum_of_jets(a.value, b.value), switched::sum_of_jets(a.terms, b.terms)};
  }
  friend BoundedJet operator*(const Matrix& left, const BoundedJet& c) {
    return {left * c.value, Matrix(left.cwiseAbs()) * c.terms};
  }
  BoundedJet after(const BoundedJet& D) const {
    return {switched::composed_jet(value, D.value), switched::composed_jet(terms, D.terms)};
  }
  /// Rows that do not change.
  void clear(const std::vector<Index>& rows) {
    for (Jet* jet : {&value, &terms})
      for (Matrix* block : {&jet->x, &jet->f, &jet->df, &jet->g, &jet->dg, &jet->ddg})
        for (const Index i : rows) block->row(i).setZero();
  }
  bool vanishes() const {
    using switched::small_against;
    return small_against(value.x, terms.x) && small_against(value.f, terms.f) && small_against(value.df, terms.df) &&
           small_against(value.g, terms.g) && small_against(value.dg, terms.dg) && small_against(value.ddg, terms.ddg);
  }
};

}  // namespace bromwich
