#pragma once
// Steps of dense scenes with continuous y (split_steps.hpp), none of them in parts, by the affine pieces of their
// solutions (core/scan/piece_march.hpp). The state between steps is s = E x + L y:
//
//     q = N (s + d_j) + g_j,   y in SOL(M + N R, q),   x = s + d_j + R y,   s+ = E (s + d_j) + (E R + L) y.

#include "../scan/piece_march.hpp"
#include "split_steps.hpp"

namespace bromwich {

/// Rows of x and y behind row 0. False: these steps have no such pieces, or their chunks lead nowhere.
bool march_split_by_pieces(const SplitRule&, const ScanPlan&, const SharedStop&, RowMatrix& x, RowMatrix& y,
                           ScanReport& report);

}  // namespace bromwich
