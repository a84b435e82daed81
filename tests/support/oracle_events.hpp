#pragma once
// An independent event-located solution of small systems (n <= 6) whose sources are smooth between known times.
//
// Between events the active set S is constant, and x' = A_S x + f_S is solved by collocation of order 19 with steps so
// short that the last coefficients of x, f and g are below 1e-12. An event is a root of the polynomial of some y_i or
// w_i. At events and breakpoints all active sets are tried, and those whose y and w do not become negative continue. If
// there is none, the state jumps (theory of passive systems: p in the kernel cone of M, N x+ + g in its dual). The
// result is undecided if two active sets lead to different states, if none continues, or if events accumulate.

#include "tests/support/oracle.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace bromwich::oracle {

struct EventScene {
  DenseScene scene;
  std::vector<double> breaks;  ///< times in (0, T) at which f or g jump or have a kink, increasing
  double longest_step = 0;     ///< short compared with the variation of sources between breakpoints; 0 = T
};

/// A piece of the solution: polynomials on [begin, begin + length], valid up to `end`.
struct EventPiece {
  double begin, length, end;
  unsigned set;
  Matrix x, y;      ///< Legendre coefficients, degree + 1 rows
  Vector integral;  ///< of y up to `begin`, including all impulses up to then
};

class EventSolution {
 public:
  bool decided = false;
  std::string reason;  ///< why it is undecided
  double until = 0;    ///< valid up to here
  long events = 0, jumps = 0;
  bool y_unique = true;  ///< no two active sets gave the same state with different y
  std::vector<EventPiece> pieces;
  Vector doubt;  ///< of each y_i what is not known: values of y and w below zero that were counted as zero
  Vector start;  ///< x(0) before a jump at t = 0

  /// Where a component jumps: the value from the left or from the right. The same for y, and its integral from 0.
  Vector x(double t, bool left = false) const { return at(t, left, &EventPiece::x); }
  Vector y(double t, bool left = false) const { return at(t, left, &EventPiece::y); }
  Vector integral(double t, bool left = false) const;
  /// Largest absolute values of every component, over all pieces and the start.
  Vector largest_x() const { return largest(&EventPiece::x).cwiseMax(start.cwiseAbs()); }
  Vector largest_y() const { return largest(&EventPiece::y); }
  Vector largest_integral() const;

 private:
  const EventPiece& piece(double t, bool left) const;
  Vector at(double t, bool left, Matrix EventPiece::*values) const;
  Vector largest(Matrix EventPiece::*values) const;
};

EventSolution locate_events(const EventScene&);

/// All data changed at random by the relative `size`, keeping zeros, symmetry, skewness, the rank of M, and N = B^T.
EventScene perturbed(const EventScene&, double size, std::uint32_t seed);

/// Distance of two solutions: every component relative to max(max_t |c_i|, 1e-3 of the largest component of its kind),
/// at `count` times. Infinite if one of them is undecided.
struct Apart {
  double x = 0, y = 0, mean = 0;
};
Apart apart(const EventSolution&, const EventSolution&, double T, Index count);

/// max(c_i, 1e-3 max_j c_j), the scale for errors of component i.
Vector measure(const Vector& largest);

}  // namespace bromwich::oracle
