#pragma once
// The weights of a discrete convolution in either form, and those of the grid with half the steps.
//
// A function that is piecewise linear on a coarse grid is so on the finer one: with the interpolation I and half the
// steps, (K_c y)_i = (K I y)_{2i}, or for tabulated weights
//
//     W^c_0 = W_0 + W_1/2,   W^c_d = W_{2d-1}/2 + W_{2d} + W_{2d+1}/2,   S^c_d = S_{2d} + W_{2d-1}/2      (d >= 1).

#include "../base/threads.hpp"
#include "../seam/recurrence.hpp"

#include <memory>
#include <utility>
#include <variant>

namespace bromwich {

/// Shared, as tables are large.
using SharedWeights = std::shared_ptr<const Weights>;

template <class Form>
SharedWeights share_weights(Form form) {
  return std::make_shared<const Weights>(std::move(form));
}

/// Null if the weights have the other form.
const LagTable* lag_table_of(const Weights&);
const Recurrence* recurrence_of(const Weights&);
const ModalRecurrence* modal_recurrence_of(const Weights&);
const PoleRecurrence* pole_recurrence_of(const Weights&);

/// W_0, n x n. Not for a line in modes.
Matrix first_weight(const Weights&);

/// |W_0| 1: n entries.
Vector first_row_sums(const Weights&);

/// Weights of the grid with half the steps.
LagTable coarsen(const LagTable&);

/// The same for exponentials, which become e^{2x}:
///     E^c = E^2,   C^c = C (1 + E)^2 / 2,   C^c G0^c = C (E G0 + 1/2),   W^c_0 = W_0 + W_1/2,   w1^c = s1^c = w1/2.
/// x0 is omitted.
ModalRecurrence coarsen(const ModalRecurrence&, const HostThreads& = HostThreads());

/// Halves the number of steps until it is `steps`. Not for dense recurrences.
Weights coarsened(const Weights& fine, Index fine_steps, Index steps, const HostThreads&);

}  // namespace bromwich
