#pragma once
// Steps along a branch of periodic states: F(z) = 0 with z = (x(0), p).
//
// The length of a step is that of dz / scale: the range of p, and multiples of the sizes of the states. With J = (E0 +
// ET D, dF/dp) in these variables, the tangent t has J t = 0, and a step of Newton's method from z to the plane n u = 0
// through it solves
//
//     J du = -F,   n du = 0     (pseudo-arclength: n the tangent of the last state, Keller 1977).
//
// Where friction holds, states come in families with stresses of their own: E0 + ET D is singular then for all p. Of
// these the one is followed that is farthest from all slip, the analytic centre of the family; du is of least norm, and
// the tangent is nearest to the last secant.
//
// dF/dp is a difference along the last tangent, unless this is across p: beside a grazing F is steep in all directions
// but the tangent's.

#include "orbits.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// A periodic state, and where the branch goes on.
struct BranchState {
  Orbit orbit;
  Vector by_p;     ///< m: dF/dp there or near
  Vector tangent;  ///< m+1, in scaled variables, of length 1
  Vector scale;    ///< m+1
  int newton = 0;  ///< steps of Newton's method
};

class BranchSteps {
 public:
  explicit BranchSteps(Orbits& orbits) : orbits_(orbits) {}

  /// From a periodic state near. `along`: m+1, in scaled variables: the tangent is nearest to this direction.
  std::optional<BranchState> first(Orbit, const Vector& along);
  /// The periodic state in the plane across the tangent through z = the state + length * scale * tangent. Nothing where
  /// Newton's method does not lead to one.
  std::optional<BranchState> next(const BranchState&, double length);
  /// The one near z with this p.
  std::optional<BranchState> at_parameter(const BranchState& near, double p);

  /// At a corner of the branch: a state on another piece of F that meets it there. Nothing where none is found.
  std::optional<BranchState> turned(const BranchState& corner, double length);

 private:
  Vector scale_of(const Orbit&) const;
  std::optional<Vector> by_parameter(const Orbit&, const Vector& tangent, const Vector& scale);
  BranchState state(Orbit, Vector by_p, const Vector& along, int newton) const;
  Matrix jacobian(const Orbit&, const Vector& by_p, const Vector& scale) const;
  std::optional<BranchState> with_tangent(Orbit, const Vector& along);
  std::optional<Orbit> centred(Orbit, const Vector& scale);
  std::optional<BranchState> correct(Vector z, const Vector& plane, const Vector& normal, const Vector& along,
                                     const BranchState& from);
  std::vector<BranchState> pieces_around(const BranchState& corner, double distance);

  Orbits& orbits_;
};

/// (x(0), p).
Vector place_of(const Orbit&);

}  // namespace bromwich
