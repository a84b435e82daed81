#pragma once
// Which expressions muParser may compile once for all values of their parameters: with parameters as variables it has
// to give the bits that it gives with their values as constants.
//
// Its optimiser computes with constants while it compiles. On neighbours v, a variable, and c, a constant,
//
//     c * v, v + c, (c * v) + c'        become one multiplication and one addition, of the same bits; but
//     c' (c * v), (v + c) + c', v^2     become (c' c) * v, v + (c + c'), v * v, which round otherwise.
//
// A value is followed through the program of the formula in both forms. Zeros may have another sign, since c * v is
// computed as c * v + 0; formulas with operations that see it (1/0, atan2) are left alone.

#include "files/formula.hpp"

namespace bromwich {

/// The variables of the formula are its parameters. False where it is not known.
bool same_with_variables(const Formula&);

}  // namespace bromwich
