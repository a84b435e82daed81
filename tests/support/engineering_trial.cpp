#include "tests/support/engineering_trial.hpp"

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "files/scene_file.hpp"
#include "tests/support/stepped_flow.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <optional>
#include <utility>

namespace bromwich::oracle {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Whether a row lies this close to a jump of x, either side counts; relative to T.
constexpr double beside = 1e-5;

/// Times at which two flows are compared: a jump that one of them has later is seen where it is later than rows of
/// results are apart.
constexpr Index points = 2000;

/// Distance of x to what the flow passes between t - d and t + d.
Vector apart(const Flow& flow, const Vector& x, double t, double d) {
  const Vector values[] = {flow.left(t), flow.right(t), flow.left(std::max(0.0, t - d)),
                           flow.right(std::min(flow.T, t + d))};
  Vector low = values[0], high = values[0];
  for (const Vector& v : values) low = low.cwiseMin(v), high = high.cwiseMax(v);
  return (low - x).cwiseMax(x - high).cwiseMax(0);
}

Vector largest(const RowMatrix& rows) {
  Vector sizes = Vector::Zero(rows.cols());
  for (Index j = 0; j < rows.rows(); ++j)
    sizes = rows.row(j).transpose().cwiseAbs().array().isNaN().select(
        sizes, sizes.cwiseMax(rows.row(j).transpose().cwiseAbs()));
  return sizes;
}

/// The largest |min(y, w)| of the rows: y relative to its largest value, w to the terms that it is made of.
void judge_rows(const EngineeringScene& s, const Result& r, EngineeringTrial& trial) {
  if (r.y.rows() != r.t.size() || r.x.cols() != s.states()) return;
  const Vector of_y = largest(r.y), of_x = largest(r.x);
  const Vector of_w = s.N.cwiseAbs() * of_x + s.M.cwiseAbs() * of_y + s.G.cwiseAbs().rowwise().sum();
  for (Index j = r.starts_with_impulse ? 1 : 0; j < r.t.size(); ++j) {
    double best = 1;
    for (const double side : {-1e-9, 1e-9}) {
      Vector u(Index(s.signals.size()));
      for (Index k = 0; k < u.size(); ++k) u[k] = s.signals[std::size_t(k)].value(r.t[j] + side * s.T);
      const Vector y = r.y.row(j).transpose(), w = s.N * r.x.row(j).transpose() + s.M * y + s.G * u;
      double worst = 0;
      for (Index i = 0; i < y.size(); ++i) {
        const double a = of_y[i] > 0 ? y[i] / of_y[i] : 0, b = of_w[i] > 0 ? w[i] / of_w[i] : 0;
        worst = std::max(worst, std::isnan(a + b) ? 1 : std::abs(std::min(a, b)));
      }
      best = std::min(best, worst);
    }
    if (best > trial.residual) trial.residual = best, trial.residual_at = r.t[j];
  }
}

}  // namespace

KnownFlow known_flow(const EngineeringScene& s, const Vector& x0, double T, double doubt) {
  const auto distance_of = [&](const Flow& a, const Flow& b) {
    if (!a.decided || !b.decided) return double(INFINITY);
    const Vector scale = error_scale(s, a);
    double largest = 0;
    for (Index k = 1; k <= points; ++k) {
      const double t = a.T * double(k) / double(points);
      largest = std::max(largest, apart(a, b.left(t), t, beside * a.T).cwiseQuotient(scale).maxCoeff());
    }
    return largest;
  };
  KnownFlow known;
  known.doubt = INFINITY;
  const Flow exact = switched_flow(s, x0, T);
  std::optional<Flow> before;
  // Where events accumulate only steps pass; where a resistance matters only its smaller value may do.
  for (const StageSteps& steps : {StageSteps(), StageSteps{2e-10, 1e-9, 1e-16}, StageSteps{2e-11, 1e-10, 1e-17}}) {
    Flow stepped = stepped_flow(s, x0, T, steps);
    const double of_exact = distance_of(exact, stepped), of_steps = before ? distance_of(stepped, *before) : INFINITY;
    known.doubt = std::min({known.doubt, of_exact, of_steps});
    known.decided = known.doubt <= doubt;
    known.flow = of_exact <= doubt ? exact : stepped;
    if (known.decided) return known;
    known.reason = "held basis: " + (exact.decided ? "decided" : exact.reason) +
                   "; steps: " + (stepped.decided ? "decided" : stepped.reason) + "; closest two differ by " +
                   std::to_string(known.doubt);
    before = std::move(stepped);
  }
  return known;
}

namespace {

Result solve_retold(const Retold& told, bool periodic, const Options& options, Backend& backend,
                    const std::function<void()>& solved, EngineeringTrial& trial) {
  Result r;
  const std::clock_t begin = std::clock();
  try {
    r = solve(parse_scene(scene_file(told.scene, periodic), told.scene.name + ".toml").scene, backend, options);
    trial.status = to_string(r.status), trial.reason = r.reason, trial.warning = r.warning;
  } catch (const Error& error) {
    trial.status = "error", trial.reason = error.what();
  }
  trial.seconds = double(std::clock() - begin) / CLOCKS_PER_SEC;
  if (solved) solved();
  trial.method = to_string(r.method), trial.steps = r.steps;
  trial.estimate = r.errors ? r.errors->states : r.error_estimate.value_or(nan);
  if (trial.status != "solved") trial.verdict = "refused";
  return r;
}

void compare(const EngineeringScene& s, const Flow& flow, const Retold& told, const Result& r, double tolerance,
             EngineeringTrial& trial) {
  const Vector scale = error_scale(s, flow);
  for (Index j = 1; j < r.t.size(); ++j) {  // x of row 0 may be before a jump
    const double t = std::min(flow.T, r.t[j] * told.time);
    const Vector x = told.to_original * r.x.row(j).transpose();
    const double error = x.allFinite() ? apart(flow, x, t, beside * flow.T).cwiseQuotient(scale).maxCoeff() : INFINITY;
    if (error > trial.error) trial.error = error, trial.at = t;
  }
  judge_rows(told.scene, r, trial);
  trial.verdict = trial.error <= tolerance ? "right" : trial.error <= 3 * tolerance ? "missed" : "wrong";
}

}  // namespace

EngineeringTrial try_engineering(const EngineeringScene& s, const KnownFlow& known, const Retold& told,
                                 const Options& options, Backend& backend, double tolerance,
                                 const std::function<void()>& solved) {
  EngineeringTrial trial;
  const Result r = solve_retold(told, false, options, backend, solved, trial);
  if (trial.status == "solved") compare(s, known.flow, told, r, tolerance, trial);
  return trial;
}

bool drifts(const EngineeringScene& s) {
  constexpr int settling = 60, after = 20;
  constexpr double far = 1e5, alike = 1e-2, least = 1e-6;
  Vector x = s.x0, moved;
  const auto pass = [&](int periods) {
    for (int k = 0; k < periods; ++k) {
      const Flow flow = switched_flow(s, x, s.period);
      if (!flow.decided) return false;
      moved = flow.end() - x, x = flow.end();
    }
    return true;
  };
  if (!pass(settling)) return false;
  const Vector first = s.weight.cwiseProduct(moved);
  if (first.norm() <= least * s.weight.cwiseProduct(x).norm()) return false;
  x += far * moved;
  return pass(after) && (s.weight.cwiseProduct(moved) - first).norm() <= alike * first.norm();
}

EngineeringTrial try_periodic(const EngineeringScene& s, const Retold& told, const Options& options, Backend& backend,
                              double tolerance, const std::function<void()>& solved) {
  EngineeringTrial trial;
  const Result r = solve_retold(told, true, options, backend, solved, trial);
  if (trial.status != "solved" && drifts(s)) trial.verdict = "none";
  if (trial.status != "solved") return trial;
  const Vector x0 = told.to_original * r.x.row(0).transpose();
  const KnownFlow known = known_flow(s, x0, s.period, 0.1 * tolerance);
  if (!known.decided) {
    trial.verdict = "undecided", trial.reason = known.reason;
    return trial;
  }
  trial.error = (known.flow.end() - x0).cwiseQuotient(error_scale(s, known.flow)).cwiseAbs().maxCoeff();
  trial.at = s.period;
  compare(s, known.flow, told, r, tolerance, trial);
  return trial;
}

}  // namespace bromwich::oracle
