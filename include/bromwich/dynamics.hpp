#pragma once
// Linear dynamics E x' = A x + B y and their output to the constraints, N x. E has to be regular; by default it is the
// identity. They are given as one of these structs, its kind: dense or sparse matrices, diffusion on a line, a
// rectangle or a box of grid points, or callbacks that solve.

#include "error.hpp"
#include "types.hpp"

#include <concepts>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

class FaceBasis;
class LinearSystem;
struct SymmetricForm;

/// A, B, N and E as dense matrices.
struct DenseDynamics {
  Matrix A;       ///< m x m
  Matrix B;       ///< m x n
  Matrix N;       ///< n x m
  Matrix E = {};  ///< m x m, or empty
};

std::shared_ptr<LinearSystem> linear_system(DenseDynamics);

/// A, B, N and E as sparse matrices: many states (10^5 and more), few constraints. Such scenes are solved through their
/// kernel (shifted sparse solves) or by stepping the state with one sparse factorization.
struct SparseDynamics {
  SparseMatrix A;       ///< m x m
  SparseMatrix B;       ///< m x n
  SparseMatrix N;       ///< n x m
  SparseMatrix E = {};  ///< m x m, or empty
};

std::shared_ptr<LinearSystem> linear_system(SparseDynamics);

/// c/dx^2 tridiag(1, -2, 1) - r I with `points` rows: the second difference on one grid line, with homogeneous
/// Dirichlet ends unless `first` and `last` say otherwise. It is symmetric for all ends.
struct SecondDifference {
  Index points = 0;
  double spacing = 0;      ///< dx
  double diffusivity = 0;  ///< c
  /// Reflections q at the ends: the value beyond an end is q times that of the last point, -1 < q <= 1. 0: Dirichlet,
  /// at the distance dx; 1: Neumann, (1 - a dx/2)/(1 + a dx/2): Robin du/dn = -a u, both at dx/2.
  double first = 0, last = 0;
  double decay = 0;  ///< r, 1/time

  /// Whether its eigenvectors are the sine vectors sqrt(2/(points+1)) sin(pi i k/(points+1)).
  bool has_sine_modes() const { return first == 0 && last == 0; }
  /// -4 c/dx^2 sin^2(theta_k/2) - r, k = 1..points, decreasing.
  Vector eigenvalues() const;
  /// Q, points x points: orthonormal eigenvectors in its columns, in the order of `eigenvalues`.
  Matrix modes() const;
  /// The same as the basis of a direction. Bases in use are shared.
  FaceBasis basis() const;
  /// Q^T v.
  Vector in_modes(const Vector& v) const;
};

/// A Kronecker sum of second differences on a box, A = I ⊗ across + face ⊗ I, face = along ⊗ I + I ⊗ beside[0] + ..., B
/// = I ⊗ b, N = I ⊗ n^T. The constraints are on one face of the box (one side of a rectangle), one for each grid line
/// across it, or on the opposite one, too. State index = face index * across.points + position on the line; the face
/// index counts points of `along` slowest and of the last direction of `beside` fastest. Transforms of each direction
/// diagonalise the face, sine transforms between Dirichlet ends and products with its modes elsewhere; the modes of one
/// line diagonalise what is left. So nothing of size m x m is ever formed.
///
/// Constraints on both faces. R counts the points of a line from the other end; a line that is the same from both has
/// R across R = across. With the two views x and R x of a line, their sum and their difference over sqrt(2), and those
/// of y and w of both faces,
///
///     v' = across v + (b ± R b) y,     w = n^T v + ...
///
/// So the two faces are one more direction of a face with twice as many lines, of two points and with the modes (1, 1)
/// and (1, -1) over sqrt(2), and the lines of its two modes differ in b alone: they make two families of lines.
struct KroneckerDynamics {
  SecondDifference along;                     ///< along the constrained side
  SecondDifference across;                    ///< points of one grid line, counted from the constrained face
  Vector b;                                   ///< across.points: input of y of a line to the line
  Vector n;                                   ///< across.points: output of the line to its constraint
  std::vector<SecondDifference> beside = {};  ///< further directions of the face; empty: a rectangle
  /// Constraints on the opposite face behind those on the first one, with the same b and n counted from there. The two
  /// ends of `across` are then equal.
  bool both_faces = false;

  std::vector<SecondDifference> face() const;  ///< all directions of one face
  FaceBasis face_basis() const;                ///< their modes, those of the two faces first if there are two
  Index lines() const;                         ///< the product of the extents
  Index face_points() const;                   ///< n: one for each line and each face
  Vector face_eigenvalues() const;             ///< n: the sums of one eigenvalue of each direction, for each mode

  Index families() const { return both_faces ? 2 : 1; }
  Index family(Index mode) const { return mode / lines(); }
  Vector input(Index family) const;  ///< b, or b + R b and b - R b
  /// K x families: `input` in the modes of a line.
  Matrix inputs_in_modes() const;
  /// Numbers of a line, K x 1 or K x families, for the line of each mode: K x n.
  RowMatrix of_modes(const Matrix& of_families) const;
  /// x, n x across.points by rows: the lines as seen from each face.
  Vector views(const Vector& x) const;
};

std::shared_ptr<LinearSystem> linear_system(KroneckerDynamics);

/// A contour has to enclose the eigenvalues, which lie in the sector |arg(abscissa - z)| <= half_angle.
struct SpectralBound {
  double half_angle = 0;  ///< radians, 0: real eigenvalues
  double abscissa = 0;    ///< largest real part
};

/// Returns (zE - A)^{-1} R for its z; R is m x k.
using ShiftedSolve = std::function<ComplexMatrix(const ComplexMatrix& R)>;

/// Dynamics given by callbacks: matrix-free operators, solvers of a finite-element code, transforms. They are treated
/// like sparse dynamics, through the kernel N (zE - A)^{-1} B at the nodes of contours, or by stepping the state with
/// one prepared solve. `solve` passes exceptions of the callbacks on.
struct SuppliedDynamics {
  Index states = 0;  ///< m
  SparseMatrix B;    ///< m x n
  SparseMatrix N;    ///< n x m
  /// Prepares the solve for a shift z, for example by a factorization. Called for all nodes of the contours, a few
  /// hundred z in the right half-plane and around the spectrum, but not for their conjugates. If z is an eigenvalue,
  /// throw SingularShift or return values that are not finite.
  std::function<ShiftedSolve(Complex z)> shifted;
  /// E X for X m x k; empty: E = I.
  std::function<Matrix(const Matrix& X)> mass = {};
  /// Bound of the eigenvalues of E^{-1} A; if empty, estimated by shifted solves.
  std::optional<SpectralBound> bound = {};
  /// `shifted` and the functions it returns may be called from several threads at once. Otherwise all calls come from
  /// the thread that called `solve`.
  bool thread_safe = false;
};

std::shared_ptr<LinearSystem> linear_system(SuppliedDynamics);

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

/// A struct is a kind of dynamics if `linear_system` makes a LinearSystem from it.
template <class Kind>
concept DynamicsKind = requires(Kind values) {
  { linear_system(std::move(values)) } -> std::same_as<std::shared_ptr<LinearSystem>>;
};

/// Dynamics of any kind, a value. Copies share the matrices until one of them is changed.
class Dynamics {
 public:
  Dynamics() : Dynamics(DenseDynamics{}) {}
  template <DynamicsKind Kind>
  Dynamics(Kind values) : system_(linear_system(std::move(values))) {}
  /// Any other implementation; it must not change afterwards.
  explicit Dynamics(std::shared_ptr<LinearSystem> system) : system_(std::move(system)) {}

  Dynamics(const Dynamics& other) : system_(other.copied()) {}
  Dynamics(Dynamics&&) = default;
  Dynamics& operator=(const Dynamics& other) { return *this = Dynamics(other); }
  Dynamics& operator=(Dynamics&&) = default;
  ~Dynamics() = default;

  const LinearSystem& operator*() const { return *system_; }
  const LinearSystem* operator->() const { return system_.get(); }

  /// The struct from which these dynamics were made, or null if it was one of another kind. For code that makes or
  /// shows scenes; methods ask for capabilities.
  template <DynamicsKind Kind>
  const Kind* made_from() const;
  /// The same, to change values. Copies of the dynamics keep theirs.
  template <DynamicsKind Kind>
  Kind* made_from();

 private:
  std::shared_ptr<LinearSystem> copied() const { return copy_ ? copy_(*system_) : system_; }

  std::shared_ptr<LinearSystem> system_;
  std::shared_ptr<LinearSystem> (*copy_)(const LinearSystem&) = nullptr;  ///< set once values may be changed
};

template <DynamicsKind Kind>
bool holds(const Dynamics& dynamics) {
  return dynamics.made_from<Kind>() != nullptr;
}
template <DynamicsKind Kind>
const Kind* get_if(const Dynamics* dynamics) {
  return dynamics->made_from<Kind>();
}
template <DynamicsKind Kind>
Kind* get_if(Dynamics* dynamics) {
  return dynamics->made_from<Kind>();
}
/// Throws Error if the dynamics were made from a struct of another kind.
template <DynamicsKind Kind>
const Kind& get(const Dynamics& dynamics) {
  if (const Kind* values = get_if<Kind>(&dynamics)) return *values;
  throw Error("dynamics", "are of another kind", "ask with holds<Kind>(dynamics) first");
}
template <DynamicsKind Kind>
Kind& get(Dynamics& dynamics) {
  if (Kind* values = get_if<Kind>(&dynamics)) return *values;
  throw Error("dynamics", "are of another kind", "ask with holds<Kind>(dynamics) first");
}

}  // namespace bromwich
