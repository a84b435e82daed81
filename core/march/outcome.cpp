#include "core/march/outcome.hpp"

#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/lcp/active_set.hpp"
#include "core/lcp/entries.hpp"
#include "core/lcp/enumeration.hpp"

namespace bromwich {

namespace {

// Whether the problem at t = 0 has not even a feasible point, where the class of M says nothing.
bool is_infeasible_at_zero(const DiscreteProblem& p) {
  constexpr Index most_constraints = 100;
  return !selects_one(p.lcp_class) && p.scene.constraints() <= most_constraints &&
         has_no_feasible_point(to_dense(p.scene.M), p.start);
}

SparseMatrix sparse_form(const LcpMatrix& M) {
  const auto* sparse = sparse_of(M);
  return sparse ? *sparse : SparseMatrix(to_dense(M).sparseView(0, 0));
}

Vector row_sums(const SparseMatrix& matrix) { return matrix.cwiseAbs() * Vector::Ones(matrix.cols()); }

}  // namespace

bool starts_below(const Scene& scene, const Vector& start, Result& result) {
  if (scene.dynamics->has_mass() || !(start.array() < 0).any()) return false;
  const SparseMatrix N = scene.dynamics->outputs(), B = scene.dynamics->inputs();
  const Vector of_M = row_sums(sparse_form(scene.M)), of_NB = row_sums(N * B), terms = N.cwiseAbs() * row_sums(B);
  const double share = 4 * double(scene.states() + 1) * epsilon;
  for (Index i = 0; i < start.size(); ++i) {
    if (!(start[i] < 0 && of_M[i] == 0 && of_NB[i] <= share * terms[i])) continue;
    result.status = Status::infeasible;
    result.reason = text(
        "no solution at t = 0: w_%td < 0, and no impulse of y moves it, since its rows of M and of N B "
        "are zero",
        i);
    result.infeasible_at = 0;
    return true;
  }
  return false;
}

Start solve_at_zero(const DiscreteProblem& p, Result& result) {
  result.y = RowMatrix::Constant(p.J + 1, p.scene.constraints(), NAN);
  Vector y0;
  const Start start = ProblemAtZero(p).solve(result, y0);
  if (start == Start::found) result.y.row(0) = y0.transpose();
  return start;
}

bool may_have_impulse(const DiscreteProblem& p) {
  return selects_least_norm(p.lcp_class) || (!has_one_solution(p.lcp_class) && !is_regular(p.scene.M));
}

ProblemAtZero::ProblemAtZero(const DiscreteProblem& p)
    : p_(p),
      r_(p.backend.array(1, p.scene.constraints())),
      v_(p.backend.array(1, p.scene.constraints())),
      y_(p.backend.array(1, p.scene.constraints())),
      lcp_(p.backend.lcp(p.scene.M, p.lcp_class, 1)) {
  renew();
}

void ProblemAtZero::renew() {
  p_.backend.upload(p_.start.transpose(), *r_);
  p_.backend.upload(RowMatrix::Zero(1, p_.scene.constraints()), *y_);
}

Start ProblemAtZero::solve(Result& result, Vector& y0) const {
  const LcpReport report = lcp_->solve(*r_, *v_, *y_, 0, 0);
  result.lcp.newton += report.count.newton;
  if (report.count.unsolved == 0 && report.finite) {
    RowMatrix start;
    p_.backend.download(*y_, start);
    y0 = start.transpose();
    ++result.lcp.solved;
    return Start::found;
  }
  const bool impulses = report.finite && may_have_impulse(p_);
  if (impulses) return starts_below(p_.scene, p_.start, result) ? Start::none : Start::impulse;
  const bool infeasible = report.infeasible == 0 || (report.finite && is_infeasible_at_zero(p_));
  result.status = infeasible ? Status::infeasible : Status::tolerance_not_met;
  result.reason = infeasible ? "no solution at t = 0" : "the problem at t = 0 stayed unsolved";
  if (infeasible) result.infeasible_at = 0;
  return Start::none;
}

namespace {

// A constraint that nothing moves, or whose y moves nothing; empty if there is none.
std::string idle_constraint(const DiscreteProblem& p) {
  const Index n = p.scene.constraints();
  Vector seen = Vector::Zero(n), driven = seen;
  const auto add = [](const SparseMatrix& matrix, Vector* rows, Vector* columns) {
    for (Index c = 0; c < matrix.outerSize(); ++c)
      for (SparseMatrix::InnerIterator e(matrix, c); e; ++e) {
        if (rows) (*rows)[e.row()] += std::abs(e.value());
        if (columns) (*columns)[c] += std::abs(e.value());
      }
  };
  add(p.scene.dynamics->outputs(), &seen, nullptr);
  add(p.scene.dynamics->inputs(), nullptr, &driven);
  add(sparse_form(p.scene.M), &seen, &driven);
  for (Index i = 0; i < n; ++i) {
    if (seen[i] == 0) return text("row %td of N and of M is zero, so that w is g there, whatever y is", i);
    if (driven[i] == 0) return text("column %td of B and of M is zero, so that y moves nothing there", i);
  }
  return "";
}

}  // namespace

void explain_stop(const DiscreteProblem& p, const MarchReport& report, Result& result) {
  const std::string where = text("t = %.6g", p.t[report.stopped]);
  if (report.interrupted) {
    result.status = Status::interrupted;
    result.reason = why_interrupted() + " at " + where;
  } else if (!report.finite) {
    result.status = Status::nonfinite;
    result.reason = "the solution is not finite at " + where;
  } else if (report.infeasible >= 0) {
    result.status = Status::infeasible;
    result.infeasible_at = p.t[report.infeasible];
    result.reason = "no solution from " + where + " on";
  } else if (!selects_one(p.lcp_class) && p.scene.constraints() <= largest_enumeration) {
    // All active sets were tried. Solutions of earlier steps need not be unique: this is no proof for the scene.
    result.status = Status::tolerance_not_met;
    result.reason = "no active set solves the step to " + where +
                    "; M is of no known class: with another solution of an earlier step it may go on";
  } else {
    result.status = Status::tolerance_not_met;
    const std::string idle = idle_constraint(p);
    result.reason = "the complementarity problem of the step to " + where + " stayed unsolved" +
                    (idle.empty() ? "; try other steps or another method" : ": " + idle);
  }
}

void count(const MarchReport& report, Result& result) {
  result.iterations = 1;
  result.lcp += report.count;
  result.seconds.lcp += report.lcp_seconds;
}

void tell(const ScanReport& scan, Result& result) {
  if (result.method == Method::shooting) {
    result.iterations = scan.passes;
    result.history = scan.history;
    result.kernel +=
        text("; %td chunks of time by Newton's method on their states, %td passes", scan.chunks, scan.passes);
  }
  if (scan.by_pieces) result.kernel += "; steps by affine pieces";
  if (scan.in_turn > 0)
    result.kernel += text(", which did not lead on: %td chunks marched one after another", scan.in_turn);
}

double march_residual(const DiscreteProblem& p, Start start, const Array& r, const Array& v, const Array& y) {
  const auto lcp = p.backend.lcp(p.scene.M, p.lcp_class, p.J + 1);
  if (start == Start::found) return lcp->residual(r, v, y);
  RowMatrix q, response, values;
  p.backend.download(r, response);
  p.backend.download(v, q);
  p.backend.download(y, values);
  q += response;
  q.row(0) = q.row(1);
  values.row(0) = values.row(1);
  const auto known = p.backend.array(q.rows(), q.cols()), zero = p.backend.array(q.rows(), q.cols()),
             solution = p.backend.array(q.rows(), q.cols());
  p.backend.upload(q, *known);
  p.backend.upload(values, *solution);
  return lcp->residual(*known, *zero, *solution);
}

}  // namespace bromwich
