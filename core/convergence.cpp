#include "core/convergence.hpp"

#include "core/certificate.hpp"
#include "core/solve.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr double smallest_jump = 1e-4;  ///< of y; differences below that stop falling are rounding
constexpr double order_with_jumps = 2;  ///< of x at most

// Where solutions are smooth: implicit Euler, piecewise-linear y (continuous, or Galerkin's), Radau IIA.
double order_of(const Result& result) {
  if (result.method == to_string(Method::euler)) return 1;
  return result.continuous || result.method == to_string(Method::galerkin) ? 2 : 3;
}

double relative(const RowMatrix& a, Index a_stride, const RowMatrix& b, Index b_stride) {
  double largest = 0, size = 1;
  for (Index j = 1; a_stride * j < a.rows() && b.cols() > 0; ++j) {
    const double apart = (a.row(a_stride * j) - b.row(b_stride * j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
    if (std::isnan(apart)) return INFINITY;  // states that the method cannot give
    largest = std::max(largest, apart);
    size = std::max(size, b.row(b_stride * j).cwiseAbs().maxCoeff());
  }
  return largest / size;
}

RowMatrix mean(const Result& result) { return running_integral(result.y, 1 / double(result.steps)); }

}  // namespace

Distance distance(const Result& a, Index a_stride, const Result& b, Index b_stride) {
  Distance d{relative(a.y, a_stride, b.y, b_stride), relative(mean(a), a_stride, mean(b), b_stride),
             Vector(a.x.cols())};
  for (Index c = 0; c < a.x.cols(); ++c)  // the units of the components differ
    d.x[c] = relative(a.x.col(c), a_stride, b.x.col(c), b_stride);
  return d;
}

Vector largest_jumps(const RowMatrix& y) {
  Vector largest = Vector::Zero(y.cols());
  for (Index j = 3; j + 1 < y.rows(); ++j) {
    const auto at_once = (y.row(j) - y.row(j - 1)).cwiseAbs(), for_good = (y.row(j + 1) - y.row(j - 2)).cwiseAbs();
    largest = largest.cwiseMax(at_once.cwiseMin(for_good).transpose());
  }
  return largest;
}

Convergence::Convergence(const Scene& scene, const Result& first)
    : y_(order_of(first)),
      mean_(1),
      x_(order_of(first)),
      jump_(1),
      components_(std::size_t(first.x.cols()), x_),
      scene_(scene),
      may_jump_(!first.continuous || first.method == to_string(Method::euler)) {}

void Convergence::add(const Result& coarse, const Result& fine, bool resolved) {
  const Distance d = distance(coarse, 1, fine, 2);
  const bool resolves = y_.confirmed();
  y_.add(d.y);
  mean_.add(d.mean);
  x_.add(d.of_x());
  for (Index c = 0; c < d.x.size(); ++c) components_[std::size_t(c)].add(d.x[c]);
  erratic_ = erratic_ || (resolves && x_.changes_abruptly());
  check_.reset();
  if (!may_jump_) return;
  const Vector jumps = largest_jumps(fine.y);
  const double jump = jumps.maxCoeff(), steps = double(fine.steps);
  jump_.add(jump / std::max(1.0, fine.y.bottomRows(fine.steps).cwiseAbs().maxCoeff()));
  displaced_ = jump / (2 * steps * std::max(1.0, mean(fine).cwiseAbs().maxCoeff()));
  displaced_x_ = 0;
  if (const DenseDynamics* dynamics = std::get_if<DenseDynamics>(&scene_.dynamics))
    for (std::size_t c = 0; c < fine.x_components.size(); ++c)
      displaced_x_ =
          std::max(displaced_x_, scene_.T / steps * dynamics->B.row(fine.x_components[c]).cwiseAbs().dot(jumps) /
                                     std::max(1.0, fine.x.col(Index(c)).cwiseAbs().maxCoeff()));
  // Once is enough: later differences may be small because all jumps happen to be in the same steps.
  jumps_ = jumps_ || (resolved && ((y_.stands_still() && y_.last() > smallest_jump) ||
                                   (jump_.stands_still() && jump_.last() > smallest_jump)));
  if (!jumps_) return;
  x_.limit_order(order_with_jumps);
  for (GridDifferences& component : components_) component.limit_order(order_with_jumps);
}

void Convergence::check(const Result& other, const Result& fine) { check_ = distance(other, 3, fine, 4); }

double Convergence::error() const {
  const double e = controlled().error(check_.has_value());
  if (std::isnan(e) || !may_jump_) return e;
  const double seen = check_ ? controlled().error_from_check(jumps_ ? check_->mean : check_->y) : 0;
  return std::max({e, seen, jumps_ ? displaced_ : 0});
}

double Convergence::error_of_x() const {
  double e = x_.error(check_.has_value());
  for (const GridDifferences& component : components_)
    if (component.regular()) e = std::max(e, component.error());
  const double seen = check_ ? x_.error_from_check(check_->of_x()) : 0;
  return std::max({e, seen, jumps_ && erratic_ ? displaced_x_ : 0});
}

bool Convergence::can_be_judged() const {
  if (!controlled().confirmed() || controlled().changes_abruptly()) return false;
  return jumps_ ? !mean_.stands_still() : !(may_jump_ && jump_.stands_still() && jump_.last() > smallest_jump);
}

}  // namespace bromwich
