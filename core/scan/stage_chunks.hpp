#pragma once
// A march in stages (core/host/stage_march.hpp) of dense dynamics by Newton's method on the states between chunks of
// time (core/scan/chunk_scan.hpp). With Y on its active set S, (I ⊗ M + W)_SS Y_S = -q_S, and with the maps of a step
// (DenseStageMaps) its derivative is
//
//     P_S = decay - drive_S (I ⊗ M + W)_SS^{-1} see_S.
//
// Which constraints touched at the end of the last step, and how large y was without jumps, goes from chunk to chunk
// beside the state: both decide which steps implicit Euler takes.

#include "../host/stage_march.hpp"
#include "chunk_scan.hpp"

namespace bromwich {

/// As march_by_stages, which has the same steps; `report` says how it went.
StageSolution march_in_chunks(const StageProblem&, const Vector& y0, const ScanPlan&, ScanReport& report);

}  // namespace bromwich
