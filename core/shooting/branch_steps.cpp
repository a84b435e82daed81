#include "core/shooting/branch_steps.hpp"

#include "core/shooting/flow_derivative.hpp"
#include "core/shooting/shooting_matrix.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double sizes_per_range =
    5;  ///< a step of a state by this share of its size is as long as one of p by the range
constexpr double least_size = 1e-3;  ///< of the largest state: sizes of others are at least that
constexpr double small_step = 1e-7;  ///< of the scales: the step after it is rounding
constexpr int most_newton = 8;
constexpr double slow_fall = 0.5;                        ///< of a step of Newton's method to the next, after the second
constexpr double along_tangent = 1e-6, across_p = 1e-5;  ///< scaled lengths of differences
constexpr double least_along = 0.05;                     ///< of the tangent in p: of differences along it

Vector rows_of(const Orbit& o, const Vector& size) {
  const BoundaryCondition& c = o.condition;
  return ((c.E0.cwiseAbs() + c.ET.cwiseAbs()) * size).cwiseInverse();
}

Vector size_of_states(const Orbit& o) {
  const double most = o.size.size() > 0 ? o.size.maxCoeff() : 0;
  if (!(most > 0)) return Vector::Ones(o.size.size());
  return o.size.cwiseMax(least_size * most);
}

// Of c + S a > 0, by Newton's method on the sum of the logarithms; what c lacks is rounding.
Vector analytic_centre(const Vector& least, const Matrix& S) {
  constexpr int most_steps = 40;
  constexpr double kept = 0.1;  // of each of c + S a, in one step
  Vector c = least.cwiseMax(1e-9 * least.cwiseAbs().maxCoeff()), a = Vector::Zero(S.cols());
  for (int k = 0; k < most_steps; ++k) {
    const Matrix by = c.cwiseInverse().asDiagonal() * S;
    const Vector da = Matrix(by.transpose() * by)
                          .completeOrthogonalDecomposition()
                          .solve(Vector(by.transpose() * Vector::Ones(c.size())));
    const Vector change = by * da;  // relative
    const double share = std::min(1.0, (kept - 1) / std::min(change.minCoeff(), kept - 1));
    a += share * da;
    c += share * c.cwiseProduct(change);
    if (change.cwiseAbs().maxCoeff() <= 1e-10) break;
  }
  return a;
}

}  // namespace

Vector place_of(const Orbit& o) {
  Vector z(o.x0.size() + 1);
  z << o.x0, o.p;
  return z;
}

Vector BranchSteps::scale_of(const Orbit& o) const {
  Vector scale(o.x0.size() + 1);
  scale << sizes_per_range * std::sqrt(double(o.x0.size())) * size_of_states(o), orbits_.range();
  return scale;
}

// Rows and columns in comparable sizes. Where E0 + ET D is singular to rounding, the state is one of a family, which
// exists for all p: what dF/dp has outside of its range is error.
Matrix BranchSteps::jacobian(const Orbit& o, const Vector& by_p, const Vector& scale) const {
  const Index m = o.x0.size();
  const Vector rows = rows_of(o, size_of_states(o));
  Matrix J(m, m + 1);
  J << o.condition.E0 + o.condition.ET * o.D, by_p;
  J = (rows.asDiagonal() * J * scale.asDiagonal()).eval();
  Eigen::JacobiSVD<Matrix> svd(J.leftCols(m), Eigen::ComputeThinU);
  svd.setThreshold(ShootingMatrix::singular_share);
  const Matrix outside = svd.matrixU().rightCols(m - svd.rank());
  const Vector error = outside * (outside.transpose() * J.col(m));
  J.col(m) -= error;
  return J;
}

BranchState BranchSteps::state(Orbit o, Vector by_p, const Vector& along, int newton) const {
  const Index m = o.x0.size();
  BranchState s{std::move(o), std::move(by_p), {}, {}, newton};
  s.scale = scale_of(s.orbit);
  Eigen::JacobiSVD<Matrix> svd(jacobian(s.orbit, s.by_p, s.scale), Eigen::ComputeFullV);
  svd.setThreshold(ShootingMatrix::singular_share);
  const Matrix kernel = svd.matrixV().rightCols(m + 1 - svd.rank());
  s.tangent = kernel * (kernel.transpose() * along);
  s.tangent.normalize();
  return s;
}

std::optional<Vector> BranchSteps::by_parameter(const Orbit& o, const Vector& tangent, const Vector& scale) {
  const Index m = o.x0.size();
  const bool across = std::abs(tangent[m]) < least_along;
  const double inwards = orbits_.inside(o.p + across_p * scale[m]) ? across_p : -across_p;
  return orbits_.by_parameter(o, across ? Vector(inwards * scale[m] * Vector::Unit(m + 1, m))
                                        : Vector(along_tangent * scale.cwiseProduct(tangent)));
}

std::optional<BranchState> BranchSteps::first(Orbit o, const Vector& along) {
  const Vector scale = scale_of(o);
  auto found = centred(std::move(o), scale);
  return found ? with_tangent(std::move(*found), along) : std::nullopt;
}

std::optional<BranchState> BranchSteps::with_tangent(Orbit o, const Vector& along) {
  const Index m = o.x0.size();
  const Vector scale = scale_of(o);
  // By p alone at first.
  Vector direction = Vector::Unit(m + 1, m);
  auto by_p = by_parameter(o, Vector::Zero(m + 1), scale);
  for (int k = 0; k < 2 && by_p; ++k) {
    if (k > 0) by_p = by_parameter(o, direction, scale);
    if (by_p) direction = state(o, *by_p, along, 0).tangent;
  }
  if (!by_p) return std::nullopt;
  return state(std::move(o), std::move(*by_p), along, 0);
}

std::optional<BranchState> BranchSteps::next(const BranchState& s, double length) {
  const Vector plane = place_of(s.orbit) + length * s.scale.cwiseProduct(s.tangent);
  return correct(plane, plane, s.tangent, s.tangent, s);
}

std::optional<BranchState> BranchSteps::at_parameter(const BranchState& near, double p) {
  Vector plane = place_of(near.orbit);
  plane[plane.size() - 1] = p;
  return correct(plane, plane, Vector::Unit(plane.size(), plane.size() - 1), near.tangent, near);
}

std::optional<Orbit> BranchSteps::centred(Orbit o, const Vector& scale) {
  const Index m = o.x0.size();
  const Matrix J =
      rows_of(o, size_of_states(o)).asDiagonal() * (o.condition.E0 + o.condition.ET * o.D) * scale.head(m).asDiagonal();
  Eigen::JacobiSVD<Matrix> svd(J, Eigen::ComputeThinV);
  svd.setThreshold(ShootingMatrix::singular_share);
  if (svd.rank() == m) return o;
  const Matrix family = scale.head(m).asDiagonal() * svd.matrixV().rightCols(m - svd.rank());
  const FlowMargins margins = FlowDerivative(*o.scene).margins(o.flow, family);
  if (margins.least.size() == 0) return o;
  return orbits_.from(o.x0 + family * analytic_centre(margins.least, margins.change), o.p);
}

// Newton's method from z to the plane across `normal` through `plane`.
std::optional<BranchState> BranchSteps::correct(Vector z, const Vector& plane, const Vector& normal,
                                                const Vector& along, const BranchState& from) {
  constexpr double secants = 1e-4;  // scaled lengths: shorter ones are rounding
  const Vector& scale = from.scale;
  const Index m = z.size() - 1;
  std::optional<Vector> by_p;
  double before = INFINITY;
  bool slow = false;  // dF/dp changes much within a step beside a grazing
  OrbitForm form;
  for (int k = 1; k <= most_newton; ++k) {
    if (orbits_.interrupted()) break;
    auto orbit = orbits_.from(z.head(m), z[m]);
    if (!orbit) break;
    if (!by_p || slow || orbit->form != form) by_p = by_parameter(*orbit, along, scale);
    form = orbit->form;
    if (!by_p) break;
    Matrix K(m + 1, m + 1);
    K << jacobian(*orbit, *by_p, scale), normal.transpose();
    Vector right(m + 1);
    right << -rows_of(*orbit, size_of_states(*orbit)).cwiseProduct(orbit->F),
        normal.dot((plane - z).cwiseQuotient(scale));
    Eigen::JacobiSVD<Matrix> svd(K, Eigen::ComputeThinU | Eigen::ComputeThinV);
    svd.setThreshold(ShootingMatrix::singular_share);
    const Vector du = svd.solve(right);
    const double step = du.cwiseAbs().maxCoeff();
    if (!(step < 1) || (k > 2 && step > slow_fall * before)) break;
    slow = step > 0.05 * before;
    before = step;
    z += scale.cwiseProduct(du);
    if (step > small_step) continue;
    orbit->x0 = z.head(m), orbit->p = z[m];
    orbit = centred(std::move(*orbit), scale);
    if (orbit && orbit->x0 != z.head(m)) by_p = by_parameter(*orbit, along, scale);
    if (!orbit || !by_p) break;
    const Vector secant = (place_of(*orbit) - place_of(from.orbit)).cwiseQuotient(scale);
    const bool known = secant.norm() > secants && secant.dot(along) > 0;
    return state(std::move(*orbit), std::move(*by_p), known ? secant : along, k);
  }
  return std::nullopt;
}

// Motions of other forms near the corner, of each form one.
std::vector<BranchState> BranchSteps::pieces_around(const BranchState& corner, double distance) {
  const Index m = corner.orbit.x0.size();
  std::vector<OrbitForm> seen{corner.orbit.form};
  std::vector<BranchState> pieces;
  std::vector<Vector> moves{corner.tangent, -corner.tangent};
  for (Index i = 0; i <= m; ++i)
    for (const double side : {1.0, -1.0}) moves.push_back(side * Vector::Unit(m + 1, i));
  for (const Vector& move : moves) {
    const Vector z = place_of(corner.orbit) + distance * corner.scale.cwiseProduct(move);
    auto orbit = orbits_.from(z.head(m), z[m]);
    if (!orbit || std::find(seen.begin(), seen.end(), orbit->form) != seen.end()) continue;
    seen.push_back(orbit->form);
    if (auto piece = with_tangent(std::move(*orbit), corner.tangent)) pieces.push_back(std::move(*piece));
  }
  return pieces;
}

// Newton's method from the motion on the other piece. An impact has a velocity like the square root of the distance to
// the piece: the method leads to any larger one, and from above twice its aim to none. So the motion is very near.
std::optional<BranchState> BranchSteps::turned(const BranchState& corner, double length) {
  constexpr double beside = 1e-3;  // of the length
  for (const BranchState& piece : pieces_around(corner, beside * length))
    for (const double side : {1.0, -1.0}) {
      const Vector way = side * piece.tangent;
      const Vector plane = place_of(corner.orbit) + length * corner.scale.cwiseProduct(way);
      auto found = correct(place_of(piece.orbit), plane, way, way, corner);
      if (found && found->orbit.form == piece.orbit.form) return found;
    }
  return std::nullopt;
}

}  // namespace bromwich
