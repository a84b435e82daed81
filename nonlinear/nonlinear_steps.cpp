#include "nonlinear/nonlinear_steps.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dense.hpp"
#include "core/lcp/active_set.hpp"
#include "core/solve/solve.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double stalled = 1e-8;  ///< changes below that no longer halve are rounding
const char* const no_solution = "its linear complementarity problem has no solution, or none was found";

double largest(const Vector& v) { return v.size() > 0 ? v.cwiseAbs().maxCoeff() : 0; }

// Relative to the largest value that there was, in any units.
double relative(const Vector& change, const Vector& to, double& size) {
  const double most = largest(change);
  size = std::max(size, largest(to));
  return most > 0 ? most / std::max(size, most) : 0;
}

// "" or which of the two is not finite.
std::string not_finite(const char* name, const Linearization& l) {
  if (!l.value.allFinite()) return std::string(name) + " is not finite";
  return l.by_x.allFinite() && l.by_y.allFinite() ? "" : std::string("the derivatives of ") + name + " are not finite";
}

// The change of w by that of y, relative to the largest term of w that there was: where gamma is steep, as at the start
// of a diode's law, a change of y that is nothing beside the largest y is one of w that is not.
double relative_in_slack(const Matrix& M, const Vector& change, const Vector& y, const Vector& terms, double& size) {
  size = std::max({size, largest(terms), largest(M.cwiseAbs() * y)});
  const double moved = largest(M.cwiseAbs() * change.cwiseAbs());
  return moved > 0 ? moved / std::max(size, moved) : 0;
}

// Newton's iteration of a law that is steep at one end and flat at the other, as that of a diode, may jump to and fro
// between the two. An iterate at which y and w are complementary less well than at the one before goes half the way
// back.
class Descent {
 public:
  /// Whether the iterate is worse, and has gone back.
  bool turned_back(Index iterations, const Vector& w, Vector& X, Vector& Y) {
    constexpr double clearly = 2;  // more than rounding
    constexpr Index undamped = 8;  // an iteration that converges has nearly done so by then
    const double merit = largest(w.cwiseMin(Y));
    const bool worse = iterations > undamped && merit > clearly * merit_;
    if (worse) {
      X = (X + X_) / 2;
      Y = (Y + Y_) / 2;
    } else {
      X_ = X, Y_ = Y, merit_ = merit;
    }
    return worse;
  }

 private:
  Vector X_, Y_;
  double merit_ = INFINITY;
};

// Whether a change of y is lost in the rounding of w = ... + M y: where the forces on a constraint cancel, y is noise
// of any relative change.
bool lost_in_slack(const Matrix& M, const Vector& change, const Vector& terms) {
  constexpr double roundings = 16;
  return ((M.cwiseAbs() * change.cwiseAbs()).array() <= roundings * epsilon * terms.array()).all();
}

// Whether an eigenvalue of I - Z has left the right half plane, where those of short steps are: behind it the step
// turns growth by more than e^2 into decay. Up to `most` rows; of larger ones the sign of the determinant.
bool turns_growth_round(const Matrix& by_x, const Eigen::PartialPivLU<Matrix>& lu) {
  constexpr Index most = 64;
  const Matrix Z = Matrix::Identity(by_x.rows(), by_x.cols()) - by_x;
  if (Z.cwiseAbs().rowwise().sum().maxCoeff() < 1) return false;
  if (by_x.rows() > most) return lu.permutationP().determinant() * lu.matrixLU().diagonal().array().sign().prod() < 0;
  return !(Eigen::EigenSolver<Matrix>(by_x, false).eigenvalues().real().minCoeff() > 0);
}

// ∫_0^{c_i h} e^{(c_i h - s) A} f ds of every step and node: from the solution without constraints, on a grid that has
// the nodes as points.
RowMatrix increments_of(const Scene& scene, const DenseDynamics& d, Backend& backend, Index J,
                        const ExponentialStep& step) {
  const Index m = d.A.rows(), nodes = Index(step.nodes.size());
  RowMatrix s = RowMatrix::Zero(J * nodes, m);
  if (!scene.f) return s;
  Scene free = scene;
  free.dynamics = DenseDynamics{d.A, Matrix::Zero(m, 1), Matrix::Zero(1, m)};
  free.M = Matrix(Matrix::Ones(1, 1));
  free.lcp_class = LcpClass::automatic;
  free.g = [](double, Eigen::Ref<Vector> v) { v.setOnes(); };
  free.names = free.units = Labels();
  Options options;
  options.method = Method::march;
  options.steps = J * (nodes == 2 ? 3 : 1);
  options.states = StateSelection::all;
  options.confirm = false;  // nothing switches
  const Result r = solve(free, backend, options);
  if (r.status != Status::solved) throw Error("f", "its response is not known: " + r.reason, "look at f and A");
  const Index apart = options.steps / J;
  for (Index j = 0; j < J; ++j)
    for (Index i = 0; i < nodes; ++i) {
      const Index at = j * apart + (i + 1 == nodes ? apart : 1);
      s.row(j * nodes + i) = r.x.row(at) - r.x.row(j * apart) * step.propagators[std::size_t(i)].transpose();
    }
  return s;
}

}  // namespace

NonlinearSteps::NonlinearSteps(const NonlinearScene& scene, Backend& backend, Index J, StepRule rule, double tolerance,
                               Index most_newton)
    : scene_(&scene),
      M_(to_dense(scene.linear.M)),
      h_(scene.linear.T / double(J)),
      tolerance_(tolerance),
      most_newton_(most_newton) {
  const DenseDynamics& d = *scene.linear.dynamics->small_state();
  A_ = d.A;
  B_ = d.B;
  N_ = d.N;
  step_ = make_exponential_step(A_, h_, rule);
  increments_ = increments_of(scene.linear, d, backend, J, step_);
}

Vector NonlinearSteps::g(double t) const {
  Vector value = Vector::Zero(N_.rows());
  if (scene_->linear.g) scene_->linear.g(t, value);
  return value;
}

Vector NonlinearSteps::total_source(double t, const Vector& x, const Vector& y) const {
  Vector value = Vector::Zero(x.size());
  if (scene_->phi) scene_->phi(t, x, y, value);
  return value + B_ * y;
}

Vector NonlinearSteps::defect(Index j, const Vector& x0, const Vector& y0, const Vector& x1, const Vector& y1) const {
  return x1 - carry(j, x0, total_source(time(j - 1), x0, y0), total_source(time(j), x1, y1));
}

Vector NonlinearSteps::carry(Index j, const Vector& x0, const Vector& F0, const Vector& F1) const {
  return step_.propagators[0] * x0 + increments_.row(j - 1).transpose() + step_.left[0] * F0 + step_.weights[0][0] * F1;
}

LcpClass NonlinearSteps::lcp_class(const Vector& x, const Vector& y) const {
  if (N_.rows() == 0) return LcpClass::P;
  const Linearization gamma = linearize(scene_->gamma, scene_->dgamma, N_.rows(), 0, x, y);
  const LcpClass stated = scene_->linear.lcp_class;
  return known_class(LcpMatrix(Matrix(M_ + gamma.by_y)), stated);
}

// `of_y`: the part of the matrix that is M + gamma_y. The class of a step's matrix is kept until a problem stays
// unsolved: the test of a class costs more than the problem.
bool NonlinearSteps::solve_lcp(const Matrix& M, const Matrix& of_y, const Vector& q, Vector& y) const {
  const auto solve_as = [&](LcpClass c) {
    ActiveSetLcp lcp(M, c, least_ ? &of_y : nullptr);
    lcp.start_from(y);
    Vector found = y;
    if (!lcp.solve(q, found).solved || !found.allFinite()) return false;
    y = std::move(found);
    return true;
  };
  if (least_) return solve_as(LcpClass::Z);
  if (class_ && solve_as(*class_)) return true;
  class_ = selection_class(LcpMatrix(M), LcpClass::automatic);
  return solve_as(*class_);
}

NewtonOutcome NonlinearSteps::y_at(Index j, const Vector& x, Vector& y) const {
  NewtonOutcome outcome;
  const Vector given = g(time(j)), fixed = N_ * x + given;
  const Vector terms_of_fixed = N_.cwiseAbs() * x.cwiseAbs() + given.cwiseAbs();
  double size = 0, size_w = size_w_;
  Descent descent;
  Vector none;
  for (double before = INFINITY; outcome.iterations < most_newton_; before = outcome.change) {
    ++outcome.iterations;
    const Linearization gamma = linearize(scene_->gamma, scene_->dgamma, N_.rows(), time(j), x, y);
    outcome.why = not_finite("gamma", gamma);
    outcome.nonfinite = !gamma.value.allFinite();
    if (!outcome.why.empty()) return outcome;
    if (descent.turned_back(outcome.iterations, fixed + M_ * y + gamma.value, none, y)) continue;
    const Matrix M = M_ + gamma.by_y;
    Vector next = y;
    if (!solve_lcp(M, M, fixed + gamma.value - gamma.by_y * y, next)) return outcome.why = no_solution, outcome;
    const Vector terms = terms_of_fixed + gamma.value.cwiseAbs() + M_.cwiseAbs() * next;
    outcome.change = std::max(relative(next - y, next, size), relative_in_slack(M, next - y, next, terms, size_w));
    if (lost_in_slack(M, next - y, terms)) outcome.change = 0;
    y = next;
    outcome.solved = outcome.change <= tolerance_ || (outcome.change <= stalled && outcome.change > before / 2);
    if (!scene_->gamma) outcome.solved = true;  // the problem is linear
    if (outcome.solved) return outcome;
  }
  return outcome;
}

struct NonlinearSteps::Equations {
  Vector R, w, terms;          ///< terms: the sizes of what is summed in w
  Matrix by_x, by_y, of_w, M;  ///< R_X, R_Y, N + gamma_x, M + gamma_y
  std::string why = {};        ///< a value is not finite
};

NonlinearSteps::Equations NonlinearSteps::equations(const StepData& step, const Vector& X, const Vector& Y,
                                                    const Vector& known) const {
  const Index nodes = Index(step.times.size()), m = X.size() / nodes, n = Y.size() / nodes;
  Equations e{X - known,
              Vector(nodes * n),
              Vector(nodes * n),
              Matrix::Identity(nodes * m, nodes * m),
              Matrix::Zero(nodes * m, nodes * n),
              Matrix::Zero(nodes * n, nodes * m),
              Matrix::Zero(nodes * n, nodes * n)};
  for (Index k = 0; k < nodes; ++k) {
    const double t = step.times[std::size_t(k)];
    const Vector& g = step.g[std::size_t(k)];
    const Vector x_k = X.segment(k * m, m), y_k = Y.segment(k * n, n);
    const Linearization phi = linearize(scene_->phi, scene_->dphi, m, t, x_k, y_k);
    const Linearization gamma = linearize(scene_->gamma, scene_->dgamma, n, t, x_k, y_k);
    e.why = not_finite("phi", phi);
    if (e.why.empty()) e.why = not_finite("gamma", gamma);
    if (!e.why.empty()) return e;
    const Vector F = B_ * y_k + phi.value;
    const Matrix F_y = B_ + phi.by_y;
    for (Index i = 0; i < nodes; ++i) {
      const Matrix& W = step.rule.weights[std::size_t(i)][std::size_t(k)];
      e.R.segment(i * m, m) -= W * F;
      e.by_x.block(i * m, k * m, m, m) -= W * phi.by_x;
      e.by_y.block(i * m, k * n, m, n) -= W * F_y;
    }
    e.w.segment(k * n, n) = N_ * x_k + M_ * y_k + g + gamma.value;
    e.terms.segment(k * n, n) =
        N_.cwiseAbs() * x_k.cwiseAbs() + M_.cwiseAbs() * y_k + g.cwiseAbs() + gamma.value.cwiseAbs();
    e.of_w.block(k * n, k * m, n, m) = N_ + gamma.by_x;
    e.M.block(k * n, k * n, n, n) = M_ + gamma.by_y;
  }
  return e;
}

NewtonOutcome NonlinearSteps::take(Index j, Vector& x, Vector& y) {
  const Index nodes = Index(step_.nodes.size());
  StepData step{step_, time(j - 1), {}, Vector(nodes * x.size()), {}};
  for (Index i = 0; i < nodes; ++i) {
    step.times.push_back(i + 1 == nodes ? time(j) : step.begin + step_.nodes[std::size_t(i)] * h_);
    step.increments.segment(i * x.size(), x.size()) = increments_.row((j - 1) * nodes + i).transpose();
    step.g.push_back(g(step.begin + step_.nodes[std::size_t(i)] * h_));
  }
  Vector Y;
  return take(step, x, y, Y);
}

NewtonOutcome NonlinearSteps::take(const StepData& step, Vector& x, Vector& y, Vector& Y) {
  const Index m = x.size(), n = y.size(), nodes = Index(step.times.size());
  size_x_ = std::max(size_x_, largest(x));
  size_y_ = std::max(size_y_, largest(y));
  NewtonOutcome outcome;
  const Vector left = total_source(step.begin, x, y);
  outcome.nonfinite = !left.allFinite();
  if (outcome.nonfinite) return outcome.why = "phi is not finite where it begins", outcome;
  Vector X = x.replicate(nodes, 1), known = step.increments;
  Y = y.replicate(nodes, 1);
  for (Index i = 0; i < nodes; ++i)
    known.segment(i * m, m) += step.rule.propagators[std::size_t(i)] * x + step.rule.left[std::size_t(i)] * left;
  Descent descent;
  for (double before = INFINITY; outcome.iterations < most_newton_; before = outcome.change) {
    ++outcome.iterations;
    const Equations e = equations(step, X, Y, known);
    if (!e.why.empty()) return outcome.why = e.why, outcome;
    if (descent.turned_back(outcome.iterations, e.w, X, Y)) continue;
    const Eigen::PartialPivLU<Matrix> lu(e.by_x);
    const Vector free = -lu.solve(e.R);         // dX without a change of Y
    const Matrix response = -lu.solve(e.by_y);  // of dX to dY
    const Matrix reduced = e.M + e.of_w * response;
    Vector next = Y;
    if (n > 0 && !solve_lcp(reduced, e.M, e.w + e.of_w * free - reduced * Y, next))
      return outcome.why = no_solution, outcome;
    const Vector dX = free + response * (next - Y);
    if (!dX.allFinite()) return outcome.why = "its iterate is not finite", outcome;
    const double of_x = relative(dX, X + dX, size_x_), of_y = relative(next - Y, next, size_y_);
    outcome.change = lost_in_slack(reduced, next - Y, e.terms)
                         ? of_x
                         : std::max({of_x, of_y, relative_in_slack(reduced, next - Y, next, e.terms, size_w_)});
    X += dX;
    Y = next;
    outcome.solved = outcome.change <= tolerance_ || (outcome.change <= stalled && outcome.change > before / 2);
    if (outcome.solved && turns_growth_round(e.by_x, lu)) {
      outcome.solved = false;
      outcome.why = "phi makes the states grow by more than e^2 in this step";
      return outcome;
    }
    if (outcome.solved) break;
  }
  x = X.tail(m);
  y = Y.tail(n);
  return outcome;
}

}  // namespace bromwich
