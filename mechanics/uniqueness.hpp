#pragma once
// Whether the forces of contacts determine the motion: the problem of a short step in velocities.
//
// With W = [Hn; Ht] M^{-1} [Hn; Ht]^T every contact in a set is open, slips one way or the other, or sticks. Its force
// is then along Hn, Hn - mu Ht or Hn + mu Ht, along Ht alone, or along Hn and Ht, and it changes the rates of the gap,
// of the sliding velocity, or of both. The problem has one solution for all data if the determinants of these maps are
// positive for all choices: its matrix with eps on the diagonal of the slip rows is then of class P for every small
// eps. With one contact: Wnn > mu |Wnt|; the rod of Painlevé violates it.

#include "mechanism.hpp"

namespace bromwich {

enum class Uniqueness : char {
  unique,
  forces_open,  ///< determinants vanish, none is negative: contacts depend on each other, as two stops with one tangent
  none_known,   ///< there may be several solutions or none
  too_many,     ///< contacts, or facets: not tested
};

Uniqueness uniqueness(const Mechanism&);
/// unique, unique-motion, unknown, not-tested.
const char* to_string(Uniqueness);

}  // namespace bromwich
