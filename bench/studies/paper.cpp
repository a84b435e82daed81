// The experiments of section 4 of the paper on Laplace inversion, with the numbers of its text. Values that it shows
// only in figures are not used.

#include "bench/studies/paper.hpp"
#include "app/commands.hpp"
#include "core/base/error.hpp"

namespace bromwich::app {

namespace {

void refuse_unused(const BenchRequest& request) {
  if (request.scene)
    throw Error("SCENE", "found '" + *request.scene + "'", "leave it out: this study uses dlcp-small and signorini");
  if (!request.settings.empty() || request.steps > 0)
    throw Error(request.steps > 0 ? "--steps" : "--set", "this study has the paper's sizes", "leave it out");
}

Json definitions() {
  return {
      {"paper",
       "Wu and Chen, A parallel iterative algorithm for differential linear complementarity problems, SIAM J. Sci. "
       "Comput. 39, 2017"},
      {"small scene",
       "dlcp-small has the paper's matrices; its printed sources admit no solution, so the solution is prescribed: "
       "iteration counts are those of our variant"},
      {"iterates",
       "k sweeps of contour against the iteration run until nothing changes, largest entry over all times; trace = N "
       "x, in signorini -2 times the state next to the membrane; sweeps_to_* for signorini are counted in half the "
       "trace, sweeps_to_tolerance_x in the whole state"},
      {"bound",
       "Theorem 2.2 (1), Euclidean norms, P = 25, with phi taken at the nodes of the contours of the time grid and L "
       "of Lemma 3.1; log10 of an absolute error"},
      {"difference",
       "4.3 left: largest difference between h and h/2 at the common times; 4.3 right: from contour on the same grid"},
      {"error", error_definition},
      {"seconds",
       "wall clock of whole solves without the trace, runs interleaved; median, min, max, and medians of set-up and "
       "solve"},
      {"split_percent", "of the whole time; lcp, convolution, transform and other are the parts of the solve"}};
}

}  // namespace

BenchReport bench_paper(const BenchRequest& request, Backend& backend) {
  refuse_unused(request);
  BenchReport report;
  report.scene = "signorini, dlcp-small";
  report.parameters = {{"c", 2e-3}, {"T", 4}};
  report.details = definitions();
  paper_small_iterates(request.quick, backend, report);
  paper_step_errors(request.quick, backend, report);
  paper_node_errors(request.quick, backend, report);
  paper_robustness(request.quick, backend, report);
  paper_large_iterates(request.quick, backend, report);
  paper_times(request.quick, request.repeats(), backend, report);
  print_with_notes("", report);
  return report;
}

}  // namespace bromwich::app
