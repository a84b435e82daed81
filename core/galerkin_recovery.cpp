#include "core/galerkin_recovery.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_node = 1e-9;  ///< of an interval

// x(t + s) from x(t), y linear from a to b: one interval of length s.
Vector carried_state(const Scene& scene, const Vector& x, double t, double s, const Vector& a, const Vector& b) {
  Scene rest = scene;
  rest.boundary.reset();
  rest.x0 = x;
  rest.T = s;
  rest.g = {};
  if (scene.f) rest.f = [f = scene.f, t](double r, Eigen::Ref<Vector> value) { f(t + r, value); };
  const GalerkinProblem step = galerkin_problem(rest, 1);
  RowMatrix z(1, a.size() + b.size());
  z << a.transpose(), b.transpose();
  return galerkin_states(step, z).row(1).transpose();
}

}  // namespace

RowMatrix galerkin_coefficients(const Result& r) {
  RowMatrix z(r.y_left.rows(), 2 * r.y_left.cols());
  z << r.y_left, r.y.bottomRows(r.y_left.rows());
  return z;
}

GalerkinOutput galerkin_at(const Scene& scene, const Result& r, const std::vector<double>& times) {
  const Index N = r.y_left.rows(), n = r.y_left.cols();
  if (!r.y_left.row(0).allFinite()) {  // nothing was found, and the states may be too many to write out
    const Index rows = Index(times.size());
    return {RowMatrix::Constant(rows, n, NAN), RowMatrix::Constant(rows, scene.states(), NAN)};
  }
  const GalerkinProblem p = galerkin_problem(scene, N);
  const RowMatrix states = galerkin_states(p, galerkin_coefficients(r));
  GalerkinOutput out{RowMatrix(Index(times.size()), n), RowMatrix(Index(times.size()), p.states())};
  for (std::size_t i = 0; i < times.size(); ++i) {
    const double steps = std::clamp(times[i] / p.h, 0.0, double(N)), nearest = std::round(steps);
    const Index row = Index(i);
    if (std::abs(steps - nearest) <= same_node) {
      out.y.row(row) = r.y.row(Index(nearest));
      out.x.row(row) = states.row(Index(nearest));
      continue;
    }
    const Index k = Index(steps);
    const double part = steps - double(k);
    const Vector a = r.y_left.row(k).transpose(), b = (1 - part) * a + part * r.y.row(k + 1).transpose();
    out.y.row(row) = b.transpose();
    out.x.row(row) = carried_state(scene, states.row(k).transpose(), double(k) * p.h, part * p.h, a, b).transpose();
  }
  return out;
}

}  // namespace bromwich
