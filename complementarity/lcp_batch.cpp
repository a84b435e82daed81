#include "bromwich/lcp_batch.hpp"

#include "complementarity/checked_lcp.hpp"
#include "core/base/require.hpp"
#include "core/seam/backend.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

void require_square(const std::string& name, Index rows, Index cols) {
  if (rows != cols) throw Error(name, text("is %td x %td", rows, cols), "make it square");
}

void require_shape_of(const LcpMatrix& M) {
  if (const auto* dense = std::get_if<Matrix>(&M)) {
    require_square("M", dense->rows(), dense->cols());
    require_finite("M", *dense);
  } else if (const SparseMatrix* sparse = sparse_of(M)) {
    require_square("M", sparse->rows(), sparse->cols());
    const Eigen::Map<const Vector> values(sparse->valuePtr(), sparse->nonZeros());
    require_finite("M", values);
  } else {
    const auto& t = std::get<Tridiagonal>(M);
    require_length("M.lower", t.lower, t.diagonal.size(), "as the diagonal");
    require_length("M.upper", t.upper, t.diagonal.size(), "as the diagonal");
    for (const Vector* v : {&t.lower, &t.diagonal, &t.upper}) require_finite("M", *v);
  }
}

void require_columns(const std::string& name, const RowMatrix& found, Index rows, Index n) {
  if (found.rows() != rows || found.cols() != n)
    throw Error(name, text("is %td x %td", found.rows(), found.cols()),
                text("make it %td x %td, a row for each problem", rows, n));
}

void require_class(const LcpMatrix& M, LcpClass stated) {
  if (!is_stated(stated) || size(M) == 0) return;
  if (const auto why = contradiction(M, stated))
    throw Error("lcp_class", std::string("is ") + to_string(stated) + ", and M is not: " + *why, "use auto");
}

LcpBatchResult empty_result(Index count, Index n) {
  LcpBatchResult result;
  result.y = result.w = RowMatrix::Constant(count, n, NAN);
  result.status.assign(std::size_t(count), LcpStatus::unsolved);
  result.residual = result.margin = Vector::Constant(count, NAN);
  result.iterations.assign(std::size_t(count), 0);
  return result;
}

LcpBatchResult without_unknowns(LcpBatchResult result) {
  std::fill(result.status.begin(), result.status.end(), LcpStatus::solved);
  result.residual.setZero();
  result.margin.setConstant(INFINITY);
  return result;
}

constexpr Index rows_together = 64;  ///< judged by a thread at a time

// Takes y if it is a solution.
bool take(const CheckedLcp& problem, const Vector& q, const Vector& y, Index k, SlackTerms& scratch,
          LcpBatchResult& result) {
  Vector w;
  const CheckedLcp::Verdict verdict = problem.judge(q, y, w, scratch);
  if (!verdict.solution) return false;
  result.y.row(k) = y.array() + 0.0;  // no -0
  result.w.row(k) = w;
  result.residual[k] = verdict.residual;
  result.margin[k] = verdict.margin;
  result.status[std::size_t(k)] = LcpStatus::solved;
  return true;
}

void solve_singly(CheckedLcp& problem, const Vector& q, const Vector& start, Index k, LcpBatchResult& result) {
  Vector y;
  SlackTerms scratch;
  LcpStatus& status = result.status[std::size_t(k)];
  status = problem.solve(q, start, y, result.iterations[std::size_t(k)]);
  // From another start it may be another active set that passes.
  if (status == LcpStatus::solved && !take(problem, q, y, k, scratch, result)) status = LcpStatus::unsolved;
}

Vector start_of(const LcpBatchOptions& options, Index k) {
  return options.start.size() > 0 ? Vector(options.start.row(k).transpose()) : Vector();
}

// y of all rows by the backend; the active sets tried, on average.
RowMatrix by_backend(const LcpMatrix& M, LcpClass c, const RowMatrix& q, Backend& backend,
                     const LcpBatchOptions& options, Index& mean) {
  const Index count = q.rows(), n = q.cols();
  const auto r = backend.array(count, n), v = backend.array(count, n), y = backend.array(count, n);
  backend.upload(q, *r);
  backend.upload(RowMatrix::Zero(count, n), *v);
  backend.upload(options.start.size() > 0 ? RowMatrix(options.start.cwiseMax(0)) : RowMatrix::Zero(count, n), *y);
  const auto plan = backend.lcp(M, c, count);
  const LcpReport report = plan->solve(*r, *v, *y, 0);
  mean = (report.count.newton + count - 1) / count;
  RowMatrix found(count, n);
  backend.download(*y, found);
  return found;
}

}  // namespace

const char* to_string(LcpStatus status) {
  switch (status) {
    case LcpStatus::solved:
      return "solved";
    case LcpStatus::infeasible:
      return "infeasible";
    case LcpStatus::unsolved:
      return "unsolved";
    case LcpStatus::nonfinite:
      break;
  }
  return "nonfinite";
}

Index LcpBatchResult::solved() const { return std::count(status.begin(), status.end(), LcpStatus::solved); }

LcpBatchResult lcp_batch(const LcpMatrix& M, const RowMatrix& q, Backend& backend, const LcpBatchOptions& options) {
  require_shape_of(M);
  const Index n = size(M), count = q.rows();
  require_columns("q", q, count, n);
  if (options.start.size() > 0) require_columns("start", options.start, count, n);
  require_class(M, options.lcp_class);
  LcpBatchResult result = empty_result(count, n);
  if (n == 0) return result.classes = {LcpClass::P}, without_unknowns(result);
  const LcpClass c = known_class(M, options.lcp_class);
  result.classes = {c};
  if (count == 0) return result;
  CheckedLcp problem(M, c);
  RowMatrix finite = q;  // rows that are not finite are solved as q = 1
  for (Index k = 0; k < count; ++k)
    if (!q.row(k).allFinite()) finite.row(k).setOnes();
  Index mean = 0;
  const RowMatrix y = by_backend(M, c, finite, backend, options, mean);
  std::fill(result.iterations.begin(), result.iterations.end(), mean);
  share_each(backend, (count + rows_together - 1) / rows_together, [&](Index part) {
    SlackTerms scratch;
    for (Index k = part * rows_together; k < std::min(count, (part + 1) * rows_together); ++k)
      if (!q.row(k).allFinite())
        result.status[std::size_t(k)] = LcpStatus::nonfinite;
      else
        take(problem, q.row(k), y.row(k), k, scratch, result);
  });
  for (Index k = 0; k < count; ++k)
    if (result.status[std::size_t(k)] == LcpStatus::unsolved)
      solve_singly(problem, q.row(k), start_of(options, k), k, result);
  return result;
}

LcpBatchResult lcp_batch(const std::vector<Matrix>& M, const RowMatrix& q, Backend& backend,
                         const LcpBatchOptions& options) {
  const Index count = q.rows(), n = q.cols();
  if (Index(M.size()) != count)
    throw Error("M", text("has %zu matrices for %td rows of q", M.size(), count), "give one for each");
  if (options.start.size() > 0) require_columns("start", options.start, count, n);
  for (Index k = 0; k < count; ++k) {
    require_shape(text("M[%td]", k), M[std::size_t(k)], n, n, "n x n");
    if (M[std::size_t(k)].allFinite()) require_class(M[std::size_t(k)], options.lcp_class);
  }
  LcpBatchResult result = empty_result(count, n);
  result.classes.assign(std::size_t(count), n == 0 ? LcpClass::P : options.lcp_class);
  if (n == 0) return without_unknowns(result);
  share_each(backend, count, [&](Index k) {
    const Matrix& own = M[std::size_t(k)];
    const Vector right = q.row(k);
    if (!own.allFinite() || !right.allFinite()) {
      result.status[std::size_t(k)] = LcpStatus::nonfinite;
      return;
    }
    LcpClass& c = result.classes[std::size_t(k)];
    if (!is_stated(c)) c = quick_class(own);
    CheckedLcp problem(own, c);
    solve_singly(problem, right, start_of(options, k), k, result);
  });
  return result;
}

}  // namespace bromwich
