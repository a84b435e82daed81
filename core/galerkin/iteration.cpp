#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/galerkin/recurrence.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/lcp_class.hpp"

#include <algorithm>

namespace bromwich {

bool asked_to_stop(const Options& options, GalerkinSolution& s) {
  if (!options.interrupted || !options.interrupted()) return false;
  s.status = Status::interrupted;
  s.reason = why_interrupted();
  return true;
}

namespace {

constexpr double diverging = 1e6;         ///< growth of the change over its least value
constexpr Index patience_sweeps = 60;     ///< without a smaller change
constexpr Index repeated_sweeps = 3;      ///< without a smaller change, once it is at rounding level
constexpr double rounding_level = 1e-10;  ///< of a change: smaller ones may go up and down

// Convergence, judged by the changes of the sweeps.
class SweepChanges {
 public:
  explicit SweepChanges(double tolerance) : tolerance_(tolerance) {}

  void add(double change) {
    since_ = change < least_ ? 0 : since_ + 1;
    least_ = std::min(least_, change);
    last_ = change;
  }
  bool converged() const { return last_ <= tolerance_ || (since_ >= repeated_sweeps && least_ <= rounding_level); }
  bool hopeless() const { return since_ >= patience_sweeps || last_ > diverging * std::max(least_, tolerance_); }

 private:
  double tolerance_, least_ = INFINITY, last_ = INFINITY;
  Index since_ = 0;
};

// Whether the iteration ends with the sweep reported; the solution says how.
bool ends(const LcpReport& report, const SweepChanges& changes, GalerkinSolution& s) {
  if (!report.finite) {
    s.status = Status::nonfinite;
    s.reason = "the iteration is not finite";
  } else if (report.count.unsolved > 0) {
    s.reason = "a complementarity problem of a sweep stayed unsolved";
  } else if (changes.converged()) {
    s.status = Status::solved;
  } else if (changes.hopeless()) {
    s.reason = text("the sweeps do not contract (change %.1e)", report.change);
  } else {
    return false;
  }
  return true;
}

}  // namespace

GalerkinSolution iterate_galerkin(const GalerkinProblem& p, Backend& backend, const Options& options) {
  const LcpMatrix D = p.first_step().D;
  const LcpClass lcp_class = classify(D);
  const Index rows = p.N + 1, n = p.unknowns();
  const RowMatrix zero = RowMatrix::Zero(p.N, n);
  const auto r = padded_array(galerkin_slack(p, zero, galerkin_states(p, zero)), backend), v = backend.array(rows, n),
             z = backend.array(rows, n);
  const auto convolution = backend.convolution(galerkin_recurrence(p.first_step()), rows);
  const auto lcp = backend.lcp(D, lcp_class, rows);

  GalerkinSolution s;
  s.iterated = true;
  s.unique = has_one_solution(lcp_class);
  Timer timer;
  SweepChanges changes(options.iteration_tolerance);
  for (s.iterations = 1; s.iterations <= options.max_iterations; ++s.iterations) {
    if (asked_to_stop(options, s)) break;
    convolution->apply(*z, *v, 1);
    timer.lap();
    const LcpReport report = lcp->solve(*r, *v, *z, 1, 0);
    s.lcp_seconds += timer.lap();
    s.lcp += report.count;
    s.history.push_back(report.change);
    if (options.progress) options.progress({s.iterations, report.change, 0});
    changes.add(report.change);
    if (ends(report, changes, s)) break;
  }
  if (s.status == Status::tolerance_not_met && s.reason.empty())
    s.reason = text("%ld sweeps were not enough", long(options.max_iterations));
  RowMatrix values;
  backend.download(*z, values);
  s.z = values.bottomRows(p.N);
  s.x = galerkin_states(p, s.z);
  s.how = "functional iteration over all intervals";
  s.bytes = r->bytes() + v->bytes() + z->bytes() + convolution->bytes() + lcp->bytes();
  return s;
}

}  // namespace bromwich
