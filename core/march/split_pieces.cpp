#include "core/march/split_pieces.hpp"

#include "core/scan/source_numbers.hpp"

namespace bromwich {

namespace {

// f at the end and at the begin of each step, and g.
RowMatrix numbers_table(const SplitRule& rule) {
  const RowMatrix f = rule.p.f.size() > 0 ? RowMatrix(rule.p.f.table()) : RowMatrix(rule.p.J + 1, 0);
  const Index k = f.cols(), J = rule.p.J;
  RowMatrix all = RowMatrix::Zero(J + 1, 2 * k + rule.n);
  all.leftCols(k) = f;
  all.middleCols(k, k).bottomRows(J) = f.topRows(J);
  all.rightCols(rule.n) = rule.g;
  return all;
}

PieceMarchProblem piece_problem(const SplitRule& rule, const RowMatrix& x, const RowMatrix& y) {
  const StepOperators& step = *rule.step;
  const Index m = rule.d.A.rows(), n = rule.n;
  SourceNumbers sources = source_numbers(numbers_table(rule));
  const Index k = (sources.constant.size() - n) / 2;
  Matrix drift = Matrix::Zero(m, 2 * k + n);
  if (k > 0) {
    const Matrix F = source_matrix(rule.p);
    drift.leftCols(k) = step.right * F;
    drift.middleCols(k, k) = step.left * F;
  }
  Matrix seen = rule.d.N * drift;
  seen.rightCols(n).setIdentity();
  const Matrix forcing = step.decay * drift;
  ChunkStep s;
  s.h = rule.p.h;
  s.see = rule.d.N;
  s.decay = step.decay;
  s.drive = step.decay * rule.driven + rule.driven_left;
  s.shown = rule.driven;
  s.q = seen * sources.constant, s.of_q = seen * sources.of;
  s.f = forcing * sources.constant, s.of_f = forcing * sources.of;
  s.d = drift * sources.constant, s.of_d = drift * sources.of;
  s.unit = Vector::Ones(n);
  PieceMarchProblem problem;
  problem.steps.m = m, problem.steps.n = n;
  problem.steps.sources = std::move(sources.numbers);
  problem.steps.s0 = step.decay * x.row(0).transpose() + rule.driven_left * y.row(0).transpose();
  problem.steps.regular = Vector::Zero(n);
  problem.steps.steps.push_back(std::move(s));
  problem.problems.push_back({rule.whole, rule.whole_class, 0});
  return problem;
}

}  // namespace

bool march_split_by_pieces(const SplitRule& rule, const ScanPlan& plan, const SharedStop& stop, RowMatrix& x,
                           RowMatrix& y, ScanReport& report) {
  const bool has_pieces = has_one_solution(rule.whole_class) ||
                          (has_convex_solutions(rule.whole_class) && !selects_least(rule.p.lcp_class));
  if (rule.p.sources || !has_pieces || rule.d.A.rows() > 16 || rule.n > 16) return false;
  const PieceMarch found = march_by_pieces(piece_problem(rule, x, y), plan, stop);
  if (!found.march) return false;
  report = found.report;
  const RowMatrix first_x = x.row(0), first_y = y.row(0);
  found.march->download(found.march->x(), x);
  found.march->download(found.march->y(), y);
  x.row(0) = first_x;
  y.row(0) = first_y;
  return true;
}

}  // namespace bromwich
