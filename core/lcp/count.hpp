#pragma once

namespace bromwich {

/// Counters of a batch of complementarity problems.
struct LcpCount {
  long solved = 0;     ///< problems solved
  long newton = 0;     ///< semismooth Newton sweeps over single problems
  long fallbacks = 0;  ///< problems that needed pivoting or a restart from the empty active set
  long unsolved = 0;   ///< problems left with a residual above rounding level

  LcpCount& operator+=(const LcpCount& other) {
    solved += other.solved;
    newton += other.newton;
    fallbacks += other.fallbacks;
    unsolved += other.unsolved;
    return *this;
  }
};

}  // namespace bromwich
