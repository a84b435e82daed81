#include "core/derivatives/held_sets.hpp"

#include "core/base/error.hpp"
#include "core/derivatives/lcp_terms.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "core/march/marching.hpp"
#include "core/multigrid/multigrid.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr double aimed_size = 0.25;         ///< of |e y|, below 1
constexpr double smallest_size = 1.0 / 64;  ///< below it, six binary digits are lost, and another e is taken
constexpr double smaller = 1.0 / 32;        ///< of e, where sets change
constexpr int most_tried = 40;              ///< 32^-40: no finite r needs it
constexpr double solved_residual = 1e-9;    ///< residual of a solution, relative to the largest r

Scene dynamics_alone(Scene scene) {
  scene.f = {};
  scene.f_entry = SourceEntry::state;
  scene.F = {};
  scene.g = {};
  scene.breakpoints.clear();
  scene.x0 = Vector::Zero(scene.states());
  return scene;
}

}  // namespace

HeldSets::HeldSets(const Scene& scene, Backend& backend, RowMatrix active, Method method, GridFamily& family,
                   const MakeOperator& make)
    : scene_(dynamics_alone(scene)),
      problem_(discretise(scene_, backend, active.rows() - 1, false, &family)),
      operator_(make(problem_)),
      method_(method),
      active_(std::move(active)) {
  operator_->keep_prepared();
  const Index rows = problem_.J + 1, n = scene_.constraints();
  u_ = backend.array(rows, n);
  v_ = backend.array(rows, n);
  use(method);
}

void HeldSets::use(Method method) {
  method_ = method;
  Options options;
  TimeOperator& op = *operator_;
  if (method == Method::multigrid) {
    prepared_ = prepare_multigrid(op, options);
    if (!prepared_) return use(Method::march);
    weights_ = op.weights(problem_.J, nullptr, 0);
  } else if (method == Method::contour) {
    prepared_ = prepare_iteration(op, options);
    weights_ = op.kernel_weights(ConvolutionChoice::automatic).weights;
  } else {
    prepared_ = prepare_march(op, Rule::exponential, options);
    weights_ = op.march_weights(Rule::exponential, RecurrenceChoice::automatic).weights;
  }
  kernel_ = {};
  kernel_.kernel = op.kernel_of(*weights_, problem_.J, ConvolutionChoice::automatic);
  kernel_.weights = weights_;
  RowMatrix driven = apply(active_);
  add_products(scene_.M, active_, driven);
  inactive_ = std::max(1e-290, driven.cwiseAbs().maxCoeff());
  offset_ = inactive_ * (1 - active_.array()) - driven.array();
}

RowMatrix HeldSets::apply(const RowMatrix& y) {
  problem_.backend.upload(y, *u_);
  kernel_.kernel->apply(*u_, *v_, 0);
  RowMatrix v;
  problem_.backend.download(*v_, v);
  return v;
}

// Solves r̂ + e r. The size of e y and e w / W, or infinity if the sets are others.
double HeldSets::measure(double e, const RowMatrix& r) {
  RowMatrix given = offset_ + e * r;
  problem_.g = SampledSource(given);
  set_start(problem_);
  const Changes changes{.x0 = false, .sources = true};
  operator_->renew(changes);
  prepared_->renew(changes);
  Options options;
  options.trace = true;
  options.tuning.first_iterate = &active_;
  Result result;
  prepared_->run(options, result);
  if (result.status != Status::solved || !(result.residual <= solved_residual) || result.y.rows() != given.rows())
    return INFINITY;
  found_.y = std::move(result.y);
  found_.w = std::move(given);
  found_.w += result.trace;
  add_products(scene_.M, found_.y, found_.w);
  double size = 0;
  for (Index k = 0; k < found_.y.size(); ++k) {
    double &y = found_.y.data()[k], &w = found_.w.data()[k];
    const bool active = active_.data()[k] > 0;
    if (active ? !(y > 0) : !(y == 0 && w > 0)) return INFINITY;
    y = active ? (y - 1) / e : 0;
    w = active ? 0 : (w - inactive_) / e;
    size = std::max({size, std::abs(y), std::abs(w) / inactive_});
  }
  return size;
}

HeldSets::Found HeldSets::solve(const RowMatrix& r) {
  if (!r.allFinite()) throw Error("derivative", "has a change that is not finite", "scale the data");
  const double largest = r.cwiseAbs().maxCoeff();
  if (largest == 0) return {RowMatrix::Zero(r.rows(), r.cols()), RowMatrix::Zero(r.rows(), r.cols())};
  double e = aimed_size / (largest * (gain_ > 0 ? gain_ : 1 / inactive_));
  for (int run = 0; run < most_tried; ++run) {
    const double size = measure(e, r);
    if (std::isinf(size)) {
      e *= smaller;
      continue;
    }
    gain_ = std::max(size, 1e-290) / largest;
    if (e * size >= smallest_size || run + 1 == most_tried) return std::move(found_);
    e = aimed_size / std::max(size, 1e-290);
  }
  if (method_ != Method::march) {
    use(Method::march);
    return solve(r);
  }
  throw Error("derivative", "the linear problem on the active sets is not solved", "use the derivative on the host");
}

std::size_t HeldSets::bytes() const { return u_->bytes() + v_->bytes() + kernel_.kernel->bytes(); }

}  // namespace bromwich
