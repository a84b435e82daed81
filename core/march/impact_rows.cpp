#include "core/march/impact_rows.hpp"

#include "core/lcp/lcp_class.hpp"
#include "core/numerics/components.hpp"
#include "core/numerics/equilibration.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

using Kind = ImpactRows::Kind;

constexpr double rounding_of_NB = 64 * epsilon;  ///< of the terms of N B
constexpr double raised_for_P = 1e-9;            ///< of the diagonal, beside entries of 1
constexpr Index most_exact = 16;                 ///< rows whose principal minors are all computed

bool take_matrices(const Scene& scene, ImpactRows& r) {
  if (const DenseDynamics* d = scene.dynamics->small_state()) {
    if (d->E.size() > 0) return false;
    r.A = d->A.sparseView(0, 0), r.B = d->B.sparseView(0, 0), r.N = d->N.sparseView(0, 0);
    return true;
  }
  const SparseDynamics* s = scene.dynamics->matrices();
  if (!s || s->E.rows() > 0) return false;
  r.A = s->A, r.B = s->B, r.N = s->N;
  return true;
}

// Whether rows of a circle are a gap, or none where the bound is given, and two speeds.
bool fits_cone(const ImpactRows& r, const FrictionCone& cone) {
  return r.is(cone.first, cone.given ? Kind::room : Kind::gap) && r.is(cone.first + 1, Kind::speed) &&
         r.is(cone.first + 2, Kind::speed);
}

// Whether all rows are of these kinds, and at least one is a gap or of a circle.
bool take_kinds(ImpactRows& r) {
  const Index n = r.constraints();
  const Matrix terms = Matrix(SparseMatrix(r.N.cwiseAbs() * r.B.cwiseAbs()));
  const Vector of_N = r.N.cwiseAbs() * Vector::Ones(r.states()),
               of_B = r.B.cwiseAbs().transpose() * Vector::Ones(r.states());
  r.NB = (r.NB.cwiseAbs().array() > rounding_of_NB * terms.array()).select(r.NB, 0.0);
  for (Index j = 0; j < n; ++j) r.is_force.push_back(of_B[j] > 0);
  for (Index i = 0; i < n; ++i) {
    Vector of_forces = r.M.row(i).transpose(), of_others = of_forces;
    for (Index j = 0; j < n; ++j) (r.is_force[std::size_t(j)] ? of_others : of_forces)[j] = 0;
    const double own = std::exchange(of_forces[i], 0);
    const bool of_position = r.NB.row(i).isZero(0) && of_others.isZero(0) && of_forces.isZero(0);
    Kind kind = Kind::speed;
    if (of_N[i] == 0)
      kind = Kind::room;
    else if (of_position)
      kind = own > 0 ? Kind::spring : Kind::gap;
    const bool force = r.is_force[std::size_t(i)];
    const bool fits = kind == Kind::room    ? of_others.isZero(0) && !force
                      : kind == Kind::speed ? own == 0 && of_forces.isZero(0) && force
                                            : own >= 0 && force;
    r.kind.push_back(kind);
    if (!fits && !r.in_cone[std::size_t(i)]) return false;
  }
  for (const FrictionCone& cone : r.cones)
    if (!fits_cone(r, cone)) return false;
  return !r.cones.empty() || std::find(r.kind.begin(), r.kind.end(), Kind::gap) != r.kind.end();
}

void take_friction(ImpactRows& r) {
  for (Index i = 0; i < r.constraints(); ++i) {
    if (!r.is(i, Kind::room) || r.in_cone[std::size_t(i)]) continue;
    ImpactRows::Friction& f = r.friction.emplace_back(ImpactRows::Friction{i, {}, {}});
    for (Index j = 0; j < r.constraints(); ++j)
      if (r.M(i, j) != 0) (r.M(i, j) > 0 ? f.normals : f.forces).push_back(j);
  }
  for (const auto& [first, mu, given] : r.cones) {
    std::vector<Index> normals;
    if (!given) normals.push_back(first);
    r.friction.push_back({given ? first : -1, normals, {first + 1, first + 2}, true});
    r.is_force[std::size_t(first)] = 1;
  }
}

// Of the forces that friction allows, those in the middle add nothing along the contact. False where a gap sees states
// that forces move, or its force without friction does not open it.
bool take_displacements(ImpactRows& r) {
  Matrix b = Matrix(r.B);
  for (const ImpactRows::Friction& f : r.friction)
    for (const Index i : f.circle ? std::vector<Index>() : f.normals)
      for (const Index j : f.forces)
        b.col(i) -= r.M(f.room, i) / r.M(f.room, j) / (2 * double(f.forces.size())) * Matrix(r.B).col(j);
  const Vector moved = r.B.cwiseAbs() * Vector::Ones(r.constraints());
  for (Index i = 0; i < r.constraints(); ++i)
    if (!r.is(i, Kind::gap))
      b.col(i).setZero();
    else if ((Vector(r.N.row(i)).cwiseAbs().array() * moved.array() > 0).any())
      return false;
  const Matrix displaced =
      (moved.array() > 0).select(Vector::Zero(moved.size()), 1.0).matrix().asDiagonal() * (r.A * b);
  r.onto = displaced.sparseView(0, 0);
  const Vector opened = Matrix(r.N * displaced).diagonal();
  for (Index i = 0; i < r.constraints(); ++i)
    if (r.is(i, Kind::gap) && !(opened[i] > 0)) return false;
  return true;
}

}  // namespace

std::vector<Index> ImpactRows::acting(const std::vector<char>& closed, const Vector* bounds) const {
  std::vector<char> acts(kind.size());
  for (std::size_t i = 0; i < kind.size(); ++i)
    acts[i] = kind[i] == Kind::gap ? closed[i] : kind[i] != Kind::spring || bounds;
  for (const Friction& f : friction) {
    const bool driven = std::any_of(f.normals.begin(), f.normals.end(), [&](Index i) { return acts[std::size_t(i)]; });
    if (driven || (bounds && f.room >= 0 && (*bounds)[f.room] != 0)) continue;
    if (f.room >= 0) acts[std::size_t(f.room)] = 0;
    for (const Index j : f.forces) acts[std::size_t(j)] = 0;
  }
  std::vector<Index> rows;
  for (std::size_t i = 0; i < acts.size(); ++i)
    if (acts[i]) rows.push_back(Index(i));
  return rows;
}

std::vector<Index> ImpactRows::reached(const std::vector<Index>& rows, const std::vector<Index>& struck) const {
  const auto in_one_cone = [&](Index i, Index j) {
    return std::any_of(cones.begin(), cones.end(), [&](const FrictionCone& c) {
      return std::min(i, j) >= c.first && std::max(i, j) <= c.first + 2;
    });
  };
  const auto joined = [&](Index k, Index l) {
    const Index i = rows[std::size_t(k)], j = rows[std::size_t(l)];
    return impulses(i, j) != 0 || impulses(j, i) != 0 || in_one_cone(i, j);
  };
  std::vector<Index> found;
  for (const auto& members : connected_components(Index(rows.size()), joined, [](Index, Index) {})) {
    const auto is_struck = [&](Index k) {
      return std::find(struck.begin(), struck.end(), rows[std::size_t(k)]) != struck.end();
    };
    if (std::none_of(members.begin(), members.end(), is_struck)) continue;
    for (const Index k : members) found.push_back(rows[std::size_t(k)]);
  }
  std::sort(found.begin(), found.end());
  return found;
}

Vector ImpactRows::touching(const Vector& x, const Vector& g) const {
  constexpr double of_terms = 1e-9, of_states = 1e-12;
  const Vector size = x.cwiseAbs();
  const double largest = size.size() > 0 ? size.maxCoeff() : 0;
  return of_terms * (N.cwiseAbs() * size + g.cwiseAbs()) +
         of_states * largest * (N.cwiseAbs() * Vector::Ones(x.size()));
}

// Forces that minimise a convex function: no friction but that of given bounds. Velocities are unique then.
bool ImpactRows::are_convex() const {
  const auto planar = [](const Friction& f) { return !f.circle; };
  const auto pressed = [](const FrictionCone& cone) { return !cone.given && cone.mu > 0; };
  if (std::any_of(friction.begin(), friction.end(), planar) || std::any_of(cones.begin(), cones.end(), pressed))
    return false;
  const double largest = impulses.cwiseAbs().maxCoeff();
  return (impulses - impulses.transpose()).cwiseAbs().maxCoeff() <= 1e-12 * largest;
}

bool ImpactRows::have_one_solution() const {
  if (!cones.empty()) return are_convex();
  const auto joined = [&](Index i, Index j) { return impulses(i, j) != 0 || impulses(j, i) != 0; };
  for (const auto& rows : connected_components(constraints(), joined, [](Index, Index) {})) {
    if (Index(rows.size()) > most_exact) return false;
    const Matrix part = impulses(rows, rows);
    Matrix scaled_part = scaled(part, equilibrate(part));
    scaled_part.diagonal().array() += raised_for_P;
    if (!is_P_exact(scaled_part)) return false;
  }
  return true;
}

std::optional<ImpactRows> impact_rows(const Scene& scene) {
  ImpactRows r;
  if ((scene.restitution.size() == 0 && scene.cones.empty()) || scene.boundary || !scene.free_rows.empty() ||
      !scene.memories.empty())
    return std::nullopt;
  if (!take_matrices(scene, r)) return std::nullopt;
  r.M = to_dense(scene.M);
  r.e = scene.restitution.size() > 0 ? scene.restitution : Vector(Vector::Zero(r.constraints()));
  r.cones = scene.cones;
  r.in_cone.assign(std::size_t(r.constraints()), 0);
  for (const FrictionCone& cone : r.cones) std::fill_n(r.in_cone.begin() + cone.first, 3, 1);
  r.NA = r.N * r.A;
  r.NB = Matrix(r.N * r.B);
  if (!take_kinds(r)) return std::nullopt;
  take_friction(r);
  if (!take_displacements(r)) return std::nullopt;
  Vector of_A(r.constraints()), of_N(r.constraints());
  for (Index i = 0; i < of_A.size(); ++i) {
    of_A[i] = r.is(i, Kind::gap);
    of_N[i] = r.is(i, Kind::spring) ? 0.5 : 1 - of_A[i];
  }
  r.speeds = SparseMatrix(of_A.asDiagonal() * r.NA) + SparseMatrix(of_N.asDiagonal() * r.N);
  r.impulses = r.M + Matrix(r.speeds * r.B);
  return r;
}

}  // namespace bromwich
