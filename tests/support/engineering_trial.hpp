#pragma once
// A result of an engineering scene beside the oracle's.

#include "core/result/options.hpp"
#include "core/result/result.hpp"
#include "core/seam/backend.hpp"
#include "tests/support/switched_flow.hpp"

#include <functional>
#include <optional>
#include <string>

namespace bromwich::oracle {

/// The oracle's answer: two of four flows that agree, one with held bases and three with stages of different lengths.
struct KnownFlow {
  Flow flow;
  bool decided = false;
  std::string reason;
  double doubt = 0;  ///< distance of the two
};
/// From x0 up to T. Undecided if no flow with stages is nearer than `doubt` to the one with held bases, or to the one
/// with longer stages.
KnownFlow known_flow(const EngineeringScene&, const Vector& x0, double T, double doubt);

struct EngineeringTrial {
  /// right, missed (up to three tolerances), wrong, refused, none (refused, and no state repeats), undecided
  std::string verdict;
  std::string status, reason, warning, method;
  double error = 0;     ///< of x, largest of all rows, relative to error_scale
  double at = 0;        ///< where
  double estimate = 0;  ///< of x, or NaN
  double residual =
      0;  ///< of rows: |min(y, w)| with the sources of either side, relative to the terms; NaN in y counts 1
  double residual_at = 0;
  double seconds = 0;  ///< of CPU time, of the solve alone
  Index steps = 0;
};

/// Solves the scene file of the retold scene and compares x with the known flow of the original one. `solved` is called
/// after the solve.
EngineeringTrial try_engineering(const EngineeringScene&, const KnownFlow&, const Retold&, const Options&, Backend&,
                                 double tolerance, const std::function<void()>& solved = {});
/// Whether from x0 on each period comes to move the state as the one before did, after 10^5 of them too. Where
/// solutions do not part, as in passive circuits and in tanks, none repeats then.
bool drifts(const EngineeringScene&);
/// As try_engineering, for the state that repeats after a period: the flow from x(0) of the result has to follow its
/// rows and to return. There may be several such states.
EngineeringTrial try_periodic(const EngineeringScene&, const Retold&, const Options&, Backend&, double tolerance,
                              const std::function<void()>& solved = {});

}  // namespace bromwich::oracle
