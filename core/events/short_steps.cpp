#include "core/events/short_steps.hpp"

#include "core/lcp/lemke.hpp"
#include "core/lcp/solution.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

namespace {

constexpr double raised = 1e-9;         ///< of the diagonal, beside entries of 1
constexpr double zero_share = 1e-9;     ///< of the terms of w: less is zero
constexpr Index most_exact = 16;        ///< constraints whose principal minors are all computed
constexpr std::size_t most_known = 32;  ///< lengths whose matrices are kept

double largest_rate(const Matrix& A) {
  return A.rows() > 0 ? Eigen::EigenSolver<Matrix>(A, false).eigenvalues().cwiseAbs().maxCoeff() : 0;
}

// Of contacts with friction, whose gaps open with d_n and which slide with d_t < d_n / mu, none acts. The slack of
// friction that does not act is open, so that LCP(0, M) has other solutions; a larger diagonal takes them away. Then
// Lemke's method finds a solution, if the rows of the contacts are independent.
Vector cover_of(const SystemMatrices& system) {
  constexpr double sliding = 1.0 / 64;
  const Vector opens = openings(system).head(system.pairs());
  if (opens.isZero(0)) return {};
  return (opens.array() > 0).select(Vector::Ones(opens.size()), sliding);
}

LemkeOutcome covered(const Matrix& P, const Vector& q, const Vector& cover) {
  const Equilibration e = equilibrate(P);
  Matrix scaled = e.rows.asDiagonal() * P * e.columns.asDiagonal();
  scaled.diagonal().array() += raised;
  LemkeOutcome found = lemke(scaled, e.rows.cwiseProduct(q), cover);
  found.y = e.columns.cwiseProduct(found.y);
  return found;
}

}  // namespace

ShortSteps::ShortSteps(const SystemMatrices& system, const EventSources& sources, double T)
    : system_(system), sources_(sources), cover_(cover_of(system)), rate_(std::max(1 / T, largest_rate(system.A))) {}

bool ShortSteps::unique(LcpClass lcp_class) {
  class_ = LcpClass::P;
  limit_of_P_ = false;
  const Index n = system_.pairs();
  if (n == 0 || has_one_solution(lcp_class)) return true;
  const Matrix M = system_.M.topLeftCorner(n, n);
  const bool monotone_M = is_PSD(LcpMatrix(M));
  for (const double share : {1e-2, 1e-5}) {
    const Matrix moved = response(share / rate_).topLeftCorner(n, n), whole = M + moved;
    if (has_one_solution(classify(LcpMatrix(whole)))) continue;
    // The parts of M and of the response by themselves: that of a skew M is zero, and rounding of M does not count.
    const Monotone found =
        monotone_M ? monotone(Matrix(M + M.transpose()) + Matrix(moved + moved.transpose())) : Monotone::no;
    if (found == Monotone::yes) {
      class_ = LcpClass::PSD;
      continue;
    }
    limit_of_P_ = found == Monotone::no && n <= most_exact && is_P_exact(regularized(whole));
    if (!limit_of_P_) {
      class_ = LcpClass::unknown;
      return false;
    }
  }
  if (limit_of_P_) class_ = LcpClass::P;
  return true;
}

// With a larger diagonal, in units in which the entries are about 1.
Matrix ShortSteps::regularized(const Matrix& P) const {
  const Equilibration e = equilibrate(P);
  const Vector unit = e.rows.cwiseProduct(e.columns).cwiseInverse();
  return P + Matrix((raised * unit).asDiagonal());
}

// h N (I - hA)^{-1} B: what y adds to w within a step.
Matrix ShortSteps::response(double h) const {
  const Matrix shifted = Matrix::Identity(system_.states(), system_.states()) - h * system_.A;
  return h * (system_.N * shifted.partialPivLu().solve(system_.B));
}

// Whether the problem of a step, with twice the symmetric part S of its matrix, is monotone, and whether it determines
// B y: the difference of two solutions lies in the null space of S.
ShortSteps::Monotone ShortSteps::monotone(const Matrix& S) const {
  const Index n = S.rows();
  const Vector by = S.diagonal().cwiseAbs().cwiseMax(1e-290).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(Matrix(by.asDiagonal() * S * by.asDiagonal()));
  const Matrix B = system_.B.leftCols(n) * by.asDiagonal();
  const double zero = 1e-9 * solver.eigenvalues()[n - 1];
  if (!(solver.eigenvalues()[0] >= -zero)) return Monotone::no;
  const Vector size = B.cwiseAbs().rowwise().maxCoeff();  // of each state: they may have any units
  for (Index k = 0; k < n; ++k)
    if (solver.eigenvalues()[k] < zero &&
        ((B * solver.eigenvectors().col(k)).cwiseAbs().array() > 1e-7 * size.array()).any())
      return Monotone::moves_the_state;
  return Monotone::yes;
}

ShortSteps::OfLength& ShortSteps::of_length(double h) {
  if (const auto known = known_.find(h); known != known_.end()) return known->second;
  if (known_.size() == most_known) known_.clear();
  const Index m = system_.states();
  Eigen::PartialPivLU<Matrix> lu(Matrix::Identity(m, m) - h * system_.A);
  Matrix moved = h * lu.solve(system_.B), problem = system_.M + system_.N * moved;
  std::optional<ActiveSetLcp> lcp;
  if (const Index n = system_.pairs(); n > 0) {
    const Matrix pairs = problem.topLeftCorner(n, n);
    lcp.emplace(limit_of_P_ ? regularized(pairs) : pairs, class_);
  }
  return known_.try_emplace(h, OfLength{std::move(lu), std::move(moved), std::move(problem), std::move(lcp)})
      .first->second;
}

// By increments of x and g: w of a constraint that the state touches is lost in rounding of x otherwise.
ShortSteps::Step ShortSteps::take(double t, double h, const Vector& x, const Vector& offset) {
  auto& [lu, moved, problem, lcp] = of_length(h);
  const Vector free = h * lu.solve(Vector(system_.A * x + sources_.f(t + h)));
  const Vector q = (system_.N * x + sources_.g(t + h) - offset) + system_.N * free;
  const Index n = system_.pairs();
  Step step;
  Vector slack;
  step.solved = n == 0;
  if (lcp) {
    lcp->reset();  // the same from whatever was solved before
    step.solved = lcp->solve(q.head(n), step.y).solved;
    if (step.solved) slack = lcp->slack();
  }
  if (!step.solved && cover_.size() > 0) {
    const Matrix pairs = problem.topLeftCorner(n, n);
    LemkeOutcome found = covered(pairs, q.head(n), cover_);
    step.solved = found.solved;
    if (step.solved) step.y = std::move(found.y), slack = pairs * step.y + q.head(n);
  }
  step.pairs = n;
  step.problem = problem;
  step.q = q;
  step.cover = cover_;
  step.y.conservativeResize(q.size());
  for (Index i = n; i < q.size(); ++i)
    step.y[i] = std::max(0.0, -(problem.row(i).head(n) * step.y.head(n) + q[i]) / problem(i, i));
  if (!step.solved) return step;
  step.x = x + free + moved * step.y;
  const Vector terms = problem.cwiseAbs() * step.y + q.cwiseAbs(), w = problem * step.y + q;
  for (Index i = 0; i < q.size(); ++i)
    if (step.y[i] > 0 || (i < n ? slack[i] : w[i]) <= zero_share * terms[i]) step.zero_w.push_back(i);
  return step;
}

std::vector<Index> ShortSteps::Step::basis() const {
  if (pairs == 0) return {};
  const Matrix P = problem.topLeftCorner(pairs, pairs);
  const Equilibration e = equilibrate(P);
  std::vector<Index> found =
      lemke(e.rows.asDiagonal() * P * e.columns.asDiagonal(), e.rows.cwiseProduct(q.head(pairs))).basis;
  if (found.empty() && cover.size() > 0) found = covered(P, q.head(pairs), cover).basis;
  if (found.empty()) return found;
  for (Index i = pairs; i < q.size(); ++i)
    if (y[i] > 0) found.push_back(i);
  return found;
}

}  // namespace bromwich
