#include "derivatives/galerkin_derivative.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/galerkin/recovery.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/numerics/two_point.hpp"
#include "core/scene/separable.hpp"
#include "derivatives/check_table.hpp"

#include <Eigen/LU>
#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace bromwich {

namespace {

constexpr double left_of_conditions = 1e-7;  ///< residual of the result in its discrete problem
constexpr double least_condition = 1e-14;

const char* const divided_sources = "sources jump or bend inside intervals, and matrices have no derivative there";
const char* const other_nodes = "solve on intervals that end at the breakpoints";

[[noreturn]] void refuse_galerkin(const std::string& found, const std::string& remedy) {
  throw Error("derivative", found, remedy);
}

const Scene& checked_for_galerkin(const Scene& scene, const Result& r) {
  if (r.status != Status::solved)
    refuse_galerkin(text("the result is not solved (%s)", to_string(r.status)), "differentiate solved results");
  if (r.method != Method::galerkin)
    refuse_galerkin(text("the result is of method %s", to_string(r.method)), "solve by galerkin");
  if (scene.constraints() == 0)
    refuse_galerkin("the scene has no constraints", "add one that is never active: M = 1 and g = 1");
  if (!r.interval_rules.empty())
    refuse_galerkin("not differentiable here: M_SS is singular on an active set, and y may jump",
                    "differentiate scenes with a continuous y");
  const Index N = r.t.size() - 1, n = scene.constraints();
  if (r.y.rows() != N + 1 || r.y_left.rows() != N || r.y.cols() != n || r.y_left.cols() != n)
    refuse_galerkin("the result has other rows than its grid", "differentiate a result as solve returned it");
  return scene;
}

// The scene with dense dynamics and E = I; `inverse`: of its E, empty without one.
Scene without_mass_matrix(const Scene& given, Matrix& inverse) {
  Scene scene = written_out(given);
  const DenseDynamics& d = *scene.dynamics->small_state();
  if (d.E.size() == 0) return scene;
  const Eigen::PartialPivLU<Matrix> lu(d.E);
  if (!(lu.rcond() > least_condition)) refuse_galerkin("E is singular", "eliminate the algebraic states");
  inverse = lu.inverse();
  if (scene.f) {
    scene.F = Matrix(inverse * source_matrix(scene, d)).sparseView();
    scene.f_entry = SourceEntry::through_F;
  }
  scene.dynamics = DenseDynamics{inverse * d.A, inverse * d.B, d.N};
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

}  // namespace

GalerkinDerivative::GalerkinDerivative(const Scene& scene, const Result& result)
    : scene_(without_mass_matrix(checked_for_galerkin(scene, result), inverse_E_)),
      d_(to_dense(scene_.dynamics)),
      M_(to_dense(scene.M)),
      z_(galerkin_coefficients(result)),
      y_(right_ends_of(z_)),
      m_(scene.states()),
      n_(scene.constraints()) {
  SharedDynamics shared(scene_.dynamics);
  p_ = galerkin_problem(scene_, grid_parts(result.t), shared);
  x_ = galerkin_states(p_, z_);
  if (!(natural_residual(p_, z_, x_, scene.free_rows) <= left_of_conditions))
    refuse_galerkin("the intervals of the result do not give its y", "solve without breakpoints inside intervals");
  entries_ = galerkin_entries(p_, shared);
  take_sets();
  check_continuous();
  judge();
}

Index GalerkinDerivative::run_of(Index k) const {
  Index run = 0;
  while (run + 1 < Index(p_.runs.size()) && p_.runs[std::size_t(run + 1)].first <= k) ++run;
  return run;
}

// The active sets, and P of each.
void GalerkinDerivative::take_sets() {
  const auto is_free = [&](Index i) {
    return std::binary_search(scene_.free_rows.begin(), scene_.free_rows.end(), i % n_);
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

// Where the sets of neighbouring intervals differ, y is a Lipschitz function of x and t if the Schur complement of M on
// what acts all along, free rows included, is a P-matrix on the rest (strong regularity: Robinson, Math. Oper. Res. 5,
// 1980). Elsewhere M_SS is regular: method galerkin takes other intervals by stages.
void GalerkinDerivative::check_continuous() const {
  if (scene_.free_rows.empty() && has_one_solution(selection_class(scene_.M, scene_.lcp_class))) return;
  std::set<std::pair<std::vector<Index>, std::vector<Index>>> seen;
  for (Index k = 0; k < p_.N; ++k) {
    std::vector<Index> always, switching;
    for (Index i = 0; i < n_; ++i) {
      int acts = 0, ends = 0;
      for (Index other = std::max<Index>(k - 1, 0); other <= k; ++other, ends += 2)
        acts += int(z_(other, i) > 0) + int(z_(other, n_ + i) > 0);
      if (acts == ends || std::binary_search(scene_.free_rows.begin(), scene_.free_rows.end(), i))
        always.push_back(i);
      else if (acts > 0)
        switching.push_back(i);
    }
    if (!seen.insert({always, switching}).second) continue;
    Matrix rest = M_(switching, switching);
    if (!always.empty()) {
      const Eigen::PartialPivLU<Matrix> lu(Matrix(M_(always, always)));
      if (!(lu.rcond() > least_condition))
        refuse_galerkin(
            text("not differentiable here: M is singular on the constraints that act at t = %.6g, and y may "
                 "jump",
                 p_.t[k]),
            "differentiate scenes with a continuous y");
      rest -= M_(switching, always) * lu.solve(Matrix(M_(always, switching)));
    }
    if (!switching.empty() && !has_one_solution(selection_class(rest, LcpClass::automatic)))
      refuse_galerkin(
          text("not differentiable here: M is no P-matrix on the constraints that switch near t = %.6g, and "
               "y may jump",
               p_.t[k]),
          "differentiate scenes with a continuous y");
  }
}

// How far the moments of y and w are from y_i = w_i = 0.
void GalerkinDerivative::judge() {
  const RowMatrix y = by_ends(z_), w = by_ends(galerkin_slack(p_, z_, x_));
  std::vector<std::vector<Index>> active(std::size_t(y.rows()));
  for (Index j = 0; j < y.rows(); ++j)
    for (Index i = 0; i < n_; ++i)
      if (y(j, i) > 0 || std::binary_search(scene_.free_rows.begin(), scene_.free_rows.end(), i))
        active[std::size_t(j)].push_back(i);
  Vector t(y.rows());
  for (Index j = 0; j < y.rows(); ++j) t[j] = p_.t[(j + 1) / 2];
  const Vector most_x = x_.cwiseAbs().colwise().maxCoeff();
  const SetRounding zero = rounding_of_sets(d_.N.cwiseAbs() * most_x, scene_.M, y, by_ends(p_.q));
  margin_ = margin_of_sets(y, w, zero, t, [&](Index j) -> const std::vector<Index>& { return active[std::size_t(j)]; });
}

GalerkinChange GalerkinDerivative::no_change() const {
  return {RowMatrix::Zero(p_.N, m_), RowMatrix::Zero(p_.N, 2 * n_), Vector::Zero(m_), RowMatrix::Zero(p_.N + 1, n_)};
}

SolutionChange GalerkinDerivative::jvp(const DataChange& c) const {
  p_.initial_value ? check_no_b(c.b) : check_no_x0(c.x0);
  check_no_restitution(c.restitution);
  check_data(c, p_.N + 1, m_, n_);
  check_table("b", c.b, m_, 1);
  check_table("E0", c.E0, m_, m_);
  check_table("ET", c.ET, m_, m_);
  if (p_.initial_value && (c.E0.size() > 0 || c.ET.size() > 0))
    throw Error("E0", "is no datum of a scene with an initial value", "change x0");
  if (c.E.size() > 0 && inverse_E_.size() == 0) refuse_galerkin("the scene has no E", "change A and B instead");
  if (p_.divided > 0 && (c.A.size() > 0 || c.B.size() > 0 || c.N.size() > 0 || c.E.size() > 0))
    refuse_galerkin(divided_sources, other_nodes);
  Matrix dA = c.A, dB = c.B, dF;
  RowMatrix df = c.f;
  if (inverse_E_.size() > 0) {
    for (Matrix* change : {&dA, &dB})
      if (change->size() > 0) *change = inverse_E_ * *change;
    if (df.size() > 0) df = df * inverse_E_.transpose();
    if (c.E.size() > 0) {
      const Matrix of_rate = inverse_E_ * c.E;
      dA = dA.size() > 0 ? Matrix(dA - of_rate * d_.A) : Matrix(-of_rate * d_.A);
      dB = dB.size() > 0 ? Matrix(dB - of_rate * d_.B) : Matrix(-of_rate * d_.B);
      if (scene_.f) dF = -of_rate * source_matrix(scene_, d_);
    }
  }
  GalerkinChange change = no_change();
  add_matrix_changes(state(), dA, dB, c.N, dF, change);
  add_source_changes(state(), entries_, df, c.g, c.M, change);
  if (const Vector& given = p_.initial_value ? c.x0 : c.b; given.size() > 0) change.b = given;
  if (c.E0.size() > 0) change.b -= c.E0 * x_.row(0).transpose();
  if (c.ET.size() > 0) change.b -= c.ET * x_.row(p_.N).transpose();
  return jvp(change);
}

SolutionChange GalerkinDerivative::jvp(const GalerkinChange& c) const {
  RowMatrix input(p_.N, m_);
  std::vector<const Matrix*> P;
  Vector z(2 * n_);
  for (Index k = 0; k < p_.N; ++k) {
    P.push_back(&P_.at(sets_[std::size_t(k)]));
    responses_.solve(sets_[std::size_t(k)], c.q.row(k).transpose(), z);
    input.row(k) = c.F.row(k) + (step(k).H * z).transpose();
  }
  BoundaryCondition ends = p_.boundary;
  ends.b = c.b;
  SolutionChange out{RowMatrix(p_.N + 1, n_), solve_two_point(P, input, ends, epsilon), RowMatrix(),
                     RowMatrix::Zero(p_.N + 1, n_)};
  if (out.x.rows() == 0)
    refuse_galerkin("not differentiable here: the boundary condition does not determine the change of the states",
                    "change the data slightly");
  for (Index k = 0; k < p_.N; ++k) {
    responses_.solve(sets_[std::size_t(k)], step(k).C * out.x.row(k).transpose() + c.q.row(k).transpose(), z);
    if (k == 0) out.y.row(0) = z.head(n_).transpose();
    out.y.row(k + 1) = z.tail(n_).transpose();
    out.integral.row(k + 1) = out.integral.row(k) + (length(k) / 2) * (z.head(n_) + z.tail(n_)).transpose();
  }
  out.w = out.x * d_.N.transpose() + out.y * M_.transpose() + c.direct;
  return out;
}

// What the discrete problem leaves of the solution of this one, by the difference formula.
GalerkinChange GalerkinDerivative::change(const std::array<const Scene*, 4>& scenes, double distance) const {
  constexpr double weights[] = {1, -8, 8, -1};
  GalerkinChange sum = no_change();
  for (std::size_t i = 0; i < 4; ++i) {
    Matrix unused;
    const Scene scene = without_mass_matrix(*scenes[i], unused);
    const GalerkinProblem p = galerkin_problem(scene, grid_parts(p_.t));
    const double c = weights[i] / (12 * distance);
    sum.F += c * p.forcing;
    for (const GalerkinRun& run : p.runs) {
      const auto x = x_.middleRows(run.first, run.count), z = z_.middleRows(run.first, run.count);
      sum.F.middleRows(run.first, run.count) += c * (x * run.step.E.transpose() + z * run.step.H.transpose());
    }
    sum.q += c * galerkin_slack(p, z_, x_);
    sum.b += c * (p.boundary.b - p.boundary.E0 * x_.row(0).transpose() - p.boundary.ET * x_.row(p_.N).transpose());
    sum.direct += c * (x_ * scene.dynamics->small_state()->N.transpose() + y_ * to_dense(scene.M).transpose());
    if (scene.g) sum.direct += c * sample(scene.g, p_.t, n_).table();
  }
  return sum;
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

GalerkinChange GalerkinDerivative::adjoint(const SolutionChange& of) const {
  check_table("y", of.y, p_.N + 1, n_);
  check_table("x", of.x, p_.N + 1, m_);
  check_table("w", of.w, p_.N + 1, n_);
  check_table("integral", of.integral, p_.N + 1, n_);
  GalerkinChange bar = no_change();
  if (of.w.size() > 0) bar.direct = of.w;
  RowMatrix of_y = of.y.size() > 0 ? of.y : RowMatrix::Zero(p_.N + 1, n_);
  RowMatrix of_x = of.x.size() > 0 ? of.x : RowMatrix::Zero(p_.N + 1, m_);
  of_y += bar.direct * M_;
  of_x += bar.direct * d_.N;
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
  bar.F = multipliers(of_x, bar.b);
  for (Index k = 0; k < p_.N; ++k) {
    const Vector eta = of_z.row(k).transpose() + step(k).H.transpose() * bar.F.row(k).transpose();
    responses_.solve_transposed(sets_[std::size_t(k)], eta, mu);
    bar.q.row(k) = -mu.transpose();
  }
  return bar;
}

DataChange GalerkinDerivative::vjp(const SolutionChange& of) const {
  const GalerkinChange of_problem = adjoint(of);
  SourceGradients of_sources = source_gradients(state(), entries_, of_problem);
  DataChange bar;
  bar.f = std::move(of_sources.f), bar.g = std::move(of_sources.g), bar.M = std::move(of_sources.M);
  (p_.initial_value ? bar.x0 : bar.b) = of_problem.b;
  if (!p_.initial_value) {
    bar.E0 = -of_problem.b * x_.row(0);
    bar.ET = -of_problem.b * x_.row(p_.N);
  }
  const Matrix back = inverse_E_.transpose();
  if (back.size() > 0) bar.f = bar.f * inverse_E_;
  if (p_.divided > 0) return bar;
  MatrixGradients of_matrices = matrix_gradients(state(), of_problem);
  bar.A = std::move(of_matrices.A), bar.B = std::move(of_matrices.B), bar.N = std::move(of_matrices.N);
  if (back.size() == 0) return bar;
  bar.E = -back * (bar.A * d_.A.transpose() + bar.B * d_.B.transpose());
  if (scene_.f) bar.E -= back * of_matrices.F * source_matrix(scene_, d_).transpose();
  bar.A = back * bar.A;
  bar.B = back * bar.B;
  return bar;
}

}  // namespace bromwich
