#include "app/fit.hpp"

#include "app/parameter_columns.hpp"
#include "app/text.hpp"
#include "circuits/probe.hpp"
#include "core/base/error.hpp"
#include "core/solve/dense_output.hpp"

#include <fmt/format.h>
#include <Eigen/QR>
#include <unsupported/Eigen/NonLinearOptimization>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace bromwich::app {

namespace {

const double difference = std::cbrt(epsilon);  ///< relative step of central differences
constexpr double worse = 1e3;                  ///< residual of a trial without a solution, over the largest datum
constexpr int most_evaluations = 200;
constexpr int most_scanned = 2;  ///< parameters whose starts are varied

// u to p, within the bounds.
class Substitution {
 public:
  explicit Substitution(const FreeParameter& p) : p_(p), scale_(p.start != 0 ? std::abs(p.start) : 1) {}

  double value(double u) const {
    if (two()) return p_.low + (p_.high - p_.low) * (1 + std::sin(u)) / 2;
    if (std::isfinite(p_.low)) return p_.low + scale_ * (std::sqrt(u * u + 1) - 1);
    if (std::isfinite(p_.high)) return p_.high - scale_ * (std::sqrt(u * u + 1) - 1);
    return scale_ * u;
  }
  double slope(double u) const {
    if (two()) return (p_.high - p_.low) * std::cos(u) / 2;
    if (std::isfinite(p_.low)) return scale_ * u / std::sqrt(u * u + 1);
    if (std::isfinite(p_.high)) return -scale_ * u / std::sqrt(u * u + 1);
    return scale_;
  }
  double start() const { return of(p_.start); }
  double scale() const { return p_.start == 0 && two() ? p_.high - p_.low : scale_; }
  // Of a multiple of the start; none outside of the bounds, or of 0.
  std::optional<double> scaled(double factor) const {
    const double p = factor * p_.start;
    if (factor != 1 && (p_.start == 0 || !(p > p_.low && p < p_.high))) return std::nullopt;
    return of(p);
  }

 private:
  double of(double p) const {
    if (two()) return std::asin(std::clamp(2 * (p - p_.low) / (p_.high - p_.low) - 1, -0.99, 0.99));
    const double from = std::isfinite(p_.low) ? p - p_.low : p_.high - p;
    if (std::isfinite(from)) return std::sqrt(std::pow(std::max(from / scale_, 1e-3) + 1, 2) - 1);
    return p / scale_;
  }

  bool two() const { return std::isfinite(p_.low) && std::isfinite(p_.high); }
  FreeParameter p_;
  double scale_;
};

class Problem {
 public:
  // For the library.
  using Scalar = double;
  using InputType = Vector;
  using ValueType = Vector;
  using JacobianType = Matrix;
  enum { InputsAtCompileTime = Eigen::Dynamic, ValuesAtCompileTime = Eigen::Dynamic };

  Problem(const FitModels& model_of, const std::vector<FreeParameter>& free, const FitData& data, Backend& backend,
          Options options)
      : model_of_(model_of), free_(free), data_(data), backend_(backend), options_(std::move(options)) {
    for (const FreeParameter& p : free) by_.emplace_back(p);
    options_.trace = need_trace(data.columns);
    // N x between time points takes the state.
    const bool states = options_.trace || !states_of(data.columns).empty();
    options_.states = states ? StateSelection::all : StateSelection::none;
    for (Index j = 0; j < data.values.rows(); ++j)
      for (Index k = 0; k < data.values.cols(); ++k)
        if (!std::isnan(data.values(j, k))) places_.emplace_back(j, k);
    most_ = 0;
    for (const auto& [j, k] : places_) most_ = std::max(most_, std::abs(data.values(j, k)));
  }

  int inputs() const { return int(by_.size()); }
  int values() const { return int(places_.size()); }
  const std::string& derivatives() const { return derivatives_; }
  Index evaluations = 0, jacobians = 0;

  Vector start() const {
    Vector u(inputs());
    for (Index i = 0; i < u.size(); ++i) u[i] = by_[std::size_t(i)].start();
    return u;
  }
  Vector parameters(const Vector& u) const {
    Vector p(u.size());
    for (Index i = 0; i < u.size(); ++i) p[i] = by_[std::size_t(i)].value(u[i]);
    return p;
  }

  // The residuals; empty where there is no solution.
  std::optional<Vector> residuals(const Vector& p, std::string& reason) {
    ++evaluations;
    const FitModel model = model_of_(p);
    Result r = solve(model.scene, backend_, options_);
    if (r.status != Status::solved) {
      reason = fmt::format("{} {}", to_string(r.status), r.reason);
      return std::nullopt;
    }
    const Vector values =
        at_places(values_of(model, at_times(model.scene, backend_, r, data_.t), data_.columns) - data_.values);
    last_ = std::move(r);
    last_p_ = p;
    return values;
  }

  // Of the values within a factor three of the start, and within the bounds, those with the least residual: sums of
  // squares have local minima.
  Vector best_start() {
    const Vector start = this->start();
    if (inputs() > most_scanned) return start;
    constexpr std::array<double, 5> factors{1, 0.57735, 1.73205, 1.0 / 3, 3};
    Vector best = start, out(values());
    double least = INFINITY;
    Index count = 1;
    for (int i = 0; i < inputs(); ++i) count *= Index(factors.size());
    for (Index k = 0; k < count; ++k) {
      Vector u = start;
      bool inside = true;
      for (Index i = 0, rest = k; i < u.size(); ++i, rest /= Index(factors.size())) {
        const auto at = by_[std::size_t(i)].scaled(factors[std::size_t(rest) % factors.size()]);
        inside = inside && at.has_value();
        if (at) u[i] = *at;
      }
      if (!inside) continue;
      (*this)(u, out);
      if (out.squaredNorm() < least) least = out.squaredNorm(), best = u;
    }
    return best;
  }

  int operator()(const Vector& u, Vector& out) {
    std::string reason;
    const auto found = residuals(parameters(u), reason);
    out = found && found->allFinite() ? *found : Vector::Constant(values(), worse * std::max(most_, 1e-290));
    return 0;
  }

  int df(const Vector& u, Matrix& J) {
    J = by_parameters(parameters(u));
    for (Index i = 0; i < u.size(); ++i) J.col(i) *= by_[std::size_t(i)].slope(u[i]);
    return 0;
  }

  // Of the residuals with respect to p.
  Matrix by_parameters(const Vector& p) {
    ++jacobians;
    try {
      return exact(p);
    } catch (const Error& e) {
      derivatives_ = fmt::format("central differences of solves ({})", e.found());
      return by_differences(p);
    }
  }

 private:
  // p with component i a step below and above. Parameters have units of their own: none says how large another is.
  std::pair<Vector, Vector> around(const Vector& p, Index i) const {
    const double d = difference * std::max(std::abs(p[i]), 1e-3 * by_[std::size_t(i)].scale());
    std::pair<Vector, Vector> both(p, p);
    both.first[i] -= d;
    both.second[i] += d;
    return both;
  }

  Vector at_places(const RowMatrix& all) const {
    Vector values(this->values());
    for (std::size_t k = 0; k < places_.size(); ++k) values[Index(k)] = all(places_[k].first, places_[k].second);
    return values;
  }

  Matrix exact(const Vector& p) {
    const FitModel model = model_of_(p);
    const Scene& scene = model.scene;
    std::string reason;
    if (last_p_ != p && !residuals(p, reason)) throw Error("derivative", reason, "");
    std::vector<VariedParameter> parameters;
    for (Index i = 0; i < p.size(); ++i)
      parameters.push_back({free_[std::size_t(i)].name, p[i], [this, p, i](double value) {
                              Vector changed = p;
                              changed[i] = value;
                              return ParameterScene{model_of_(changed).scene};
                            }});
    const ParameterDerivative d(scene, last_, backend_, parameters, {}, data_.t);
    const bool of_trace = std::any_of(data_.columns.begin(), data_.columns.end(),
                                      [](const Column& c) { return c.kind == ColumnKind::trace; });
    Matrix J(values(), inputs());
    for (Index i = 0; i < p.size(); ++i) {
      if (of_trace && d.change(i).N.size() > 0) throw Error("derivative", "N changes, and N x is measured", "");
      const SolutionChange change = d.jvp(i, true);
      J.col(i) = model.circuit ? of_outputs(p, i, change, d.times(), scene) : column(change, d.times(), scene);
    }
    derivatives_ = d.in_words();
    return J;
  }

  Vector column(const SolutionChange& change, const Vector& t, const Scene& scene) const {
    Vector values(this->values());
    for (std::size_t k = 0; k < places_.size(); ++k) {
      const auto& [j, column] = places_[k];
      values[Index(k)] = column_of(change, t, scene, data_.columns[std::size_t(column)], {data_.t[std::size_t(j)]})[0];
    }
    return values;
  }

  // Outputs of a circuit depend on the parameter and on the solution: a difference along the change of both.
  Vector of_outputs(const Vector& p, Index i, const SolutionChange& change, const Vector& t, const Scene& scene) const {
    const auto [below, above] = around(p, i);
    const double step = (above[i] - below[i]) / 2;
    const Result at = at_times(scene, backend_, last_, data_.t);
    const auto moved = [&](const Vector& to, double by) {
      Result r = at;
      for (Index k = 0; k < r.x.cols(); ++k)
        r.x.col(k) += by * column_of(change, t, scene, {ColumnKind::x, k, {}}, data_.t);
      for (Index k = 0; k < r.y.cols(); ++k)
        r.y.col(k) += by * column_of(change, t, scene, {ColumnKind::y, k, {}}, data_.t);
      return values_of(model_of_(to), r, data_.columns);
    };
    return at_places(moved(above, step) - moved(below, -step)) / (2 * step);
  }

  Matrix by_differences(const Vector& p) {
    Matrix J(values(), inputs());
    for (Index i = 0; i < p.size(); ++i) {
      const auto [below, above] = around(p, i);
      std::string reason;
      const auto a = residuals(below, reason), b = residuals(above, reason);
      J.col(i) = a && b ? Vector((*b - *a) / (above[i] - below[i])) : Vector::Zero(values());
    }
    return J;
  }

  const FitModels& model_of_;
  const std::vector<FreeParameter>& free_;
  const FitData& data_;
  Backend& backend_;
  Options options_;
  std::vector<Substitution> by_;
  std::vector<std::pair<Index, Index>> places_;  ///< row and column of each datum
  double most_ = 0;
  Result last_;
  Vector last_p_;  ///< the parameters of `last_`
  std::string derivatives_;
};

std::string words_of(Eigen::LevenbergMarquardtSpace::Status status) {
  using namespace Eigen::LevenbergMarquardtSpace;
  switch (status) {
    case RelativeReductionTooSmall:
    case RelativeErrorTooSmall:
    case RelativeErrorAndReductionTooSmall:
    case CosinusTooSmall:
      return "converged";
    case TooManyFunctionEvaluation:
      return fmt::format("no convergence in {} evaluations", most_evaluations);
    case FtolTooSmall:
    case XtolTooSmall:
    case GtolTooSmall:
      return "converged to rounding";
    default:
      return "ended without progress";
  }
}

// The 97.5 % quantile of Student's t with n degrees of freedom (Hill's expansion; Abramowitz & Stegun 26.7.5).
double student(double n) {
  const double z = 1.959963984540054, z2 = z * z;
  if (n < 1.5) return 12.7062;
  if (n < 2.5) return 4.3027;
  return z + z * (z2 + 1) / (4 * n) + z * (5 * z2 * z2 + 16 * z2 + 3) / (96 * n * n) +
         z * (3 * z2 * z2 * z2 + 19 * z2 * z2 + 17 * z2 - 15) / (384 * n * n * n);
}

void add_confidence(const Matrix& J, const Vector& residual, Fit& fit) {
  const Index k = J.cols();
  const double freedom = double(J.rows() - k);
  fit.deviation = fit.low = fit.high = Vector::Constant(k, NAN);
  fit.correlation = Matrix::Constant(k, k, NAN);
  fit.deviation_of_data = freedom > 0 ? residual.norm() / std::sqrt(freedom) : NAN;
  const Vector size = J.colwise().norm().transpose();
  if (!(size.minCoeff() > 0) || !(freedom > 0)) return;
  const Eigen::ColPivHouseholderQR<Matrix> qr(J * size.cwiseInverse().asDiagonal());
  if (qr.rank() < k) return;
  const Matrix scaled = J * size.cwiseInverse().asDiagonal();
  const Matrix inverse = (scaled.transpose() * scaled).inverse();
  const Vector root = inverse.diagonal().cwiseSqrt();
  fit.deviation = fit.deviation_of_data * root.cwiseQuotient(size);
  fit.correlation = root.cwiseInverse().asDiagonal() * inverse * root.cwiseInverse().asDiagonal();
  fit.low = fit.p - student(freedom) * fit.deviation;
  fit.high = fit.p + student(freedom) * fit.deviation;
}

}  // namespace

double value_of(const Scene& scene, const Result& at, Index j, const Column& c) {
  switch (c.kind) {
    case ColumnKind::y:
      return at.y(j, c.component);
    case ColumnKind::x:
      return at.x(j, c.component);
    case ColumnKind::trace:
      return at.trace(j, c.component);
    case ColumnKind::mode:
      return at.modes(j, c.component);
    case ColumnKind::contact:  // not among the columns of data
    case ColumnKind::w:
      break;
  }
  Vector g = Vector::Zero(scene.constraints());
  if (scene.g) scene.g(at.t[j], g);
  return at.trace(j, c.component) + multiply(scene.M, at.y.row(j).transpose())[c.component] + g[c.component];
}

RowMatrix values_of(const FitModel& model, const Result& at, const std::vector<Column>& columns) {
  RowMatrix values(at.t.size(), Index(columns.size()));
  if (model.circuit) {
    const RowMatrix outputs = output_values(*model.circuit, at);
    for (std::size_t k = 0; k < columns.size(); ++k)
      values.col(Index(k)) = Probe(*model.circuit, columns[k].name, "--data")(at.t, outputs);
    return values;
  }
  for (Index j = 0; j < values.rows(); ++j)
    for (Index k = 0; k < values.cols(); ++k) values(j, k) = value_of(model.scene, at, j, columns[std::size_t(k)]);
  return values;
}

Fit fit(const FitModels& model_of, const std::vector<FreeParameter>& free, const FitData& data, Backend& backend,
        const Options& options) {
  Problem problem(model_of, free, data, backend, options);
  if (problem.values() < problem.inputs())
    throw Error("--data", fmt::format("has {} values for {} parameters", problem.values(), problem.inputs()),
                "give more data, or fewer parameters in --free");
  std::string reason;
  Vector u = problem.start();
  if (!problem.residuals(problem.parameters(u), reason))
    throw Error("--free", fmt::format("the start is not solved ({})", reason), "start from other values, by --set");
  u = problem.best_start();
  Eigen::LevenbergMarquardt<Problem> method(problem);
  method.parameters.maxfev = most_evaluations;
  method.parameters.ftol = method.parameters.xtol = 1e-10;
  const auto status = method.minimize(u);
  Fit found;
  found.ended = words_of(status);
  found.converged = found.ended.rfind("converged", 0) == 0;
  found.p = problem.parameters(u);
  Vector residual(problem.values());
  problem(u, residual);
  found.data = problem.values();
  add_confidence(problem.by_parameters(found.p), residual, found);
  found.evaluations = problem.evaluations;
  found.jacobians = problem.jacobians;
  found.derivatives = problem.derivatives();
  return found;
}

}  // namespace bromwich::app
