#pragma once

#include "../base/types.hpp"

#include <variant>

namespace bromwich {

using StepMatrix = std::variant<Matrix, SparseMatrix>;

struct StepMap {
  StepMatrix S, R;      ///< both dense or both sparse
  StepMatrix change{};  ///< R - S where that is known, as h A is, to more digits than subtraction leaves; or empty
  StepMatrix difference() const;  ///< `change`, or R - S
  bool plain_R() const;           ///< R = I, as of implicit Euler
};

/// Rows of a matrix of either kind.
Index step_rows(const StepMatrix&);

}  // namespace bromwich
