#pragma once
// A convolution with two stages in each step, made of convolutions of one: on arrays of 2J + 1 rows, of which row 2j -
// 1 holds the first stage of step j and row 2j the second,
//
//     v_a = Σ_b W_ab * y_b.

#include "backend.hpp"

#include <memory>

namespace bromwich {

/// `parts[a][b]` holds W_ab. Row 0 of y is not used, so that weights of y_0 have to be zero; row 0 of v is zero.
using StageWeights = const Weights* const (&)[2][2];
std::unique_ptr<Convolution> make_stage_convolution(Backend&, StageWeights parts, Index n, Index rows);

/// The part from stage b to stage a of a recurrence of both.
ModalRecurrence part_of(const StageRecurrence&, int a, int b);

/// The same for these parts.
std::unique_ptr<Convolution> make_stage_convolution(Backend&, const StageRecurrence&, Index rows);

}  // namespace bromwich
