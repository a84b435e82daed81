#include "core/certificate/distances.hpp"

#include "core/accuracy/convergence.hpp"
#include "core/certificate/defect.hpp"
#include "core/kernel/start_rounding.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double near_row = 1e-6;   ///< of a step: a switch so near may be on either side of a row
constexpr std::size_t one_of = 20;  ///< rows: one may be off by more than the typical error

Vector outside(const Vector& a, const Vector& b, const Vector& row) {
  return (a.cwiseMin(b) - row).cwiseMax(row - a.cwiseMax(b)).cwiseMax(0);
}

// The largest size of each component, one row each time.
template <class Rows>
void include(Vector& largest, const Rows& rows) {
  largest = largest.cwiseMax(rows.cwiseAbs().colwise().maxCoeff().transpose());
}

}  // namespace

Distances::Distances(const EventSolution& located, const Scene& scene, const Result& r, const LinearSteps& y,
                     const Matrix& effect)
    : located_(located),
      T_(scene.T),
      r_(r),
      y_(y),
      effect_(effect),
      jumps_at_end_(jumps_at_end(scene)),
      x_size_(scene.x0.cwiseAbs()) {
  y_off_ = mean_off_ = y_size_ = Vector::Zero(r.y.cols());
  effect_off_ = effect_size_ = Vector::Zero(effect.rows());
  x_off_ = Vector::Zero(x_size_.size());
}

void Distances::add(Index j, const Eigen::Ref<const RowMatrix>& x) {
  for (Index k = 0; k < x.rows();) {
    const EventPiece& piece = located_.piece(r_.t[j + k], true);
    const Index inside = rows_inside(piece, j + k, x.rows() - k);
    if (inside > 0)
      add_inside(piece, j + k, x.middleRows(k, inside));
    else
      add_row(j + k, x.row(k).transpose());
    k += std::max<Index>(inside, 1);
  }
}

// How many of the rows from j on lie on the piece, and not at one of its ends.
Index Distances::rows_inside(const EventPiece& piece, Index j, Index rows) const {
  const double near = near_row * (r_.t[j] - r_.t[j - 1]);
  if (!(piece.begin < r_.t[j] - near)) return 0;
  const double* first = r_.t.data() + j;
  return std::upper_bound(first, first + rows, piece.end - 2 * near) - first;
}

void Distances::add_inside(const EventPiece& piece, Index j, const Eigen::Ref<const RowMatrix>& x) {
  const Index rows = x.rows();
  const Vector places = (r_.t.segment(j, rows).array() - piece.begin) / piece.length;
  const Matrix basis = legendre_rows(places), y = r_.y.middleRows(j, rows), true_y = basis * piece.y;
  Matrix integral = piece.length * (legendre_integral_rows(places) * piece.y) - y_.integral().middleRows(j, rows);
  integral.rowwise() += piece.integral.transpose();
  const Matrix effect = y * effect_.transpose(), true_effect = true_y * effect_.transpose();
  include(y_off_, true_y - y);
  include(y_size_, y);
  include(y_size_, true_y);
  include(effect_off_, true_effect - effect);
  include(effect_size_, effect);
  include(effect_size_, true_effect);
  include(mean_off_, integral);
  const RowMatrix true_x = basis * piece.x;
  const RowMatrix off = (true_x - x).cwiseAbs();
  for (Index k = 0; k < rows; ++k) add_state(x.row(k).transpose(), true_x.row(k).transpose(), off.row(k).transpose());
}

// A row of states, and how far they are off. Sizes are those of the values so far; of states at rest, which are
// rounding of what holds them, those of the terms.
template <class A, class B, class C>
void Distances::add_state(const A& x, const B& true_x, const C& off) {
  x_size_ = x_size_.cwiseMax(x.cwiseAbs()).cwiseMax(true_x.cwiseAbs());
  x_off_ = x_off_.cwiseMax(off);
  const auto held = at_rest * T_ * effect_size_.head(x_size_.size());
  const double least = ComponentSizes::smallest * x_size_.cwiseMax(held).maxCoeff();
  double worst = 0;
  for (Index i = 0; i < x_size_.size(); ++i)
    if (off[i] > 0) worst = std::max(worst, off[i] / std::max({x_size_[i], least, held[i]}));
  of_rows_.push_back(worst);
}

void Distances::add_row(Index j, const Vector& x) {
  if (jumps_at_end_ && j + 1 == r_.t.size()) return of_rows_.push_back(0);
  const double near = near_row * (r_.t[j] - r_.t[j - 1]), before = r_.t[j] - near,
               behind = std::min(r_.t[j] + near, T_);
  const Vector left = located_.y(before, true), right = located_.y(behind, false), y = r_.y.row(j).transpose();
  y_off_ = y_off_.cwiseMax(outside(left, right, y));
  effect_off_ = effect_off_.cwiseMax(outside(effect_ * left, effect_ * right, effect_ * y));
  effect_size_ = effect_size_.cwiseMax((effect_ * y).cwiseAbs()).cwiseMax((effect_ * right).cwiseAbs());
  y_size_ = y_size_.cwiseMax(y.cwiseAbs()).cwiseMax(right.cwiseAbs());
  const Vector integral = y_.integral().row(j).transpose();
  mean_off_ = mean_off_.cwiseMax(
      outside(located_.integral_of_y(before, true), located_.integral_of_y(behind, false), integral));
  const Vector true_x = located_.x(behind, false);
  add_state(x, true_x, outside(located_.x(before, true), true_x, x));
}

void Distances::summarise(const Defect& defect, Certificate& c) const {
  const ComponentSizes sizes;
  const Vector least_y =
      (defect.answers().array() > 0).select(at_rest * defect.terms().cwiseQuotient(defect.answers()), 0.0);
  const Vector size_of_effect = sizes.of(effect_size_).cwiseMax(effect_.cwiseAbs() * least_y);
  c.error_of_x = largest_share(x_off_, sizes.of(x_size_.cwiseMax(at_rest * T_ * effect_size_.head(x_size_.size()))));
  std::vector<double> rows = of_rows_;
  const auto place = rows.begin() + std::ptrdiff_t(rows.size() - 1 - rows.size() / one_of);
  std::nth_element(rows.begin(), place, rows.end());
  c.typical_error_of_x = *place;
  c.error_of_y =
      std::min(largest_share(y_off_, sizes.of(y_size_).cwiseMax(least_y)), largest_share(effect_off_, size_of_effect));
  c.error_of_mean = largest_share(mean_off_ / T_, sizes.of_mean(r_).cwiseMax(least_y));
  c.impulses = located_.jumps > 0;
}

}  // namespace bromwich
