#pragma once
// Times at which a gated switch opens and closes.

#include "circuits/waveform.hpp"

#include <optional>
#include <utility>
#include <vector>

namespace bromwich::circuits {

/// A control signal, a sum of sources with factors.
struct Control {
  double constant = 0;
  std::vector<std::pair<const Waveform*, double>> sources;
};

struct SwitchTimes {
  bool on_at_start = false;
  std::vector<double> times;  ///< in (0, T), increasing: it changes at each
};

/// It closes where the signal rises above `close`, and opens where it falls below `open` <= `close`. Crossings are
/// located to rounding: exactly between the breakpoints of piecewise linear sources, and for others with 64 looks a
/// period. `on`: before t = 0, where the signal lies between the two; otherwise open.
SwitchTimes switch_times(const Control&, double close, double open, double T, std::optional<bool> on = {});

}  // namespace bromwich::circuits
