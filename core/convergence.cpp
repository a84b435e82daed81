#include "core/convergence.hpp"

#include "core/certificate.hpp"
#include "core/solve.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr double smallest_jump = 1e-4;  ///< of y; differences below that stop falling are rounding

// Where solutions are smooth: implicit Euler, continuous piecewise-linear y, Radau IIA.
double order_of(const Result& result) {
  return result.method == to_string(Method::euler) ? 1 : result.continuous ? 2 : 3;
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
  Distance d{relative(a.y, a_stride, b.y, b_stride), relative(mean(a), a_stride, mean(b), b_stride), 0};
  for (Index c = 0; c < a.x.cols(); ++c)  // the units of the components differ
    d.x = std::max(d.x, relative(a.x.col(c), a_stride, b.x.col(c), b_stride));
  return d;
}

double largest_jump(const RowMatrix& y) {
  double largest = 0;
  for (Index j = 3; j + 1 < y.rows() && y.cols() > 0; ++j)
    largest = std::max(
        largest, (y.row(j) - y.row(j - 1)).cwiseAbs().cwiseMin((y.row(j + 1) - y.row(j - 2)).cwiseAbs()).maxCoeff());
  return largest;
}

Convergence::Convergence(const Result& first)
    : y_(order_of(first)),
      mean_(1),
      x_(order_of(first)),
      x_with_jumps_(std::min(order_of(first), 2.0)),
      jump_(1),
      may_jump_(!first.continuous || first.method == to_string(Method::euler)) {}

void Convergence::add(const Result& coarse, const Result& fine, bool resolved) {
  const Distance d = distance(coarse, 1, fine, 2);
  y_.add(d.y);
  mean_.add(d.mean);
  x_.add(d.x);
  x_with_jumps_.add(d.x);
  check_.reset();
  if (!may_jump_) return;
  const double jump = largest_jump(fine.y), mean_size = std::max(1.0, mean(fine).cwiseAbs().maxCoeff());
  jump_.add(jump / std::max(1.0, fine.y.bottomRows(fine.steps).cwiseAbs().maxCoeff()));
  displaced_ = jump / (2 * double(fine.steps) * mean_size);
  // Once is enough: later differences may be small because all jumps happen to be in the same steps.
  jumps_ = jumps_ || (resolved && ((y_.stands_still() && y_.last() > smallest_jump) ||
                                   (jump_.stands_still() && jump_.last() > smallest_jump)));
}

void Convergence::check(const Result& other, const Result& fine) { check_ = distance(other, 3, fine, 4); }

double Convergence::error() const {
  const double e = controlled().error();
  if (std::isnan(e) || !may_jump_) return e;
  const double seen = check_ ? controlled().error_from_check(jumps_ ? check_->mean : check_->y) : 0;
  return std::max({e, seen, jumps_ ? displaced_ : 0});
}

double Convergence::error_of_x() const {
  const GridDifferences& x = states();
  return check_ ? std::max(x.error(), x.error_from_check(check_->x)) : x.error();
}

bool Convergence::can_be_judged() const {
  if (jumps_) return mean_.confirmed() && !mean_.stands_still();
  return y_.confirmed() && !(may_jump_ && jump_.stands_still() && jump_.last() > smallest_jump);
}

}  // namespace bromwich
