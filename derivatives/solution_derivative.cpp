#include "derivatives/solution_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/result/located.hpp"
#include "core/scene/separable.hpp"
#include "core/scene/source_steps.hpp"
#include "derivatives/check_table.hpp"
#include "derivatives/step_direction.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_solution = 1e-7;  ///< of the largest y and w: what the steps may differ from the result by
constexpr double smallest_rcond = 1e-14;
constexpr Index most_states = 1000;  ///< e^{hA} and its derivative with respect to A are dense

[[noreturn]] void refuse(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

// What the derivative needs of a scene and its result.
DenseDynamics checked(const Scene& scene, const Result& r) {
  if (r.status != Status::solved)
    refuse(text("the result is not solved (%s)", to_string(r.status)), "differentiate a result with status solved");
  if (scene.states() > most_states)
    refuse(text("the scene has %ld states, and the derivative writes its dynamics out as dense matrices",
                long(scene.states())),
           text("differentiate scenes with at most %ld states", long(most_states)));
  const Scene dense = written_out(scene);
  const DenseDynamics* d = dense.dynamics->small_state();
  if (!d) refuse("the dynamics have no dense form", "give A, B and N as matrices");
  if (scene.boundary) refuse("the scene has a boundary condition", "differentiate a scene with an initial value");
  if (!scene.cones.empty()) refuse("friction is on circles", "differentiate a scene with facets");
  if (!has_steps_of_march(r))
    refuse(text("the result is of method %s", to_string(r.method)), "solve by march, contour or multigrid");
  if (y_may_jump(r))
    refuse("not differentiable here: y may jump, and the derivative of the discrete solution is not that of y",
           "differentiate scenes with a continuous y (M of class P)");
  return *d;
}

// Sources that jump or bend inside steps: their parts are not in the steps that are differentiated, and constraints
// need not see them.
void check_sources(const Scene& scene, const Result& r) {
  if (!scene.f || r.rough_steps == 0) return;
  const SampledSource f = sample(scene.f, r.t, scene.sources());
  const SourceSteps steps = find_source_steps(scene, r.t, f, sample(scene.g, r.t, scene.constraints()), false);
  const double most = f.values().cwiseAbs().maxCoeff();
  for (const RoughStep& rough : steps.rough)
    for (const SourcePiece& piece : rough.pieces) {
      const double h = r.t[rough.step] - r.t[rough.step - 1], from = (piece.start - r.t[rough.step - 1]) / h;
      const auto beyond = [&](double part, const Vector& value) {
        const double at = from + part * piece.length / h;
        const Vector line =
            (1 - at) * f.values().row(rough.step - 1).transpose() + at * f.values().row(rough.step).transpose();
        return (value - line).cwiseAbs().maxCoeff();
      };
      const Matrix& c = piece.phi;
      const double off = std::max({beyond(0, c.col(0)), beyond(0.5, c * Eigen::Vector3d(1, 0.5, 0.25)),
                                   beyond(1, c * Eigen::Vector3d::Ones())});
      if (off > same_solution * most)
        refuse(text("f jumps or bends inside a step or at its end (t = %.6g)", r.t[rough.step]),
               "take the derivative with located switches");
    }
}

std::vector<Index> active_set(const Scene& scene, const RowMatrix& y, Index j) {
  std::vector<Index> S;
  for (Index i = 0; i < y.cols(); ++i)
    if (y(j, i) > 0 || std::binary_search(scene.free_rows.begin(), scene.free_rows.end(), i)) S.push_back(i);
  return S;
}

RowMatrix rows_of(const TimeFunction& function, const Vector& t, Index width) {
  return function && width > 0 ? RowMatrix(sample(function, t, width).table()) : RowMatrix(0, 0);
}

// sum <- sum + table C^T; an empty C adds nothing, an empty sum is zero.
void add_product(RowMatrix& sum, const RowMatrix& table, const Matrix& C) {
  if (C.size() == 0) return;
  if (sum.size() == 0) sum = RowMatrix::Zero(table.rows(), C.rows());
  sum.noalias() += table * C.transpose();
}

Vector row(const RowMatrix& table, Index j) { return table.row(j).transpose(); }

}  // namespace

bool y_may_jump(const Result& r) {
  return !r.continuous || by_euler(r) || r.starts_with_impulse || r.euler_steps > 0 || r.y_left.size() > 0;
}

SolutionDerivative::SolutionDerivative(const Scene& scene, const Result& result)
    : d_(checked(scene, result)), M_(to_dense(scene.M)), J_(result.steps), t_(result.t), y_(result.y) {
  m_ = scene.states();
  n_ = scene.constraints();
  Matrix F = source_matrix(scene, d_);
  if (d_.E.size() > 0) {
    const Eigen::PartialPivLU<Matrix> lu(d_.E);
    if (!(lu.rcond() > smallest_rcond)) refuse("E is singular", "eliminate the algebraic states");
    inverse_E_ = lu.inverse();
    d_.A = lu.solve(d_.A);
    d_.B = lu.solve(d_.B);
    F = lu.solve(F);
    d_.E.resize(0, 0);
  }
  h_ = scene.T / double(J_);
  if (t_.size() == J_ + 1) check_sources(scene, result);
  if (y_.rows() != J_ + 1 || y_.cols() != n_ || t_.size() != J_ + 1)
    refuse("the result has other rows than its grid", "differentiate a result as solve returned it");
  const StepOperators step = step_operators(d_.A, Rule::exponential, h_, J_);
  E_ = step.decay;
  L_ = step.left;
  R_ = step.right;
  const RowMatrix f = rows_of(scene.f, t_, scene.sources()), g = rows_of(scene.g, t_, n_);
  f_ = f.size() > 0 ? RowMatrix(f * F.transpose()) : RowMatrix::Zero(J_ + 1, m_);
  u_ = y_ * d_.B.transpose() + f_;
  x_.resize(J_ + 1, m_);
  x_.row(0) = scene.x0.transpose();
  x_.bottomRows(J_).noalias() = u_.topRows(J_) * L_.transpose();
  x_.bottomRows(J_).noalias() += u_.bottomRows(J_) * R_.transpose();
  w_ = g.size() > 0 ? g : RowMatrix::Zero(J_ + 1, n_);
  w_ += y_ * M_.transpose();
  const Matrix W = M_ + d_.N * R_ * d_.B;
  sets_.resize(std::size_t(J_) + 1);
  const auto responses = std::make_shared<SetResponses>();
  for (Index j = 0; j <= J_; ++j)
    sets_[std::size_t(j)] =
        j > 0 ? responses->take(active_set(scene, y_, j), W) : responses->take(active_set(scene, y_, j), M_, 1);
  responses_ = responses;
  follow(result);
  const Vector most_x = x_.cwiseAbs().colwise().maxCoeff();
  const SetRounding zero = rounding_of_sets(d_.N.cwiseAbs() * most_x, M_, y_, g);
  undecided_ = undecided_at_start(w_, zero, responses_->active(sets_[0]));
  margin_ = margin_of_sets(y_, w_, zero, t_, [this](Index j) -> const std::vector<Index>& {
    return responses_->active(sets_[std::size_t(j)]);
  });
}

// The states by the steps; x_ holds L u_{j-1} + R u_j before. y is that of the result as long as w vanishes where y
// acts.
void SolutionDerivative::follow(const Result& result) {
  const Matrix driven = R_ * d_.B;
  const double allowed = same_solution * (1e-290 + (n_ > 0 ? result.y.cwiseAbs().maxCoeff() : 0));
  Vector x = x_.row(0).transpose(), given(m_), missed(n_), off(n_);
  for (Index j = 0; j <= J_; ++j) {
    const Index set = sets_[std::size_t(j)];
    if (!(responses_->condition(set) > smallest_rcond))
      refuse(text("not differentiable here: the active constraints at t = %.6g do not determine y", t_[j]),
             "remove constraints that repeat each other");
    if (j == 0) continue;
    given = x_.row(j).transpose();
    given.noalias() += E_ * x;
    missed = w_.row(j).transpose();
    missed.noalias() += d_.N * given;
    // The correction of y keeps the loop closed: x of a growing A would drift away otherwise.
    responses_->solve(set, missed, off);
    x = given;
    x.noalias() += driven * off;
    x_.row(j) = x.transpose();
    if (!(off.norm() <= allowed))
      refuse(text("not differentiable here: the steps of the grid do not give y of the result at t = %.6g", t_[j]),
             "solve on more steps, with sources that do not jump inside steps");
  }
  w_.noalias() += x_ * d_.N.transpose();
}

// The change of x' = E^{-1} (A x + B y + f): dE x' is that of E^{-1} dE A, E^{-1} dE B and E^{-1} dE f.
DataChange SolutionDerivative::without_mass(DataChange c) const {
  if (inverse_E_.size() == 0) return c;
  for (Matrix* change : {&c.A, &c.B, &c.E})
    if (change->size() > 0) *change = inverse_E_ * *change;
  if (c.f.size() > 0) c.f = c.f * inverse_E_.transpose();
  if (c.E.size() == 0) return c;
  const auto add = [](auto& to, const auto& more) {
    if (to.size() == 0)
      to = -more;
    else
      to -= more;
  };
  add(c.A, Matrix(c.E * d_.A));
  add(c.B, Matrix(c.E * d_.B));
  add(c.f, RowMatrix(f_ * c.E.transpose()));
  c.E.resize(0, 0);
  return c;
}

// The transpose of without_mass.
void SolutionDerivative::add_mass(DataChange& bar) const {
  if (inverse_E_.size() == 0) return;
  const Matrix back = inverse_E_.transpose();
  bar.E = -back * (bar.A * d_.A.transpose() + bar.B * d_.B.transpose() + bar.f.transpose() * f_);
  bar.A = back * bar.A;
  bar.B = back * bar.B;
  bar.f = bar.f * inverse_E_;
}

SolutionChange SolutionDerivative::jvp(const DataChange& given) const {
  check_no_b(given.b);
  check_no_restitution(given.restitution);
  check_data(given, J_ + 1, m_, n_);
  if (given.E.size() > 0 && inverse_E_.size() == 0) refuse("the scene has no E", "change A and B instead");
  const DataChange c = without_mass(given);
  StepDirection d;
  if (c.A.size() > 0) d = step_direction(d_.A, c.A, h_);
  SolutionChange out{RowMatrix::Zero(J_ + 1, n_), RowMatrix::Zero(J_ + 1, m_), RowMatrix::Zero(J_ + 1, n_),
                     RowMatrix::Zero(J_ + 1, n_)};
  RowMatrix direct = c.f, fixed = c.g;  // of u_j and w_j without dx_j and dy_j; empty: none
  add_product(direct, y_, c.B);
  add_product(fixed, x_, c.N);
  add_product(fixed, y_, c.M);
  if (c.x0.size() > 0) out.x.row(0) = c.x0.transpose();
  if (direct.size() > 0) {
    out.x.bottomRows(J_).noalias() = direct.topRows(J_) * L_.transpose();
    out.x.bottomRows(J_).noalias() += direct.bottomRows(J_) * R_.transpose();
  }
  if (d.decay.size() > 0) {
    out.x.bottomRows(J_).noalias() += x_.topRows(J_) * d.decay.transpose();
    out.x.bottomRows(J_).noalias() += u_.topRows(J_) * d.left.transpose();
    out.x.bottomRows(J_).noalias() += u_.bottomRows(J_) * d.right.transpose();
  }
  const Matrix left = L_ * d_.B, driven = R_ * d_.B;
  Vector dx = Vector::Zero(m_), dy = Vector::Zero(n_), next(m_), moved(n_);
  for (Index j = 0; j <= J_; ++j) {
    next = out.x.row(j).transpose();
    if (j > 0) next.noalias() += E_ * dx;
    if (j > 0) next.noalias() += left * dy;
    moved.noalias() = d_.N * next;
    if (fixed.size() > 0) moved += fixed.row(j).transpose();
    responses_->solve(sets_[std::size_t(j)], moved, dy);
    if (j > 0) next.noalias() += driven * dy;
    dx.swap(next);
    out.x.row(j) = dx.transpose();
    out.y.row(j) = dy.transpose();
  }
  if (fixed.size() > 0) out.w = fixed;
  out.w.noalias() += out.x * d_.N.transpose();
  out.w.noalias() += out.y * M_.transpose();
  check_start(out, fixed);
  for (Index j = 1; j <= J_; ++j)
    out.integral.row(j) = out.integral.row(j - 1) + (h_ / 2) * (out.y.row(j - 1) + out.y.row(j));
  return out;
}

// Changes that move a w_i with y_i = w_i = 0 at t = 0 have no derivative there.
void SolutionDerivative::check_start(const SolutionChange& out, const RowMatrix& fixed) const {
  Vector terms =
      d_.N.cwiseAbs() * out.x.row(0).cwiseAbs().transpose() + M_.cwiseAbs() * out.y.row(0).cwiseAbs().transpose();
  if (fixed.size() > 0) terms += fixed.row(0).cwiseAbs().transpose();
  check_change_at_start(undecided_, out.w.row(0).transpose(), terms);
}

DataChange SolutionDerivative::vjp(const SolutionChange& of) const {
  check_table("y", of.y, J_ + 1, n_);
  check_table("x", of.x, J_ + 1, m_);
  check_table("w", of.w, J_ + 1, n_);
  check_table("integral", of.integral, J_ + 1, n_);
  DataChange bar;
  bar.f = RowMatrix::Zero(J_ + 1, m_);
  bar.g = RowMatrix::Zero(J_ + 1, n_);
  RowMatrix all(J_ + 1, m_);        // q_j
  Vector next = Vector::Zero(m_);   // q_{j+1}
  Vector later = Vector::Zero(n_);  // weights of the integrals over [0, t_k], k > j
  Vector p(m_), eta(n_), mu(n_), of_u(m_), back(m_), of_w = Vector::Zero(n_);
  bool from_one_side = false;
  const Matrix N = d_.N, Lt = L_.transpose(), Rt = R_.transpose(), Bt = d_.B.transpose();
  for (Index j = J_; j >= 0; --j) {
    if (of.w.size() > 0) of_w = row(of.w, j);
    p.noalias() = E_.transpose() * next;
    of_u.noalias() = Lt * next;
    back = of_u;
    if (of.w.size() > 0) p.noalias() += N.transpose() * of_w;
    if (of.x.size() > 0) p += row(of.x, j);
    if (j > 0) back.noalias() += Rt * p;
    eta.noalias() = Bt * back;
    if (of.w.size() > 0) eta.noalias() += M_.transpose() * of_w;
    if (of.y.size() > 0) eta += row(of.y, j);
    if (of.integral.size() > 0) {
      eta += h_ / 2 * later;
      later += row(of.integral, j);
      if (j > 0) eta += h_ / 2 * later;
    }
    if (j == 0) from_one_side = weighs_start(undecided_, eta, (Bt.cwiseAbs() * back.cwiseAbs()).norm() + eta.norm());
    responses_->solve_transposed(sets_[std::size_t(j)], eta, mu);
    next = p;
    next.noalias() -= N.transpose() * mu;  // q_j
    if (j > 0) of_u.noalias() += Rt * next;
    bar.g.row(j) = (of_w - mu).transpose();
    bar.f.row(j) = of_u.transpose();
    all.row(j) = next.transpose();
  }
  bar.x0 = next;
  bar.N = bar.g.transpose() * x_;
  bar.M = bar.g.transpose() * y_;
  const auto later_rows = all.bottomRows(J_);
  const Matrix of_E = later_rows.transpose() * x_.topRows(J_), of_L = later_rows.transpose() * u_.topRows(J_),
               of_R = later_rows.transpose() * u_.bottomRows(J_);
  bar.B = bar.f.transpose() * y_;
  const Matrix At = d_.A.transpose();
  bar.A = step_direction(At, of_E, h_).decay + step_direction(At, of_L, h_).left + step_direction(At, of_R, h_).right;
  add_mass(bar);
  if (from_one_side) leave_out_start(bar, x_.row(0).transpose(), y_);
  return bar;
}

void leave_out_start(DataChange& gradient, const Vector& x0, const RowMatrix& y) {
  gradient.x0.resize(0);
  gradient.g.resize(0, 0);
  if (!x0.isZero(0)) gradient.N.resize(0, 0);
  if (!y.row(0).isZero(0)) gradient.M.resize(0, 0);
}

}  // namespace bromwich
