#pragma once
// Diffusion, reaction and constant advection on a line, a rectangle or a box of grid points, for scenes of one's own.

#include "grid_system.hpp"
#include "kronecker.hpp"
#include "linear_system.hpp"

#include <optional>
#include <vector>

namespace bromwich {

/// Condition on u at one end of a grid line.
/// Dirichlet (no value): u = 0 at the distance of one spacing from the last point.
/// Robin (a value a >= 0, 1/length): du/dn = -a u at the distance of half a spacing; Neumann: a = 0.
using EndCondition = std::optional<double>;
inline constexpr EndCondition dirichlet = std::nullopt;
inline constexpr EndCondition neumann = 0.0;

/// c u'' - v u' on equally spaced points, by central differences of second order.
struct GridLine {
  Index points = 0;
  double spacing = 0;      ///< dx
  double diffusivity = 0;  ///< c
  double advection = 0;    ///< v, positive from the first point to the last; |v| dx < 2 c
  EndCondition first = dirichlet, last = dirichlet;

  /// The spacing of `points` on a line of this length, from end to end.
  static double spacing_of(Index points, double length, EndCondition first, EndCondition last);
  /// points x points, tridiagonal.
  SparseMatrix matrix() const;
};

/// x' = (I ⊗ across + face ⊗ I - reaction I) x + B y, w = N x + ..., face = along ⊗ I + I ⊗ beside[0] + ... The index
/// of a state is line * across.points + position. Lines are counted with `along` slowest and the last direction of
/// `beside` fastest. The first constraints sit on the side of the first points of `across`, one per grid line; then
/// come those on the opposite side, if there are any. A line: one point along, Neumann at both its ends. A box has
/// directions beside `along`.
struct Rectangle {
  GridLine along;       ///< along the constrained sides
  GridLine across;      ///< of one grid line; `first` is what holds on the constrained side where y = 0
  double reaction = 0;  ///< r, 1/time
  Vector b, n;          ///< across.points: how y of a line drives its points, and what the constraint sees of them
  Vector far_b, far_n;  ///< the same of the opposite side, counted from there; empty: no constraints there

  bool written_out = false;  ///< as matrices in any case: F and sources of single states need them

  std::vector<GridLine> beside = {};  ///< further directions of the sides, of a box

  Index lines() const;
  Index states() const { return lines() * across.points; }
  Index sides() const { return far_b.size() > 0 ? 2 : 1; }
  /// KroneckerDynamics with the same A, or nothing. It takes diffusion without advection and no growth, constraints on
  /// one side, or on two that are alike: far_b = b, far_n = n, and equal conditions at both ends of `across`. With two
  /// sides, other than Dirichlet ends, or a reaction, it pays above 512 states; smaller scenes are dense, which all
  /// methods take.
  std::optional<KroneckerDynamics> in_modes() const;
  /// With constant advection: what makes the directions symmetric (SymmetricForm), or nothing. Its factors, along a
  /// direction of length L from e^{-vL/(4c)} to e^{vL/(4c)}, differ by a thousand at most, that is three digits. An end
  /// where material enters takes Dirichlet, or Robin with du/dn = -a u, a >= |v|/(2c) or a little less: less is a mode
  /// that lives at this end.
  std::optional<SymmetricForm> symmetric_form() const;
  /// Throws Error naming the first member whose value is wrong.
  void validate() const;
};

/// KroneckerDynamics where there are such (`in_modes`), SparseDynamics otherwise, which `solve` brings to their
/// symmetric form if they have one. Validates.
std::shared_ptr<LinearSystem> linear_system(Rectangle);

}  // namespace bromwich
