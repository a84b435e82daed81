#include "core/accuracy/magnification.hpp"

#include "core/kernel/closed_loop.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <vector>

namespace bromwich {

namespace {

constexpr double most_certified_operations = 2e9;  ///< of a pass over the state; beyond, no magnification is computed

// dz_j = T dz_{j-1} and dy = K dz_{j-1} for the active set of a row of y. T and K are formed where a set stays for
// another row.
class TangentStep {
 public:
  TangentStep(const DiscreteProblem& p, const DenseRecurrence& r) : r_(r), response_(to_dense(p.scene.M) + r.w0) {}

  void take(const Eigen::Ref<const Vector>& y) {
    const bool other = response_.take(y);
    if (!other && map_.size() > 0) return;
    map_.resize(0, 0);
    if (other) return;
    gain_ = response_.to_columns(r_.output);
    map_ = r_.decay + r_.input * gain_;
  }

  void apply(const Vector& dz, Vector& next, Vector& dy) {
    if (map_.size() > 0) {
      dy.noalias() = gain_ * dz;
      next.noalias() = map_ * dz;
    } else {
      dy = response_.to(r_.output * dz);
      next.noalias() = r_.decay * dz;
      next.noalias() += r_.input * dy;
    }
  }

 private:
  const DenseRecurrence& r_;
  ActiveResponse response_;
  Matrix map_, gain_;  ///< map_ empty: not formed
};

// Numbers in [-1, 1] without a pattern, the same in every run.
class Signs {
 public:
  double operator()() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return double(std::int64_t(state_)) * 0x1p-63;
  }

 private:
  std::uint64_t state_ = 20;
};

// What rounding does to E: its own entries, and where eps ||hA|| is more than that, what it does to A.
Matrix rounding_of_decay(const DiscreteProblem& p, Rule rule, const StepOperators& step) {
  constexpr double perturbed = 16 * epsilon, negligible = 1e-11;
  const Matrix& A = p.small_state()->A;
  Signs signs;
  const auto sign = [&signs](double) { return signs(); };
  const Matrix own = epsilon * step.decay.unaryExpr([&](double e) { return std::abs(e) * signs(); });
  const bool precise = rule == Rule::exponential && needs_precision(A, p.h, p.J);
  const double norm = p.h * A.cwiseAbs().colwise().sum().maxCoeff();
  if (precise || !(epsilon * norm * double(p.J) > negligible)) return own;
  const Matrix change = perturbed * A.cwiseProduct(A.unaryExpr(sign));
  if (rule != Rule::exponential) return own + (epsilon / perturbed) * p.h * (step.decay * change * step.decay);
  return own + (epsilon / perturbed) * (step_operators(A + change, rule, p.h).decay - step.decay);
}

// What steps do to perturbations of a given solution, some rows at a time: a pass over the state takes little memory.
class RowsOfSteps {
 public:
  static constexpr Index at_once = 512;

  RowsOfSteps(const DiscreteProblem& p, Rule rule, const StepOperators& step, const RowMatrix& y, const RowMatrix& x)
      : p_(p), step_(step), y_(y), x_(x), rounding_of_decay_(rounding_of_decay(p, rule, step)) {}

  /// What y moves a state by in a step, the largest of all steps.
  Vector moved() const {
    const Matrix right = step_.right.cwiseAbs().transpose();
    Vector largest = Vector::Zero(x_.cols());
    for (Index j = 0; j < y_.rows(); j += at_once) {
      const RowMatrix driven = y_.middleRows(j, std::min(at_once, y_.rows() - j)) * p_.small_state()->B.transpose();
      largest = largest.cwiseMax((driven.cwiseAbs() * right).colwise().maxCoeff().transpose());
    }
    return largest;
  }

  /// Rows j, j + 1, ..., j >= 1.
  void go_to(Index j) {
    first_ = j;
    const Index rows = std::min(at_once, p_.J + 1 - j);
    const RowMatrix input = state_input(p_, y_, j, rows);
    terms = input * step_.right.transpose();
    const RowMatrix sizes = input.cwiseAbs() * step_.right.cwiseAbs().transpose();
    rounded = x_.middleRows(j - 1, rows) * rounding_of_decay_.transpose();
    for (Index k = 0; k < rows; ++k)
      for (Index i = 0; i < x_.cols(); ++i)
        rounded(k, i) += epsilon * (std::abs(x_(j + k, i)) + sizes(k, i)) * signs_();
  }
  bool holds(Index j) const { return first_ > 0 && j - first_ < rounded.rows(); }
  Index place(Index j) const { return j - first_; }

  RowMatrix terms;    ///< rows x m, of the sum that makes x_j
  RowMatrix rounded;  ///< rows x m, the rounding of each step and component

 private:
  const DiscreteProblem& p_;
  const StepOperators& step_;
  const RowMatrix &y_, &x_;
  const Matrix rounding_of_decay_;
  Signs signs_;
  Index first_ = 0;
};

bool same_set(const RowMatrix& y, Index a, Index b) { return ((y.row(a).array() > 0) == (y.row(b).array() > 0)).all(); }

// Fixed, with parts in all components that the solution moves.
Vector perturbation(const Vector& scale) {
  Vector dz(scale.size());
  for (Index i = 0; i < dz.size(); ++i) dz[i] = std::cos(1.0 + 2.399963 * double(i)) * scale[i];
  return dz;
}

// |D^{-1} x|; components that the solution does not move count where something else moves them.
class ScaledNorm {
 public:
  explicit ScaledNorm(const Vector& scale) {
    const double least = std::max(1e-8 * (scale.size() > 0 ? scale.maxCoeff() : 0), 1e-290);
    inverse_ = scale.cwiseMax(least).cwiseInverse();
  }
  template <class V>
  double operator()(const V& v) const {
    return v.cwiseProduct(inverse_).norm();
  }

 private:
  Vector inverse_;
};

constexpr double rounding_margin = 2;  ///< the roundings of a run are one sample

// How much a perturbation of the state grows, from a step to any later one.
class Growth {
 public:
  Growth(const Vector& first, const ScaledNorm& norm)
      : norm_(norm), start_(norm(first) > 0 ? Vector(first / norm(first)) : first), dz_(start_), next_(first.size()) {}

  void step(TangentStep& tangent) {
    tangent.apply(dz_, next_, dy_);
    dz_.swap(next_);
    size_ = norm_(dz_);
    if (size_ < 1e-14) {  // the perturbation is gone, what is left of it is rounding: another one starts
      dz_ = start_;
      sizes_.push_back(0);
      return;
    }
    dz_ /= size_;
    sizes_.push_back(size_);
  }
  bool finite() const { return std::isfinite(size_); }
  /// From each step, step 0 first.
  Vector from_steps() const {
    const Vector logarithms = Eigen::Map<const Vector>(sizes_.data(), Index(sizes_.size())).array().log();
    Vector most = Vector::Zero(logarithms.size() + 1);
    double later = 0;
    for (Index j = logarithms.size() - 1; j >= 0; --j)
      most[j] = std::min(later = std::max(0.0, later + logarithms[j]), 700.0);
    return most.array().exp();
  }

 private:
  const ScaledNorm& norm_;
  Vector start_, dz_, next_, dy_;
  double size_ = 1;
  std::vector<double> sizes_;  ///< the growth in each step; 0: nothing of it arrives
};

struct GrowingMode {
  double rate = 0;  ///< 0: nothing grows
  Vector v;
};

// By steps of implicit Euler of length 1/z, which have to be short enough for it.
GrowingMode growing_mode(const LinearSystem& d, double z) {
  constexpr int steps = 80, counted = 20;
  const auto shifted = d.at_shift(z);
  GrowingMode mode;
  if (!shifted) return mode;
  mode.v = Vector::NullaryExpr(d.states(), [](Index i) { return std::sin(1 + double(i) * double(i)); });
  double grown = 0;  // logarithm
  for (int i = 0; i < steps; ++i) {
    mode.v = z * shifted->solve(Vector(d.times_mass(mode.v)));
    const double size = mode.v.norm();
    if (!(size > 0) || !std::isfinite(size)) return {};
    if (i >= steps - counted) grown += std::log(size);
    mode.v /= size;
  }
  mode.rate = std::max(0.0, z * (1 - std::exp(-grown / counted)));
  return mode;
}

}  // namespace

double growth_rate(const DiscreteProblem& p) {
  constexpr double none = 1e-6;  // of the largest entry
  const SparseDynamics* d = p.small_state() ? nullptr : p.scene.dynamics->matrices();
  const double z = d ? 2 * p.shared->spectrum().abscissa : 0;
  if (!(z > 0)) return 0;
  const auto matters = [&](const Vector& found, const Vector& terms) {
    return ((found.cwiseAbs() - none * terms).array() > 0).any();
  };
  const auto meets = [&](const SparseMatrix& rows, const Vector& v) {
    return matters(rows * v, rows.cwiseAbs() * Vector::Constant(v.size(), v.cwiseAbs().maxCoeff()));
  };
  const GrowingMode right = growing_mode(*p.scene.dynamics, z);
  if (right.rate == 0) return 0;
  const double largest = right.v.cwiseAbs().maxCoeff();
  const bool recorded = std::any_of(p.components.begin(), p.components.end(),
                                    [&](Index i) { return std::abs(right.v[i]) > none * largest; });
  if (!recorded && !meets(d->N, right.v)) return 0;
  const auto transposed =
      linear_system(SparseDynamics{d->A.transpose(), d->N.transpose(), d->B.transpose(), d->E.transpose()});
  const GrowingMode left = growing_mode(*transposed, z);
  const SparseMatrix F = p.scene.F.transpose();
  const Vector start = p.scene.dynamics->times_mass(p.scene.x0);
  const bool excited = left.rate == 0 || meets(d->B.transpose(), left.v) || (F.size() > 0 && meets(F, left.v)) ||
                       std::abs(left.v.dot(start)) > none * left.v.cwiseAbs().dot(start.cwiseAbs());
  return excited ? right.rate : 0;
}

Magnification magnification(const DiscreteProblem& p, Rule rule, const RowMatrix& y, const RowMatrix& recorded) {
  const DenseDynamics* d = p.small_state();
  const double m = double(p.scene.states()), n = double(p.scene.constraints());
  if (!d || double(p.J) * (3 * m * m + 4 * m * n) > most_certified_operations || !y.allFinite())
    return {NAN, NAN, NAN, NAN, NAN, {}, {}};
  const std::shared_ptr<const StepOperators> operators = state_step(p, rule);
  const StepOperators& step = *operators;
  const DenseRecurrence r = dense_recurrence(*d, step);
  Magnification result;
  StatesOfY states = recorded.rows() == p.J + 1 && recorded.cols() == p.scene.states() ? StatesOfY{recorded, 0}
                                                                                       : states_of(p, rule, y);
  const RowMatrix& x = states.x;
  result.correction = states.correction;
  RowsOfSteps rows(p, rule, step, y, x);
  // A state that y and f hold at zero is rounding of what they move.
  constexpr double cancelled = 1e-12;
  result.scale = x.cwiseAbs().colwise().maxCoeff().transpose().cwiseMax(cancelled * rows.moved());
  const ScaledNorm norm(result.scale);

  TangentStep tangent(p, r);
  Growth growth(perturbation(result.scale), norm);
  Vector error = epsilon * perturbation(p.scene.x0), next(error.size()), output(p.scene.constraints());
  double size = norm(p.scene.x0);
  std::vector<Index> unresolved;  // rows whose active set is not that of both their neighbours
  for (Index j = 1; j <= p.J; ++j) {
    if (!rows.holds(j)) rows.go_to(j);
    tangent.take(y.row(j).transpose());
    tangent.apply(error, next, output);
    if (n > 0) result.output = std::max(result.output, rounding_margin * output.cwiseAbs().maxCoeff());
    error = next + rows.rounded.row(rows.place(j)).transpose();
    growth.step(tangent);
    size = std::max(size, norm(x.row(j).transpose()) + norm(rows.terms.row(rows.place(j)).transpose()));
    if (j < p.J && (!same_set(y, j, j - 1) || !same_set(y, j, j + 1))) unresolved.push_back(j);
    result.rounding = std::max(result.rounding, size > 0 ? rounding_margin * norm(error) / size : 0);
    if (!growth.finite() || !std::isfinite(norm(error))) result.rounding = INFINITY;
  }
  const Vector grown = growth.from_steps();
  result.growth = grown.maxCoeff();
  for (const Index j : unresolved) {
    const double driven = norm(Vector(d->B * y.row(j).transpose()));
    if (size > 0) result.impulse = std::max(result.impulse, grown[j] * p.h * driven / size);
  }
  result.x = std::move(states.x);
  return result;
}

Change change_when_halved(const RowMatrix& coarse, const RowMatrix& fine, Index last) {
  std::vector<double> rows;
  double size = 0, sum = 0, whole = 0;
  for (Index j = 1; j <= last && coarse.cols() > 0; ++j) {
    const auto difference = (coarse.row(j) - fine.row(2 * j)).cwiseAbs();
    rows.push_back(difference.maxCoeff<Eigen::PropagateNaN>());
    if (std::isnan(rows.back())) return {INFINITY, INFINITY, INFINITY};
    size = std::max(size, fine.row(2 * j).cwiseAbs().maxCoeff());
    sum += difference.sum();
    whole += fine.row(2 * j).cwiseAbs().sum();
  }
  if (rows.empty() || size == 0) return {};
  std::sort(rows.begin(), rows.end());
  return {rows.back() / size, rows[(rows.size() - 1) * 95 / 100] / size, sum / whole};
}

}  // namespace bromwich
