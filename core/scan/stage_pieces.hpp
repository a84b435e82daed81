#pragma once
// A march in stages (core/host/stage_march.hpp) by the affine pieces of its steps (piece_march.hpp).

#include "../host/stage_march.hpp"
#include "piece_march.hpp"

#include <optional>

namespace bromwich {

/// As march_by_stages, which has the same steps. Empty: these steps have no such pieces, or their chunks lead nowhere.
/// Impacts are not recorded.
std::optional<StageSolution> march_stages_by_pieces(const StageProblem&, const Vector& y0, const ScanPlan&,
                                                    const SharedStop&, ScanReport& report);

}  // namespace bromwich
