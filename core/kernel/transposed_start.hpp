#pragma once
// What the first row of K^T needs beside a convolution in reversed time (core/kernel/transposed_kernel.hpp).

#include "../seam/backend.hpp"

namespace bromwich {

/// The face in whose modes these weights act; empty without modes.
FaceBasis modal_face(const Weights&);

/// (K^T u)_0 = Σ_{j>=1} S_j^T u_j: u has J + 1 rows, with a column for each output of K. Not for few poles.
Vector transposed_start(Backend&, const Weights&, const RowMatrix& u);

}  // namespace bromwich
