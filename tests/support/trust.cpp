#include "tests/support/trust.hpp"
#include "core/solve/scaling.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>

namespace bromwich::oracle {
namespace {

/// max(c_i, 1e-3 of the largest component), compared in natural units.
Vector measure(const Vector& largest, const std::vector<int>& units) {
  if (units.empty()) return oracle::measure(largest);
  Vector one(largest.size());
  for (Index i = 0; i < one.size(); ++i) one[i] = times_ten_to(units[std::size_t(i)], 1);
  return oracle::measure(Vector(largest.cwiseQuotient(one))).cwiseProduct(one);
}

/// Largest distance of `found` from the range of values around t, where the solution may jump; value(t, left) is known
/// to within `doubt`.
template <typename Value>
double distance(const Vector& found, double t, double T, const Vector& size, const Vector& doubt, const Value& value) {
  if (!found.allFinite()) return INFINITY;
  if (found.size() == 0) return 0;
  const double apart = 1e-12 * T;
  Vector least = value(t, true), most = least;
  for (const Vector& other :
       {value(t, false), value(std::max(0.0, t - apart), false), value(std::min(T, t + apart), false)}) {
    least = least.cwiseMin(other);
    most = most.cwiseMax(other);
  }
  const Vector off = ((least - found).cwiseMax(found - most) - doubt).cwiseMax(0);
  return (off.array() > 0).select(off.cwiseQuotient(size), 0).maxCoeff();
}

/// Edges of two sources that should coincide differ by rounding: a point between them has values of neither side.
bool between_edges(const std::vector<double>& breaks, double t, double T) {
  const double apart = 1e-12 * T;
  const auto first = std::lower_bound(breaks.begin(), breaks.end(), t - apart);
  return std::upper_bound(first, breaks.end(), t + apart) - first > 1;
}

}  // namespace

TrueError true_error(const SourceScene& s, const EventSolution& truth, const Result& r) {
  const double T = s.base.scene.T;
  TrueError e;
  e.of_mean = (r.errors && r.errors->of_integral) || truth.jumps > 0;
  const NaturalUnits units = natural_units(s.scene);
  const Vector size_x = measure(truth.largest_x(), units.x);
  const Vector size_y = measure(e.of_mean ? truth.largest_integral() : truth.largest_y(), units.y);
  const RowMatrix mean = e.of_mean ? RowMatrix(integral_of_y(r) / (s.unit_y * s.unit_t)) : RowMatrix();
  // Coefficients and sources are of order one in the natural units of a scene: a y of rounding size counts as 0.
  constexpr double rounding = 1e-14;
  const Vector known = Vector::Zero(size_x.size()),
               doubt = (e.of_mean ? T : 1.0) * (truth.doubt.array() + rounding).matrix();
  const Index J = r.y.rows() - 1;
  for (Index j = 1; j <= J; ++j) {
    const double t = std::min(T, r.t[j] / s.unit_t);
    const double x = distance(r.x.row(j).transpose() / s.unit_x, t, T, size_x, known,
                              [&](double at, bool left) { return truth.x(at, left); });
    if (x > e.x) e.x = x, e.x_at = r.t[j];
    if (!truth.y_unique || (!e.of_mean && between_edges(s.base.breaks, t, T))) continue;
    const double y = e.of_mean ? distance(mean.row(j).transpose(), t, T, size_y, doubt,
                                          [&](double at, bool left) { return truth.integral(at, left); })
                               : distance(r.y.row(j).transpose() / s.unit_y, t, T, size_y, doubt,
                                          [&](double at, bool left) { return truth.y(at, left); });
    if (y > e.y) e.y = y, e.y_at = r.t[j];
  }
  return e;
}

}  // namespace bromwich::oracle
