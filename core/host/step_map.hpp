#pragma once

#include "../base/types.hpp"

#include <variant>

namespace bromwich {

using StepMatrix = std::variant<Matrix, SparseMatrix>;

struct StepMap {
  StepMatrix S, R;      ///< both dense or both sparse
  StepMatrix change{};  ///< R - S if known to more digits than the subtraction gives (h A, for example); may be empty
  StepMatrix difference() const;  ///< `change`, or R - S
  bool plain_R() const;           ///< whether R = I, as for implicit Euler
};

/// Number of rows of a dense or sparse matrix.
Index step_rows(const StepMatrix&);

}  // namespace bromwich
