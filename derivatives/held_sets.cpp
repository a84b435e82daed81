#include "derivatives/held_sets.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/iteration/functional_iteration.hpp"
#include "core/march/marching.hpp"
#include "core/multigrid/multigrid.hpp"
#include "derivatives/lcp_terms.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr double aimed_size = 0.25;         ///< of |e y|, below 1
constexpr double smallest_size = 1.0 / 64;  ///< below it, six binary digits are lost, and another e is taken
constexpr double smaller = 1.0 / 32;        ///< of e, where sets change
constexpr int most_tried = 40;              ///< 32^-40: no finite r needs it
constexpr double solved_residual = 1e-9;    ///< residual of a solution, relative to the largest r
constexpr double smallest_rcond = 1e-14;    ///< of (M + W_0)_SS
/// Multiplications in the factors of all sets, over those of J products with n x n matrices. Factors that take more
/// cost more than the complementarity problems that they save.
constexpr double most_in_factors = 64;

Scene dynamics_alone(Scene scene) {
  scene.f = {};
  scene.f_entry = SourceEntry::state;
  scene.F = {};
  scene.g = {};
  scene.breakpoints.clear();
  scene.x0 = Vector::Zero(scene.states());
  return scene;
}

// M + W_0.
Matrix matrix_of_step(const LcpMatrix& M, const Weights& weights) {
  const ModalRecurrence* modal = modal_recurrence_of(weights);
  return to_dense(M) + (modal ? implicit_part(*modal) : first_weight(weights));
}

}  // namespace

HeldSets::HeldSets(const Scene& scene, Backend& backend, RowMatrix active, Method method, GridFamily& family,
                   const MakeOperator& make, const HeldSets* transpose_of)
    : scene_(dynamics_alone(scene)),
      problem_(discretise(scene_, backend, active.rows() - 1, false, &family)),
      operator_(make(problem_)),
      method_(method),
      factors_(transpose_of ? transpose_of->factors_ : nullptr),
      transposes_(factors_ != nullptr),
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
    weights_ = op.march_weights(Rule::exponential, RecurrenceChoice::automatic).weights;
    if (!use_linear_march()) prepared_ = prepare_march(op, Rule::exponential, options);
  }
  kernel_ = {};
  kernel_.kernel = op.kernel_of(*weights_, problem_.J, ConvolutionChoice::automatic);
  kernel_.weights = weights_;
  if (march_) return;
  RowMatrix driven = apply(active_);
  add_products(scene_.M, active_, driven);
  inactive_ = std::max(1e-290, driven.cwiseAbs().maxCoeff());
  offset_ = inactive_ * (1 - active_.array()) - driven.array();
}

// Null where the backend takes no linear steps, or where factors of all sets are too expensive.
bool HeldSets::use_linear_march() {
  const auto& linear_march = problem_.backend.fused().linear_march;
  if (!linear_march || pole_recurrence_of(*weights_) || (!factors_ && !make_factors())) return false;
  r_ = problem_.backend.array(problem_.J + 1, active_.cols());
  MarchProblem given;
  given.M = &scene_.M;
  given.recurrence = recurrence_of(*weights_);
  given.lags = lag_table_of(*weights_);
  given.r = r_.get();
  const SetFactors& factors = *factors_;
  if (transposes_)
    march_ = linear_march(given, problem_.J + 1, [&factors, J = problem_.J](Index j, const Vector& q, Vector& y) {
      factors.responses.solve_transposed(factors.sets[std::size_t(J + 1 - j)], q, y);
      y = -y;
    });
  else
    march_ = linear_march(given, problem_.J + 1, [&factors](Index j, const Vector& q, Vector& y) {
      factors.responses.solve(factors.sets[std::size_t(j)], q, y);
    });
  return true;
}

bool HeldSets::make_factors() {
  const double n = double(active_.cols()), J = double(problem_.J);
  auto made = std::make_shared<SetFactors>();
  const Matrix at_zero = to_dense(scene_.M), of_step = matrix_of_step(scene_.M, *weights_);
  double in_factors = 0;
  std::set<std::vector<Index>> known;
  for (Index j = 0; j <= problem_.J; ++j)
    if (std::vector<Index> S = positive_in(active_, j); known.insert(S).second)
      in_factors += 2 * std::pow(double(S.size()), 3);
  if (in_factors > most_in_factors * J * n * n) return false;
  for (Index j = 0; j <= problem_.J; ++j) {
    const std::vector<Index> S = positive_in(active_, j);
    const Index set = j > 0 ? made->responses.take(S, of_step) : made->responses.take(S, at_zero, 1);
    made->sets.push_back(set);
    if (!(made->responses.condition(set) > smallest_rcond))
      throw Error("derivative",
                  text("not differentiable here: the active constraints at t = %.6g do not determine y",
                       problem_.h * double(j)),
                  "remove constraints that repeat each other");
  }
  factors_ = std::move(made);
  return true;
}

// The linear march, in one pass.
HeldSets::Found HeldSets::march(const RowMatrix& r) {
  Vector y0 = Vector::Zero(r.cols());
  if (!transposes_) factors_->responses.solve(factors_->sets[0], r.row(0).transpose(), y0);
  problem_.backend.upload(r, *r_);
  problem_.backend.upload(y0.transpose(), *u_);
  march_->run(*u_, *v_);
  Found found;
  problem_.backend.download(*u_, found.y);
  problem_.backend.download(*v_, found.driven);
  found.w = found.driven + r;
  add_products(scene_.M, found.y, found.w);
  found.w = (active_.array() > 0).select(0, found.w);
  return found;
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
  if (largest == 0) {
    const RowMatrix none = RowMatrix::Zero(r.rows(), r.cols());
    return {none, none, none};
  }
  if (march_) return march(r);
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

std::size_t HeldSets::bytes() const {
  return u_->bytes() + v_->bytes() + kernel_.kernel->bytes() + (march_ ? r_->bytes() + march_->bytes() : 0);
}

}  // namespace bromwich
