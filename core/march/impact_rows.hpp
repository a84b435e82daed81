#pragma once
// The rows of a scene with rigid contacts, for problems at the level of velocities. With constant forces over a part of
// length d, and the flow D = 1/d ∫_0^d e^{sA} B ds, the unknowns are the impulses z = d y of forces and the other y
// themselves (z = y, columns of B that vanish):
//
//     kind    w                              its problem at the end of the part
//     gap     N x + g, N B = 0, M = 0        0 <= z  ⊥  w' = N A x + N f + g'       while the contact is closed
//     speed   N x + M y + g, M of forces 0   0 <= z  ⊥  w                           sliding, relays
//     room    M y + g, M of others 0         0 <= z  ⊥  M z + d (mean of g)         what is left of the bound of
//     friction
//     spring  N x + M y + g, N B = 0,        0 <= z  ⊥  M z / d + mean of both ends of N x + g
//             M diagonal                     contacts with a stiffness, which take no impulses
//
// Rows of friction on a circle are a gap, or a room for a bound that is given, and two speeds; their z is in a cone.
// x at the end is x_free + D z, so that the matrix M + [N A; N; 0] D has a limit as d -> 0: that of impulses.

#include "../scene/scene.hpp"

#include <optional>
#include <vector>

namespace bromwich {

struct ImpactRows {
  enum class Kind : char { gap, speed, room, spring };

  Index states() const { return A.rows(); }
  Index constraints() const { return M.rows(); }
  bool is(Index i, Kind k) const { return kind[std::size_t(i)] == k; }

  SparseMatrix A, B, N, NA;  ///< NA = N A
  SparseMatrix speeds;       ///< N A for gaps, N / 2 for springs, N for the others
  SparseMatrix onto;  ///< m x n: displacements that open gaps, in the direction of normal forces without friction
  Matrix M, NB;       ///< n x n; rows of gaps of NB are zero
  Matrix impulses;    ///< n x n: of problems of length 0, M + speeds B
  Vector e;           ///< n: coefficients of restitution
  std::vector<Kind> kind;
  std::vector<char> is_force;  ///< y_i moves the state

  /// Friction with a bound: the room is what the forces leave of it, -1 on a circle with a normal force. Without
  /// normals the bound is given.
  struct Friction {
    Index room;
    std::vector<Index> normals, forces;
    bool circle = false;
  };
  std::vector<Friction> friction;
  std::vector<FrictionCone> cones;
  std::vector<char> in_cone;  ///< n

  /// Rows of problems with these gaps closed. Friction of open contacts has none. `bounds`: means of g over a part, or
  /// null for impulses, which springs and a given bound do not take.
  std::vector<Index> acting(const std::vector<char>& closed, const Vector* bounds) const;
  /// Those of these rows that impulses on `struck`, some of them, reach.
  std::vector<Index> reached(const std::vector<Index>& rows, const std::vector<Index>& struck) const;
  /// n: what counts as 0 of the gaps of a state that is given, as rounding of g and of the states.
  Vector touching(const Vector& x, const Vector& g) const;
  /// Whether a problem of velocities has one solution: its limit for small parts is of class P, with any larger
  /// diagonal. False where it is not known, as with more than 16 rows that act on each other.
  bool have_one_solution() const;

 private:
  bool are_convex() const;
};

/// Nothing where the scene states neither coefficients of restitution (which may be 0) of rigid contacts nor friction
/// on circles, or has rows of other kinds, gaps of states that forces move directly, boundary values, free rows, or
/// dynamics without matrices or with a mass matrix.
std::optional<ImpactRows> impact_rows(const Scene&);

}  // namespace bromwich
