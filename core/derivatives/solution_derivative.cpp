#include "core/derivatives/solution_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/scene/separable.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double same_solution = 1e-7;  ///< of the largest y and w: what the steps may differ from the result by
constexpr double degenerate = 1e-10;    ///< of the largest y_i and w_i: margins below count as y_i = w_i = 0
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
  if (r.method != Method::march && r.method != Method::contour && r.method != Method::multigrid)
    refuse(text("the result is of method %s", to_string(r.method)), "solve by march, contour or multigrid");
  if (y_may_jump(r))
    refuse("not differentiable here: y may jump, and the derivative of the discrete solution is not that of y",
           "differentiate scenes with a continuous y (M of class P)");
  return *d;
}

// The derivative of a function of A in the direction D: the upper right block of the function of [[A, D], [0, A]]. D is
// scaled to the size of A.
struct StepDirection {
  Matrix decay, left, right;
};

StepDirection direction(const Matrix& A, const Matrix& D, double h) {
  const Index m = A.rows();
  const double size = D.cwiseAbs().maxCoeff();
  if (!(size > 0)) return {Matrix::Zero(m, m), Matrix::Zero(m, m), Matrix::Zero(m, m)};
  const double unit = std::max(A.cwiseAbs().maxCoeff(), 1e-3 / h) / size;
  Matrix both = Matrix::Zero(2 * m, 2 * m);
  both.topLeftCorner(m, m) = both.bottomRightCorner(m, m) = A;
  both.topRightCorner(m, m) = unit * D;
  const StepOperators step = step_operators(both, Rule::exponential, h);
  const auto block = [&](const Matrix& whole) { return Matrix(whole.topRightCorner(m, m) / unit); };
  return {block(step.decay), block(step.left), block(step.right)};
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

Vector row(const RowMatrix& table, Index j) { return table.row(j).transpose(); }

// Constraints with y_i = w_i = 0 at t = 0, as where everything starts from rest. Changes that leave w_i there have a
// derivative all the same.
std::vector<Index> undecided_at_start(const RowMatrix& y, const RowMatrix& w, const std::vector<Index>& active) {
  std::vector<Index> found;
  for (Index i = 0; i < y.cols(); ++i)
    if (!std::binary_search(active.begin(), active.end(), i) && w(0, i) <= degenerate * w.col(i).cwiseAbs().maxCoeff())
      found.push_back(i);
  return found;
}

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
  w_ = g.size() > 0 ? g : RowMatrix::Zero(J_ + 1, n_);
  w_ += y_ * M_.transpose();
  for (Index j = 0; j <= J_; ++j) sets_.push_back(active_set(scene, y_, j));
  follow(result);
  measure();
}

// The states by the steps, and the factors of W_SS. y is that of the result as long as w vanishes where y acts.
void SolutionDerivative::follow(const Result& result) {
  const Matrix W = M_ + d_.N * R_ * d_.B;
  for (Index j = 0; j <= J_; ++j) {
    const std::vector<Index>& S = sets_[std::size_t(j)];
    if (j > 0) {
      if (!factors_.count(S)) factors_.emplace(S, Factor(W(S, S)));
      const Vector xi = E_ * row(x_, j - 1) + L_ * row(u_, j - 1), given = xi + R_ * row(u_, j);
      // The correction of y keeps the loop closed: x of a growing A would drift away otherwise.
      const Vector off = on_set(j, row(w_, j) + d_.N * given);
      x_.row(j) = (given + R_ * (d_.B * off)).transpose();
      if (!(off.norm() <= same_solution * (1e-290 + result.y.cwiseAbs().maxCoeff())))
        refuse(text("not differentiable here: the steps of the grid do not give y of the result at t = %.6g", t_[j]),
               "solve on more steps, with sources that do not jump inside steps");
    } else {
      first_.emplace_back(M_(S, S));
    }
    const Factor& solver = j > 0 ? factor(j) : first_.front();
    if (!S.empty() && !(solver.rcond() > smallest_rcond))
      refuse(text("not differentiable here: the active constraints at t = %.6g do not determine y", t_[j]),
             "remove constraints that repeat each other");
    w_.row(j) += (d_.N * row(x_, j)).transpose();
  }
}

void SolutionDerivative::measure() {
  for (Index i = 0; i < n_; ++i) {
    const double most_y = y_.col(i).cwiseAbs().maxCoeff(), most_w = w_.col(i).cwiseAbs().maxCoeff();
    for (Index j = 0; j <= J_; ++j) {
      const std::vector<Index>& S = sets_[std::size_t(j)];
      const bool active = std::binary_search(S.begin(), S.end(), i);
      if (active && y_(j, i) <= 0) continue;  // a free row
      const double most = active ? most_y : most_w, value = active ? y_(j, i) : w_(j, i);
      const double margin = most > 0 ? std::max(0.0, value) / most : 0;
      if (j == 0 && !active && margin <= degenerate) continue;  // see undecided_at_start
      if (margin < margin_.margin) margin_ = {margin, t_[j], i};
    }
  }
  if (margin_.margin <= degenerate)
    refuse(text("not differentiable here: y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided",
                long(margin_.constraint), long(margin_.constraint), margin_.time),
           "change the data or the number of steps slightly");
}

// -W_SS^{-1} right_S, zero elsewhere.
Vector SolutionDerivative::on_set(Index j, const Vector& right) const {
  const std::vector<Index>& S = sets_[std::size_t(j)];
  Vector y = Vector::Zero(n_);
  if (S.empty()) return y;
  const Vector of_set = (j > 0 ? factor(j) : first_.front()).solve(Vector(right(S)));
  y(S) = -of_set;
  return y;
}

Vector SolutionDerivative::on_set_transposed(Index j, const Vector& right) const {
  const std::vector<Index>& S = sets_[std::size_t(j)];
  Vector mu = Vector::Zero(n_);
  if (S.empty()) return mu;
  const Vector of_set = (j > 0 ? factor(j) : first_.front()).transpose().solve(Vector(right(S)));
  mu(S) = of_set;
  return mu;
}

void SolutionDerivative::check(const char* name, Index rows, Index columns, Index expected_rows,
                               Index expected_columns) const {
  if (rows * columns == 0 || (rows == expected_rows && columns == expected_columns)) return;
  throw Error(name, text("found %ld x %ld", long(rows), long(columns)),
              text("give %ld x %ld", long(expected_rows), long(expected_columns)));
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
  check("x0", given.x0.size(), 1, m_, 1);
  check("f", given.f.rows(), given.f.cols(), J_ + 1, m_);
  check("g", given.g.rows(), given.g.cols(), J_ + 1, n_);
  check("A", given.A.rows(), given.A.cols(), m_, m_);
  check("B", given.B.rows(), given.B.cols(), m_, n_);
  check("N", given.N.rows(), given.N.cols(), n_, m_);
  check("M", given.M.rows(), given.M.cols(), n_, n_);
  check("E", given.E.rows(), given.E.cols(), m_, m_);
  if (given.E.size() > 0 && inverse_E_.size() == 0) refuse("the scene has no E", "change A and B instead");
  const DataChange c = without_mass(given);
  StepDirection d;
  if (c.A.size() > 0) d = direction(d_.A, c.A, h_);
  SolutionChange out{RowMatrix::Zero(J_ + 1, n_), RowMatrix::Zero(J_ + 1, m_), RowMatrix::Zero(J_ + 1, n_),
                     RowMatrix::Zero(J_ + 1, n_)};
  Vector before = Vector::Zero(m_);  // du_{j-1}
  for (Index j = 0; j <= J_; ++j) {
    Vector direct = Vector::Zero(m_);  // of u_j without dy_j
    if (c.f.size() > 0) direct += row(c.f, j);
    if (c.B.size() > 0) direct += c.B * row(y_, j);
    Vector dx = Vector::Zero(m_);
    if (j == 0) {
      if (c.x0.size() > 0) dx = c.x0;
    } else {
      dx = E_ * row(out.x, j - 1) + L_ * before + R_ * direct;
      if (c.A.size() > 0) dx += d.decay * row(x_, j - 1) + d.left * row(u_, j - 1) + d.right * row(u_, j);
    }
    Vector fixed = Vector::Zero(n_);
    if (c.g.size() > 0) fixed += row(c.g, j);
    if (c.N.size() > 0) fixed += c.N * row(x_, j);
    if (c.M.size() > 0) fixed += c.M * row(y_, j);
    const Vector dy = on_set(j, d_.N * dx + fixed);
    if (j > 0) dx += R_ * (d_.B * dy);
    before = direct + d_.B * dy;
    if (j == 0)
      for (const Index i : undecided_at_start(y_, w_, sets_[0])) {
        const double moved = d_.N.row(i).dot(dx) + M_.row(i).dot(dy) + fixed[i];
        const double terms =
            d_.N.row(i).cwiseAbs().dot(dx.cwiseAbs()) + M_.row(i).cwiseAbs().dot(dy.cwiseAbs()) + std::abs(fixed[i]);
        if (std::abs(moved) > 1e-12 * terms)
          refuse(text("not differentiable here: the change moves w_%ld at t = 0, where y_%ld = w_%ld = 0", long(i),
                      long(i), long(i)),
                 "change x0 and g(0) slightly, or leave this w_i as it is");
      }
    out.y.row(j) = dy.transpose();
    out.x.row(j) = dx.transpose();
    out.w.row(j) = (d_.N * dx + M_ * dy + fixed).transpose();
    if (j > 0) out.integral.row(j) = out.integral.row(j - 1) + (h_ / 2) * (out.y.row(j - 1) + out.y.row(j));
  }
  return out;
}

DataChange SolutionDerivative::vjp(const SolutionChange& of) const {
  check("y", of.y.rows(), of.y.cols(), J_ + 1, n_);
  check("x", of.x.rows(), of.x.cols(), J_ + 1, m_);
  check("w", of.w.rows(), of.w.cols(), J_ + 1, n_);
  check("integral", of.integral.rows(), of.integral.cols(), J_ + 1, n_);
  DataChange bar;
  bar.f = RowMatrix::Zero(J_ + 1, m_);
  bar.g = RowMatrix::Zero(J_ + 1, n_);
  RowMatrix all(J_ + 1, m_);        // q_j
  Vector next = Vector::Zero(m_);   // q_{j+1}
  Vector later = Vector::Zero(n_);  // weights of the integrals over [0, t_k], k > j
  Vector p(m_), eta(n_), of_u(m_), back(m_), of_w = Vector::Zero(n_);
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
    if (j == 0)
      for (const Index i : undecided_at_start(y_, w_, sets_[0]))
        if (eta[i] != 0)
          refuse(
              text("not differentiable here: y_%ld = w_%ld = 0 at t = 0, and the gradient with respect to x0 and g(0) "
                   "is one-sided",
                   long(i), long(i)),
              "change x0 or g(0) slightly, or use jvp for changes that leave w_i");
    const Vector mu = on_set_transposed(j, eta);
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
  bar.A = direction(At, of_E, h_).decay + direction(At, of_L, h_).left + direction(At, of_R, h_).right;
  add_mass(bar);
  return bar;
}

}  // namespace bromwich
