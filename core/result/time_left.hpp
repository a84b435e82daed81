#pragma once
// An estimate of the time that a solve still takes, from the reports of its progress.
//
// symbol  meaning
// k       steps done of K, or sweeps done
// s       seconds since the first report of this pass
// c_k     change of y in sweep k
//
// Steps: those left take as long as those done, (K - k) s / (k - k_first). Sweeps: the change falls by the factor
// rho = (c_k / c_{k-d})^{1/d} of the last d sweeps, so that ln(tolerance / c_k) / ln rho sweeps are left, of the mean
// duration. A pass is one grid: a march of another number of steps, or a count that begins anew, is the next pass.

#include "options.hpp"

#include <optional>
#include <vector>

namespace bromwich {

class TimeLeft {
 public:
  /// `tolerance`: the change at which iterations end (Options::iteration_tolerance).
  explicit TimeLeft(double tolerance = 1e-12) : tolerance_(tolerance) {}

  /// To be called with every report, at `seconds` of any clock that does not go back. Seconds to the end of this pass;
  /// empty while nothing can be said: in the first report of a pass, and where sweeps do not converge.
  std::optional<double> after(const Progress&, double seconds);

 private:
  std::optional<double> steps_left(const Progress&) const;

  double tolerance_;
  bool begun_ = false;
  Progress first_, last_;
  double since_ = 0;
  struct Sweep {
    Index iteration;
    double change;
  };
  std::vector<Sweep> sweeps_;  ///< the last ones
};

}  // namespace bromwich
