#include "core/derivatives/galerkin_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/derivatives/check_table.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/numerics/two_point.hpp"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double left_of_conditions = 1e-7;  ///< residual of the result in its discrete problem
constexpr double least_condition = 1e-14;

[[noreturn]] void refuse_galerkin(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

const Scene& checked_for_galerkin(const Scene& scene, const Result& r) {
  if (r.status != Status::solved)
    refuse_galerkin(text("the result is not solved (%s)", to_string(r.status)), "differentiate solved results");
  if (r.method != Method::galerkin)
    refuse_galerkin(text("the result is of method %s", to_string(r.method)), "solve by galerkin");
  if (scene.dynamics->has_mass()) refuse_galerkin("the dynamics have a mass matrix", "give E^-1 A and E^-1 B");
  if (scene.constraints() == 0)
    refuse_galerkin("the scene has no constraints", "add one that is never active: M = 1 and g = 1");
  if (!r.interval_rules.empty() || !has_one_solution(selection_class(scene.M, scene.lcp_class)))
    refuse_galerkin("not differentiable here: y may jump, and the derivative of the discrete solution is not that of y",
                    "differentiate scenes with a continuous y (M of class P)");
  const Index N = r.t.size() - 1, n = scene.constraints();
  if (r.y.rows() != N + 1 || r.y_left.rows() != N || r.y.cols() != n || r.y_left.cols() != n)
    refuse_galerkin("the result has other rows than its grid", "differentiate a result as solve returned it");
  return scene;
}

// z of one interval at both of its ends, one row each.
RowMatrix by_ends(const RowMatrix& z) {
  const Index n = z.cols() / 2;
  RowMatrix rows(2 * z.rows() + 1, n);
  rows.row(0) = z.row(0).head(n);
  for (Index k = 0; k < z.rows(); ++k) {
    rows.row(2 * k + 1) = z.row(k).head(n);
    rows.row(2 * k + 2) = z.row(k).tail(n);
  }
  return rows;
}

// y at the time points: the left end of the first interval, then all right ends.
RowMatrix right_ends_of(const RowMatrix& z) {
  const Index n = z.cols() / 2;
  RowMatrix y(z.rows() + 1, n);
  y << z.row(0).head(n), z.rightCols(n);
  return y;
}

// (2 a + b, a + 2 b)/3, the moments of a line from a to b.
Vector moments(const Vector& a, const Vector& b) {
  Vector both(a.size() + b.size());
  both << (2 * a + b) / 3, (a + 2 * b) / 3;
  return both;
}

}  // namespace

GalerkinDerivative::GalerkinDerivative(const Scene& scene, const Result& result)
    : d_(to_dense(checked_for_galerkin(scene, result).dynamics)),
      M_(to_dense(scene.M)),
      z_(galerkin_coefficients(result)),
      m_(scene.states()),
      n_(scene.constraints()) {
  SharedDynamics shared(scene.dynamics);
  p_ = galerkin_problem(scene, grid_parts(result.t), shared);
  x_ = galerkin_states(p_, z_);
  if (!(natural_residual(p_, z_, x_, scene.free_rows) <= left_of_conditions))
    refuse_galerkin("the intervals of the result do not give its y", "solve without breakpoints inside intervals");
  for (const GalerkinRun& run : p_.runs) {
    const double h = length(run.first);
    const std::vector<Matrix>& G = *shared.phis(h);
    const Matrix &N = d_.N, diagonal = 2 * h * N * (G[3] - G[4]);
    Entry entry{{h * (G[1] - G[2]), h * G[2]}, {Matrix(2 * n_, m_), Matrix(2 * n_, m_)}};
    entry.q_of_f[0] << diagonal, 2 * h * N * (G[2] - 2 * G[3] + G[4]);
    entry.q_of_f[1] << 2 * h * N * G[4], diagonal;
    entries_.push_back(std::move(entry));
  }
  take_sets(scene);
  judge(scene);
}

Index GalerkinDerivative::run_of(Index k) const {
  Index run = 0;
  while (run + 1 < Index(p_.runs.size()) && p_.runs[std::size_t(run + 1)].first <= k) ++run;
  return run;
}

// The active sets, and P of each.
void GalerkinDerivative::take_sets(const Scene& scene) {
  const auto is_free = [&](Index i) {
    return std::binary_search(scene.free_rows.begin(), scene.free_rows.end(), i % n_);
  };
  Vector of_column(2 * n_);
  for (Index k = 0; k < p_.N; ++k) {
    std::vector<Index> S;
    for (Index i = 0; i < 2 * n_; ++i)
      if (z_(k, i) > 0 || is_free(i)) S.push_back(i);
    const GalerkinStep& s = step(k);
    const Index set = responses_.take(S, s.D, int(run_of(k)));
    sets_.push_back(set);
    if (P_.count(set) > 0) continue;
    if (!(responses_.condition(set) > least_condition))
      refuse_galerkin(text("not differentiable here: the active constraints at t = %.6g do not determine y", p_.t[k]),
                      "remove constraints that repeat each other");
    Matrix& P = P_[set] = s.E;
    for (Index c = 0; c < m_; ++c) {
      responses_.solve(set, s.C.col(c), of_column);
      P.col(c) += s.H * of_column;
    }
  }
}

// How far the moments of y and w are from y_i = w_i = 0.
void GalerkinDerivative::judge(const Scene& scene) {
  const RowMatrix y = by_ends(z_), w = by_ends(galerkin_slack(p_, z_, x_));
  std::vector<std::vector<Index>> active(std::size_t(y.rows()));
  for (Index j = 0; j < y.rows(); ++j)
    for (Index i = 0; i < n_; ++i)
      if (y(j, i) > 0 || std::binary_search(scene.free_rows.begin(), scene.free_rows.end(), i))
        active[std::size_t(j)].push_back(i);
  Vector t(y.rows());
  for (Index j = 0; j < y.rows(); ++j) t[j] = p_.t[(j + 1) / 2];
  const Vector most_x = x_.cwiseAbs().colwise().maxCoeff();
  const SetRounding zero = rounding_of_sets(d_.N.cwiseAbs() * most_x, scene.M, y, by_ends(p_.q));
  margin_ = margin_of_sets(y, w, zero, t, [&](Index j) -> const std::vector<Index>& { return active[std::size_t(j)]; });
}

// By f, g and M, N x 2n.
RowMatrix GalerkinDerivative::changed_q(const DataChange& c) const {
  RowMatrix q = RowMatrix::Zero(p_.N, 2 * n_);
  for (Index k = 0; k < p_.N; ++k) {
    const Entry& entry = entries_[std::size_t(run_of(k))];
    auto row = q.row(k);
    for (Index end = 0; end < 2 && c.f.size() > 0; ++end)
      row += (entry.q_of_f[end] * c.f.row(k + end).transpose()).transpose();
    if (c.g.size() > 0) row += moments(c.g.row(k).transpose(), c.g.row(k + 1).transpose()).transpose();
    if (c.M.size() > 0)
      row += moments(c.M * z_.row(k).head(n_).transpose(), c.M * z_.row(k).tail(n_).transpose()).transpose();
  }
  return q;
}

SolutionChange GalerkinDerivative::jvp(const DataChange& c) const {
  for (const auto& [name, matrix] : {std::pair("A", &c.A), {"B", &c.B}, {"N", &c.N}, {"E", &c.E}})
    if (matrix->size() > 0) throw Error(name, "is no datum of this derivative", "ask for b, f, g and M");
  p_.initial_value ? check_no_b(c.b) : check_no_x0(c.x0);
  check_table("x0", c.x0, m_, 1);
  check_table("b", c.b, m_, 1);
  check_table("f", c.f, p_.N + 1, m_);
  check_table("g", c.g, p_.N + 1, n_);
  check_table("M", c.M, n_, n_);
  const RowMatrix q = changed_q(c);
  RowMatrix input(p_.N, m_);
  std::vector<const Matrix*> P;
  Vector z(2 * n_);
  for (Index k = 0; k < p_.N; ++k) {
    const std::size_t at = std::size_t(k);
    P.push_back(&P_.at(sets_[at]));
    responses_.solve(sets_[at], q.row(k).transpose(), z);
    input.row(k) = (step(k).H * z).transpose();
    for (Index end = 0; end < 2 && c.f.size() > 0; ++end)
      input.row(k) += (entries_[std::size_t(run_of(k))].F[end] * c.f.row(k + end).transpose()).transpose();
  }
  BoundaryCondition ends = p_.boundary;
  const Vector& given = p_.initial_value ? c.x0 : c.b;
  ends.b = given.size() > 0 ? given : Vector::Zero(m_);
  SolutionChange out{RowMatrix(p_.N + 1, n_), solve_two_point(P, input, ends, epsilon), RowMatrix(),
                     RowMatrix::Zero(p_.N + 1, n_)};
  if (out.x.rows() == 0)
    refuse_galerkin("not differentiable here: the boundary condition does not determine the change of the states",
                    "change the data slightly");
  for (Index k = 0; k < p_.N; ++k) {
    responses_.solve(sets_[std::size_t(k)], step(k).C * out.x.row(k).transpose() + q.row(k).transpose(), z);
    if (k == 0) out.y.row(0) = z.head(n_).transpose();
    out.y.row(k + 1) = z.tail(n_).transpose();
    out.integral.row(k + 1) = out.integral.row(k) + (length(k) / 2) * (z.head(n_) + z.tail(n_)).transpose();
  }
  out.w = out.x * d_.N.transpose() + out.y * M_.transpose();
  if (c.g.size() > 0) out.w += c.g;
  if (c.M.size() > 0) out.w += right_ends_of(z_) * c.M.transpose();
  return out;
}

// λ_1 to λ_N in the rows, and ν.
RowMatrix GalerkinDerivative::multipliers(const RowMatrix& of_x, Vector& of_b) const {
  Matrix ends(2 * m_, m_);
  ends << -p_.boundary.ET.transpose(), p_.boundary.E0.transpose();
  const Eigen::HouseholderQR<Matrix> qr(ends);
  const Matrix Q = qr.householderQ();
  const Matrix across = Q.rightCols(m_).transpose();
  const Vector last = of_x.row(p_.N).transpose();
  const BoundaryCondition condition{across.leftCols(m_), across.rightCols(m_), across.leftCols(m_) * last};
  std::vector<Matrix> back;  // one for each set
  std::map<Index, const Matrix*> transposed;
  back.reserve(P_.size());
  for (const auto& [set, P] : P_) transposed[set] = &back.emplace_back(P.transpose());
  std::vector<const Matrix*> steps;
  for (Index k = p_.N; k-- > 0;) steps.push_back(transposed.at(sets_[std::size_t(k)]));
  const RowMatrix reversed = solve_two_point(steps, of_x.topRows(p_.N).colwise().reverse(), condition, epsilon);
  if (reversed.rows() == 0)
    refuse_galerkin("not differentiable here: the boundary condition does not determine the change of the states",
                    "change the data slightly");
  Vector apart(2 * m_);
  apart << reversed.row(0).transpose() - last, reversed.row(p_.N).transpose();
  of_b = qr.solve(apart);
  return reversed.topRows(p_.N).colwise().reverse();
}

DataChange GalerkinDerivative::vjp(const SolutionChange& of) const {
  check_table("y", of.y, p_.N + 1, n_);
  check_table("x", of.x, p_.N + 1, m_);
  check_table("w", of.w, p_.N + 1, n_);
  check_table("integral", of.integral, p_.N + 1, n_);
  DataChange bar;
  bar.f = RowMatrix::Zero(p_.N + 1, m_);
  bar.g = of.w.size() > 0 ? of.w : RowMatrix::Zero(p_.N + 1, n_);
  bar.M = bar.g.transpose() * right_ends_of(z_);
  RowMatrix of_y = of.y.size() > 0 ? of.y : RowMatrix::Zero(p_.N + 1, n_);
  RowMatrix of_x = of.x.size() > 0 ? of.x : RowMatrix::Zero(p_.N + 1, m_);
  of_y += bar.g * M_;
  of_x += bar.g * d_.N;
  RowMatrix of_z = RowMatrix::Zero(p_.N, 2 * n_);
  of_z.row(0).head(n_) = of_y.row(0);
  of_z.rightCols(n_) += of_y.bottomRows(p_.N);
  Vector later = Vector::Zero(n_), mu(2 * n_);  // weights of the integrals over [0, t_j], j > k
  for (Index k = p_.N; k-- > 0 && of.integral.size() > 0;) {
    later += of.integral.row(k + 1).transpose();
    of_z.row(k).head(n_) += length(k) / 2 * later.transpose();
    of_z.row(k).tail(n_) += length(k) / 2 * later.transpose();
  }
  for (Index k = 0; k < p_.N; ++k) {
    responses_.solve_transposed(sets_[std::size_t(k)], of_z.row(k).transpose(), mu);
    of_x.row(k) -= (step(k).C.transpose() * mu).transpose();
  }
  Vector of_b;
  const RowMatrix lambda = multipliers(of_x, of_b);
  RowMatrix of_q(p_.N, 2 * n_);
  for (Index k = 0; k < p_.N; ++k) {
    const Vector eta = of_z.row(k).transpose() + step(k).H.transpose() * lambda.row(k).transpose();
    responses_.solve_transposed(sets_[std::size_t(k)], eta, mu);
    of_q.row(k) = -mu.transpose();
  }
  add_sources(lambda, of_q, bar);
  (p_.initial_value ? bar.x0 : bar.b) = of_b;
  return bar;
}

// The gradient with respect to f, g and M from those with respect to F and q.
void GalerkinDerivative::add_sources(const RowMatrix& of_F, const RowMatrix& of_q, DataChange& bar) const {
  for (Index k = 0; k < p_.N; ++k) {
    const Entry& entry = entries_[std::size_t(run_of(k))];
    const Vector lambda = of_F.row(k).transpose(), q = of_q.row(k).transpose();
    for (Index end = 0; end < 2; ++end)
      bar.f.row(k + end) += (entry.F[end].transpose() * lambda + entry.q_of_f[end].transpose() * q).transpose();
    const Vector of_ends = moments(q.head(n_), q.tail(n_));
    bar.g.row(k) += of_ends.head(n_).transpose();
    bar.g.row(k + 1) += of_ends.tail(n_).transpose();
    bar.M += of_ends.head(n_) * z_.row(k).head(n_) + of_ends.tail(n_) * z_.row(k).tail(n_);
  }
}

}  // namespace bromwich
