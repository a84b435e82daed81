#include "nonlinear/nonlinear_output.hpp"

#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/result/estimated_quantity.hpp"
#include "core/solve/dense_output.hpp"
#include "nonlinear/adapted_nonlinear.hpp"
#include "nonlinear/divided_step.hpp"
#include "nonlinear/frozen_windows.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

constexpr double same_point = 1e-9;  ///< of a step

// x or v, and y of one time. Values are NaN where they are not known.
struct SeenRow {
  Vector seen, y;
};

Vector value_of(const NonlinearFunction& function, Index size, double t, const Vector& seen, const Vector& y) {
  Vector value = Vector::Zero(size);
  if (function) function(t, seen, y, value);
  return value;
}

class Sampling {
 public:
  Sampling(const NonlinearScene& scene, Backend& backend, const NonlinearResult& result)
      : scene_(in_states(scene)),
        backend_(backend),
        result_(result),
        by_trace_(result.trace.size() > 0),
        J_(result.t.size() - 1),
        h_(scene.linear.T / double(J_)) {}

  SeenRow at(double t) {
    const double place = t / h_, nearest = std::round(place);
    if (std::abs(place - nearest) <= same_point) return row(Index(nearest));
    const Index j = std::min(Index(place), J_ - 1);
    const SeenRow before = row(j), after = row(j + 1);
    if (!after.seen.allFinite()) return after;
    if (by_trace_) {
      const double s = place - double(j);
      return {(1 - s) * before.seen + s * after.seen, (1 - s) * before.y + s * after.y};
    }
    if (!ready_) prepare();
    if (scene_.linear.dynamics->small_state()) return by_a_step(j, t - double(j) * h_, before);
    const Result one = at_times(frozen_, backend_, carried_, {t});
    return {one.x.row(0).transpose(), one.y.row(0).transpose()};
  }

 private:
  const RowMatrix& seen() const { return by_trace_ ? result_.trace : result_.x; }
  SeenRow row(Index j) const { return {seen().row(j).transpose(), result_.y.row(j).transpose()}; }

  void prepare() {
    scene_.linear.dynamics->small_state() ? choose_step() : carry();
    ready_ = true;
  }

  // The steps of the march that finds such rows.
  void choose_step() {
    const auto largest = [](const RowMatrix& rows) {
      return rows.array().isFinite().select(rows.array(), 0.0).abs().maxCoeff();
    };
    step_.rule = result_.continuous ? StepRule::linear : StepRule::radau;
    step_.sizes = {largest(result_.x), largest(result_.y), largest(result_.w)};
    divisions_ = divisions_of(scene_.linear);
    if (!result_.continuous) return;
    NonlinearScene first = scene_;
    first.linear = part_of(scene_.linear, 0, h_, scene_.linear.x0);
    const NonlinearSteps steps(first, backend_, 1, step_.rule, step_.tolerance, step_.most_newton);
    step_.least = selects_least(steps.lcp_class(scene_.linear.x0, Vector::Zero(scene_.linear.constraints())));
  }

  // The linear scene with phi and gamma of the result as sources, and its result.
  void carry() {
    const Index m = scene_.linear.states(), n = scene_.linear.constraints();
    RowMatrix phi = RowMatrix::Zero(J_ + 1, m), gamma = RowMatrix::Zero(J_ + 1, n);
    for (Index j = 0; j <= J_ && seen().row(j).allFinite(); ++j) {
      const SeenRow one = row(j);
      const double t = double(j) * h_;
      Vector v = one.seen;
      if (scene_.of_trace) v = observe(scene_.linear.dynamics, v);
      const Vector entering = value_of(scene_.phi, scene_.seen(), t, v, one.y);
      phi.row(j) = (scene_.of_trace ? Vector(scene_.linear.dynamics->inputs() * entering) : entering).transpose();
      gamma.row(j) = value_of(scene_.gamma, n, t, v, one.y).transpose();
    }
    frozen_ = with_rest(scene_.linear, false, std::move(phi), std::move(gamma), h_);
    carried_.status = result_.status;
    carried_.method = Method::march;
    carried_.t = result_.t;
    carried_.y = result_.y;
    carried_.x = result_.x;
    carried_.x_components.resize(std::size_t(m));
    std::iota(carried_.x_components.begin(), carried_.x_components.end(), Index(0));
    carried_.steps = J_;
  }

  SeenRow by_a_step(Index j, double length, const SeenRow& before) const {
    SeenRow at = before;
    if (!take_divided(scene_, backend_, step_, double(j) * h_, length, divisions_, at.seen, at.y).solved)
      at.seen.setConstant(std::nan("")), at.y.setConstant(std::nan(""));
    return at;
  }

  const NonlinearScene scene_;
  Backend& backend_;
  const NonlinearResult& result_;
  bool by_trace_;
  Index J_;
  double h_;
  bool ready_ = false;
  StepOptions step_;               ///< of scenes with dense matrices
  std::vector<double> divisions_;  ///< likewise
  Scene frozen_;                   ///< of other scenes
  Result carried_;                 ///< likewise
};

// Steps of their own lengths: they are marched once more, with rows at these times. NaN where that fails.
NonlinearResult by_own_steps(const NonlinearScene& scene, Backend& backend, const NonlinearResult& result,
                             const std::vector<double>& times) {
  const double T = scene.linear.T;
  std::vector<double> rows = times;
  rows.insert(rows.end(), {0.0, T});
  for (double& t : rows) t = std::min(t, T);
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
  NonlinearOptions options;
  options.error = result.own_error;
  options.steps = result.t.size() - 1;
  const NonlinearScene stated = in_states(scene);
  const auto fine = march_nonlinear_to_tolerance(stated, divisions_of(stated.linear), backend, options,
                                                 Eigen::Map<const Vector>(rows.data(), Index(rows.size())));
  NonlinearResult sampled = result;
  sampled.t = Eigen::Map<const Vector>(times.data(), Index(times.size()));
  sampled.y_integral.resize(0, 0);
  const auto take = [&](const RowMatrix* from, RowMatrix& to) {
    to = RowMatrix::Constant(sampled.t.size(), to.cols(), std::nan(""));
    for (Index k = 0; from && k < sampled.t.size(); ++k)
      to.row(k) = from->row(std::lower_bound(rows.begin(), rows.end(), std::min(sampled.t[k], T)) - rows.begin());
  };
  take(fine ? &fine->x : nullptr, sampled.x);
  take(fine ? &fine->y : nullptr, sampled.y);
  take(fine ? &fine->w : nullptr, sampled.w);
  return sampled;
}

}  // namespace

NonlinearResult nonlinear_at(const NonlinearScene& scene, Backend& backend, const NonlinearResult& result,
                             const std::vector<double>& times) {
  for (const double t : times)
    if (!(t >= 0) || !(t <= scene.linear.T * (1 + epsilon)))
      throw Error("times", text("found %.17g", t), text("give times from 0 to T = %.17g", scene.linear.T));
  if (result.own_error > 0) return by_own_steps(scene, backend, result, times);
  const Index count = Index(times.size()), n = scene.linear.constraints();
  NonlinearResult sampled = result;
  sampled.t = Eigen::Map<const Vector>(times.data(), count);
  sampled.x.resize(count, result.x.cols());
  sampled.trace.resize(count, result.trace.cols());
  sampled.y = sampled.w = RowMatrix::Zero(count, n);
  Sampling sampling(scene, backend, result);
  const bool by_trace = result.trace.size() > 0;
  for (Index k = 0; k < count; ++k) {
    check_interruption();
    const SeenRow one = sampling.at(times[std::size_t(k)]);
    (by_trace ? sampled.trace : sampled.x).row(k) = one.seen.transpose();
    sampled.y.row(k) = one.y.transpose();
    const Vector v = by_trace ? one.seen : observe(scene.linear.dynamics, one.seen);
    Vector g = Vector::Zero(n);
    if (scene.linear.g) scene.linear.g(sampled.t[k], g);
    const Vector gamma = value_of(scene.gamma, n, sampled.t[k], scene.of_trace ? v : one.seen, one.y);
    sampled.w.row(k) = (v + multiply(scene.linear.M, one.y) + g + gamma).transpose();
  }
  return sampled;
}

std::string estimated_quantity(const NonlinearResult& given) {
  Result r;
  r.error_estimate = given.error_estimate;
  r.continuous = given.continuous;
  r.x.resize(0, std::max(given.x.cols(), given.trace.cols()));
  return estimated_quantity(r);
}

Result as_result(const NonlinearScene& scene, const NonlinearResult& given) {
  Result r;
  r.status = given.status;
  r.reason = given.reason;
  r.warning = given.warning;
  r.t = given.t;
  r.y = given.y;
  r.x = given.x;
  for (Index i = 0; i < given.x.cols(); ++i) r.x_components.push_back(i);
  r.x.conservativeResize(given.t.size(), given.x.cols());
  r.trace = given.w;
  for (Index j = 0; j < given.t.size(); ++j) {
    Vector g = Vector::Zero(given.y.cols());
    if (scene.linear.g) scene.linear.g(given.t[j], g);
    r.trace.row(j) -= (multiply(scene.linear.M, given.y.row(j).transpose()) + g).transpose();
  }
  r.y_integral = given.y_integral;
  r.continuous = given.continuous;
  r.residual = given.residual;
  r.error_estimate = given.error_estimate;
  r.kernel = text("%ld Newton iterations, %ld linear solves in %ld windows, %ld steps marched", long(given.newton),
                  long(given.solves), long(given.windows), long(given.marched));
  r.method = given.method == NonlinearMethod::march ? Method::march : Method::contour;
  r.iterations = given.method == NonlinearMethod::iteration ? given.solves : given.newton;
  r.steps = given.t.size() - 1;
  return r;
}

}  // namespace bromwich
