#include "core/accuracy/convergence.hpp"

#include "core/accuracy/impact_sides.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/result/options.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double smallest_jump = 1e-4;  ///< of y; differences below that stop falling are rounding
constexpr double smallest_peak = 0.05;  ///< of y: a row above both of its neighbours by more than a curve is
constexpr double order_with_jumps = 2;  ///< of x and of the mean of y at most
constexpr double order_with_displaced_jumps = 1.5;  ///< and scattered: at most
constexpr double chance = 4;  ///< times the differences to three other grids: errors are not larger by chance

// Where solutions are smooth: implicit Euler, piecewise-linear y (continuous, or Galerkin's), Radau IIA. Where steps
// may have other solutions, a method goes over to one at the end of a step, and y jumps there.
double order_of(const Result& result) {
  if (result.impacts) return 2;
  if (by_euler(result) || !result.well_posed) return 1;
  return result.continuous || result.method == Method::galerkin ? 2 : 3;
}

Vector sizes(const RowMatrix& values, Index first, const Vector& one, const Vector& seen, const ComponentSizes& how) {
  if (values.cols() == 0) return {};
  Vector largest = values.bottomRows(values.rows() - first).cwiseAbs().colwise().maxCoeff().transpose();
  if (seen.size() == largest.size()) largest = largest.cwiseMax(seen);
  return how.of(largest, one);
}

// A component each.
Vector relative(const RowMatrix& a, Index a_stride, const RowMatrix& b, Index b_stride, const Vector& size) {
  Vector largest = Vector::Zero(b.cols());
  for (Index j = 1; a_stride * j < a.rows() && b.cols() > 0; ++j) {
    const auto apart = (a.row(a_stride * j) - b.row(b_stride * j)).cwiseAbs();
    if (!apart.allFinite()) return Vector::Constant(b.cols(), INFINITY);  // states that the method cannot give
    largest = largest.cwiseMax(apart.transpose());
  }
  return (largest.array() > 0).select(largest.cwiseQuotient(size), 0);
}

double largest(const Vector& v) { return v.size() > 0 ? v.maxCoeff() : 0; }

// By row: whether a breakpoint lies between the row and the one before, in a result whose steps are divided there.
std::vector<bool> known_jumps(const Scene& scene, const Result& result) {
  if (!result.defects || scene.breakpoints.empty()) return {};
  const Index J = result.steps;
  std::vector<bool> known(std::size_t(J) + 1);
  const double h = scene.T / double(J), near = 1e-9;
  for (const double b : scene.breakpoints)
    for (Index j = Index(std::ceil(b / h - near)); j <= Index(std::floor(b / h + near)) + 1; ++j)
      if (j >= 1 && j <= J) known[std::size_t(j)] = true;
  return known;
}

RowMatrix mean(const Result& result) { return integral_of_y(result) / result.t[result.t.size() - 1]; }

// As far as M lets it: y is a continuous function of N x + g for some classes.
bool may_jump(const Scene& scene, const Result& first) {
  if (first.jumps_inside) return true;
  const bool by_steps = !first.continuous || by_euler(first) || !first.well_posed;
  return by_steps && !is_continuous(known_class(scene.M, scene.lcp_class));
}

}  // namespace

Vector ComponentSizes::of(const Vector& largest, const Vector& one) const {
  const Vector users = one.size() == largest.size() ? one : Vector::Ones(largest.size());
  if (!relative || largest.size() == 0) return users;
  return largest.cwiseMax(std::max(smallest * largest.maxCoeff(), zero)) + absolute * users;
}
Vector ComponentSizes::of_y(const Result& r) const { return sizes(r.y, 1, one_y, seen_y, *this); }
Vector ComponentSizes::of_mean(const Result& r) const { return sizes(mean(r), 1, one_y, {}, *this); }
Vector ComponentSizes::of_x(const Result& r) const { return sizes(r.x, 0, one_x, seen_x, *this); }

double largest_share(const Vector& v, const Vector& size) {
  return largest((v.array() > 0).select(v.cwiseQuotient(size), 0));
}

Distance distance(const Result& a, Index a_stride, const Result& b, Index b_stride, const ComponentSizes& s) {
  RowMatrix x = a.x, of_a = mean(a);
  const RowMatrix of_b = mean(b);
  const double T = a.t[a.t.size() - 1];
  const auto beside = [&](Index j) {
    const Index row = j % a_stride == 0 ? j / a_stride * b_stride : -1;
    if (row < 0 || row >= b.x.rows()) return RowOfSolution{x.row(j).transpose(), T * of_a.row(j).transpose()};
    return RowOfSolution{b.x.row(row).transpose(), T * of_b.row(row).transpose()};
  };
  if (a.impacts && !a.impacts->empty() && b.x.cols() == x.cols()) {
    RowMatrix integral = T * of_a;
    take_sides(*a.impacts, a.t, a.x_components, beside, x, integral);
    of_a = integral / T;
  }
  return {largest(relative(a.y, a_stride, b.y, b_stride, s.of_y(b))),
          largest(relative(of_a, a_stride, of_b, b_stride, s.of_mean(b))),
          relative(x, a_stride, b.x, b_stride, s.of_x(b))};
}

Vector largest_jumps(const RowMatrix& y, const std::vector<bool>& known) {
  Vector largest = Vector::Zero(y.cols());
  for (Index j = 3; j + 1 < y.rows(); ++j) {
    if (!known.empty() && known[std::size_t(j)]) continue;
    const auto at_once = (y.row(j) - y.row(j - 1)).cwiseAbs(), for_good = (y.row(j + 1) - y.row(j - 2)).cwiseAbs();
    largest = largest.cwiseMax(at_once.cwiseMin(for_good).transpose());
  }
  return largest;
}

Vector largest_peaks(const RowMatrix& y, const std::vector<bool>& known) {
  Vector largest = Vector::Zero(y.cols());
  for (Index j = 2; j + 1 < y.rows(); ++j) {
    if (!known.empty() && known[std::size_t(j)] && known[std::size_t(j) + 1]) continue;
    const auto rise = (y.row(j) - y.row(j - 1)).cwiseAbs(), fall = (y.row(j) - y.row(j + 1)).cwiseAbs();
    largest = largest.cwiseMax(rise.cwiseMin(fall).transpose());
  }
  return largest;
}

Convergence::Convergence(const Scene& scene, const Result& first, ComponentSizes sizes)
    : y_(order_of(first)),
      mean_(std::min(order_of(first), order_with_jumps)),
      x_(order_of(first)),
      jump_(1),
      components_(std::size_t(first.x.cols()), x_),
      scene_(scene),
      sizes_(std::move(sizes)),
      may_jump_(!first.impacts && may_jump(scene, first)),
      jumps_(bool(first.impacts)) {}

void Convergence::add(const Result& coarse, const Result& fine, bool resolved) {
  const Distance d = distance(coarse, 1, fine, 2, sizes_);
  const bool resolves = y_.confirmed();
  y_.add(d.y);
  mean_.add(d.mean);
  x_.add(d.of_x());
  for (Index c = 0; c < d.x.size(); ++c) components_[std::size_t(c)].add(d.x[c]);
  erratic_ = erratic_ || (resolves && x_.changes_abruptly());
  check_.reset();
  if (!may_jump_) return;
  const std::vector<bool> known = known_jumps(scene_, fine);
  const Vector jumps = largest_jumps(fine.y, known);
  const double steps = double(fine.steps);
  jump_.add(largest_share(jumps, sizes_.of_y(fine)));
  displaced_ = largest_share(jumps, sizes_.of_mean(fine)) / (2 * steps);
  displaced_x_ = 0;
  if (const DenseDynamics* dynamics = scene_.dynamics->small_state(); dynamics && fine.x.cols() > 0)
    displaced_x_ = largest_share(
        Vector(scene_.T / steps * dynamics->B(fine.x_components, Eigen::all).cwiseAbs() * jumps), sizes_.of_x(fine));
  // A contact of one step leaves a row that no coarser grid has, with a y that depends on where it began.
  jumps_ = jumps_ || (resolved && largest_share(largest_peaks(fine.y, known), sizes_.of_y(fine)) > smallest_peak);
  jumps_ = jumps_ || (resolved && fine.euler_steps > 0);  // impulses: rows that no coarser grid need have
  // Once is enough: later differences may be small because all jumps happen to be in the same steps.
  jumps_ = jumps_ || (resolved && ((y_.stands_still() && y_.last() > smallest_jump) ||
                                   (jump_.stands_still() && jump_.last() > smallest_jump)));
  if (!jumps_) return;
  x_.limit_order(order_with_jumps);
  for (GridDifferences& component : components_) component.limit_order(order_with_jumps);
}

void Convergence::check(const Result& other, const Result& fine) { check_ = distance(other, 3, fine, 4, sizes_); }

bool Convergence::hangs_on_check(double goal) const {
  return wants_check() && jumps_ && controlled().confirmed() && controlled().error() <= goal && error() > goal;
}

// What jumps that are known to within a step make, where the differences do not contradict it: that all of them are
// small by chance is not believed.
double Convergence::by_displaced_jumps(double most, const GridDifferences& d, double to_check) const {
  if (!check_) return most;
  if (d.regular() && d.observed_order() > order_with_displaced_jumps) return 0;
  return std::min(most, chance * std::max(d.largest_recent(), to_check));
}

double Convergence::share_of_difference() const {
  constexpr double margin = 2;
  const double order = controlled().order(), of_x = x_.order();
  const double p = std::min(std::isnan(order) ? 1 : order, std::isnan(of_x) ? INFINITY : of_x);
  return margin / (std::exp2(p) - 1);
}

double Convergence::error() const {
  const double e = controlled().error(check_.has_value());
  if (std::isnan(e) || !may_jump_) return e;
  const double distance = check_ ? (jumps_ ? check_->mean : check_->y) : 0;
  const double seen = check_ ? controlled().error_from_check(distance) : 0;
  return std::max({e, seen, jumps_ ? by_displaced_jumps(displaced_, controlled(), distance) : 0});
}

double Convergence::error_of_x() const {
  double e = x_.error(check_.has_value());
  for (const GridDifferences& component : components_)
    if (component.regular()) e = std::max(e, component.error());
  const double distance = check_ ? check_->of_x() : 0, seen = check_ ? x_.error_from_check(distance) : 0;
  return std::max({e, seen, jumps_ && erratic_ ? by_displaced_jumps(displaced_x_, x_, distance) : 0});
}

bool Convergence::can_be_judged(double goal) const {
  if (controlled().negligible(goal)) return true;
  if (!controlled().confirmed() || controlled().changes_abruptly()) return false;
  return jumps_ ? !mean_.stands_still() : !(may_jump_ && jump_.stands_still() && jump_.last() > smallest_jump);
}

}  // namespace bromwich
