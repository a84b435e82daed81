#include "core/scene/scene.hpp"

#include "core/base/require.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/memory.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

void validate(const BoundaryCondition& boundary, const Vector& x0, Index m) {
  if (x0.size() > 0) throw Error("x0", "is given with a boundary condition", "give one of the two");
  for (const auto& [name, E] : {std::pair("E0", &boundary.E0), std::pair("ET", &boundary.ET)}) {
    if (E->rows() != m || E->cols() != m)
      throw Error(name, "is " + std::to_string(E->rows()) + " x " + std::to_string(E->cols()),
                  "give " + std::to_string(m) + " x " + std::to_string(m) + ", one row and column per state");
    require_finite(name, *E);
  }
  require_length("b", boundary.b, m, "one per state");
  require_finite("b", boundary.b);
}

// Where y acts on w_i, or on its first derivative, w_i is no gap of rigid bodies: nothing bounces there.
void validate_restitution(const Scene& scene) {
  const Vector& e = scene.restitution;
  if (e.size() == 0) return;
  require_length("restitution", e, scene.constraints(), "one per constraint");
  const DenseDynamics* d = scene.dynamics->small_state();
  const Matrix M = d ? to_dense(scene.M) : Matrix();
  for (Index i = 0; i < e.size(); ++i) {
    const std::string row = "row " + std::to_string(i);
    if (!(e[i] >= 0 && e[i] <= 1)) throw Error("restitution", row + " is " + std::to_string(e[i]), "give 0 to 1");
    if (e[i] == 0 || !d) continue;
    const Vector moves = (d->N.row(i) * d->B).transpose(),
                 terms = (d->N.row(i).cwiseAbs() * d->B.cwiseAbs()).transpose();
    if (!M.row(i).isZero(0) || ((moves.cwiseAbs() - 64 * epsilon * terms).array() > 0).any())
      throw Error("restitution", row + ": y acts on w or on its first derivative",
                  "give it to rows of rigid contact, whose second derivative y acts on");
  }
}

void validate_cones(const Scene& scene) {
  const Index n = scene.constraints();
  std::vector<char> taken(std::size_t(n), 0);
  for (const FrictionCone& cone : scene.cones) {
    if (cone.first < 0 || cone.first + 3 > n)
      throw Error("cones", text("rows %td to %td of %td", cone.first, cone.first + 2, n), "rows are counted from 0");
    if (!(cone.mu >= 0 && std::isfinite(cone.mu)))
      throw Error("cones", text("mu is %g", cone.mu), "give a number >= 0");
    for (Index i = cone.first; i < cone.first + 3; ++i)
      if (std::exchange(taken[std::size_t(i)], 1))
        throw Error("cones", text("row %td is in two of them", i), "give each row to one cone");
  }
}

void validate_free_rows(const std::vector<Index>& rows, Index n) {
  Index before = -1;
  for (const Index i : rows) {
    if (i < 0 || i >= n)
      throw Error("free_rows", "row " + std::to_string(i) + " of " + std::to_string(n), "rows are counted from 0");
    if (i <= before)
      throw Error("free_rows", "row " + std::to_string(i) + " after row " + std::to_string(before),
                  "give each row once, in increasing order");
    before = i;
  }
}

void validate_breakpoints(const std::vector<double>& times, double T) {
  double before = -1;
  for (const double t : times) {
    if (!(t >= 0) || !(t <= T))
      throw Error("breakpoints", "found " + text("%.17g", t), "give times from 0 to T = " + text("%.17g", T));
    if (!(t > before))
      throw Error("breakpoints", text("found %.17g after %.17g", t, before),
                  "give each time once, in increasing order");
    before = t;
  }
}

void validate(const Matrix& M, Index n) {
  require_shape("M", M, n, n, "constraints x constraints");
  require_finite("M", M);
}

void validate(const SparseLcpMatrix& M, Index n) {
  require_shape("M", *M.entries, n, n, "constraints x constraints");
  require_finite("M", *M.entries);
}

void validate(const Tridiagonal& M, Index n) {
  const std::string meaning = "one per constraint";
  require_length("M.lower", M.lower, n, meaning);
  require_length("M.diagonal", M.diagonal, n, meaning);
  require_length("M.upper", M.upper, n, meaning);
  require_finite("M.lower", M.lower.tail(n - 1));  // lower[0] and upper[n-1] are not used
  require_finite("M.diagonal", M.diagonal);
  require_finite("M.upper", M.upper.head(n - 1));
}

/// The value at t = 0 must be written in full and finite.
void validate(const std::string& member, const TimeFunction& function, Index length) {
  if (!function) return;
  Vector value = Vector::Constant(length, std::numeric_limits<double>::quiet_NaN());
  function(0.0, value);
  require_finite(member + "(0)", value);
}

// s -> source(t + s)
TimeFunction from(double t, const TimeFunction& source) {
  if (!source) return source;
  if (const auto* separable = source.separable()) return SeparableSource{separable->shapes, from(t, separable->time)};
  return [source, t](double s, Eigen::Ref<Vector> value) { source(t + s, value); };
}

}  // namespace

Index Scene::states() const { return bromwich::states(dynamics); }
Index Scene::constraints() const { return bromwich::constraints(dynamics); }

Index Scene::steps() const {
  constexpr Index otherwise = 400;
  return default_steps > 0 ? default_steps : otherwise;
}
Index Scene::sources() const {
  if (f_entry == SourceEntry::through_F) return F.cols();
  return f_entry == SourceEntry::through_B ? constraints() : states();
}

Scene written_out(Scene scene) {
  scene.dynamics = to_dense(scene.dynamics);
  return scene;
}

Scene part_of(const Scene& scene, double t, double length, const Vector& x) {
  Scene part = scene;
  part.boundary.reset();
  part.x0 = x;
  part.T = length;
  change_each_source(part, [t](const TimeFunction& source) { return from(t, source); });
  part.breakpoints.clear();
  for (const double b : scene.breakpoints)
    if (b - t > 0 && b - t < length) part.breakpoints.push_back(b - t);
  return part;
}

Matrix source_matrix(const Scene& scene, const DenseDynamics& d) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  if (scene.f_entry == SourceEntry::through_B) return d.B;
  return Matrix::Identity(d.A.rows(), d.A.rows());
}

namespace {

/// Of the first guard; all rows behind it are guards.
Index first_guard(const Scene& scene) {
  Index first = scene.constraints();
  for (const Memory& memory : scene.memories)
    for (const Memory::Mode& mode : memory.modes)
      for (const Memory::Leave& leave : mode.leave)
        for (const Memory::Condition& c : leave.when)
          if (c.guard >= 0) first = std::min(first, c.guard);
  return first;
}

}  // namespace

Index guards(const Scene& scene) { return scene.constraints() - first_guard(scene); }

void Scene::validate() const {
  dynamics->validate(true);
  const Index m = states(), n = constraints();
  std::visit([n](const auto& matrix) { bromwich::validate(matrix, n); }, M);
  if (const auto reason = n > 0 ? contradiction(M, lcp_class) : std::nullopt)
    throw Error("lcp_class", std::string("says ") + to_string(lcp_class) + ", but " + *reason, "use auto");
  if (boundary)
    bromwich::validate(*boundary, x0, m);
  else
    validate_x0(x0);
  validate_free_rows(free_rows, n);
  validate_restitution(*this);
  validate_cones(*this);
  validate_memories(*this);
  require_positive("T", T);
  if (default_steps < 0) throw Error("default_steps", "is " + std::to_string(default_steps), "give 1 or more");
  if (!(default_tolerance >= 0 && default_tolerance < 1))
    throw Error("default_tolerance", "is " + std::to_string(default_tolerance), "give a number between 0 and 1");
  if (f_entry == SourceEntry::through_F) {
    if (F.rows() != m)
      throw Error("F", "has " + std::to_string(F.rows()) + " rows", "give " + std::to_string(m) + ", one per state");
    require_finite("F", F);
  } else if (F.size() > 0) {
    throw Error("F", "is given but f_entry does not use it", "set f_entry to through_F");
  }
  validate_sources();
}

void Scene::validate_x0(const Vector& values) const {
  require_length("x0", values, states(), "one per state");
  require_finite("x0", values);
}

void Scene::validate_sources() const {
  validate_breakpoints(breakpoints, T);
  if (f && f_entry != SourceEntry::through_B && dynamics->modes())
    throw Error("f", "enters the state of a Kronecker sum directly",
                "give phi with f = B phi and set f_entry to through_B, or write the dynamics densely");
  bromwich::validate("f", f, sources());
  bromwich::validate("g", g, constraints());
}

}  // namespace bromwich
