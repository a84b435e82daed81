#include "tests/support/engineering_trial.hpp"

#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "files/scene_file.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich::oracle {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Whether a row lies this close to a jump of x, either side counts; relative to T.
constexpr double beside = 1e-5;

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
  const FlowSteps fine, coarse{1e-8, 8e-7, 1.0 / 40, 1e-8, fine.most};
  KnownFlow known;
  known.flow = switched_flow(s, x0, T, fine);
  known.reason = known.flow.reason;
  if (!known.flow.decided) return known;
  const Flow other = switched_flow(s, x0, T, coarse);
  known.reason = other.reason;
  if (!other.decided) return known;
  const Vector scale = error_scale(s, known.flow);
  for (Index k = 1; k <= 200; ++k) {
    const double t = known.flow.T * double(k) / 200;
    const Vector d = apart(known.flow, other.left(t), t, beside * known.flow.T);
    known.doubt = std::max(known.doubt, d.cwiseQuotient(scale).maxCoeff());
  }
  known.decided = known.doubt <= doubt;
  if (!known.decided) known.reason = "two answers differ by " + std::to_string(known.doubt);
  return known;
}

namespace {

Result solved(const Retold& told, bool periodic, const Options& options, Backend& backend, EngineeringTrial& trial) {
  Result r;
  try {
    r = solve(parse_scene(scene_file(told.scene, periodic), told.scene.name + ".toml").scene, backend, options);
    trial.status = to_string(r.status), trial.reason = r.reason, trial.warning = r.warning;
  } catch (const Error& error) {
    trial.status = "error", trial.reason = error.what();
  }
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
                                 const Options& options, Backend& backend, double tolerance) {
  EngineeringTrial trial;
  const Result r = solved(told, false, options, backend, trial);
  if (trial.status == "solved") compare(s, known.flow, told, r, tolerance, trial);
  return trial;
}

EngineeringTrial try_periodic(const EngineeringScene& s, const Retold& told, const Options& options, Backend& backend,
                              double tolerance) {
  EngineeringTrial trial;
  const Result r = solved(told, true, options, backend, trial);
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
