#include "core/kernel/time_operator.hpp"

#include "core/kernel/pole_plans.hpp"
#include "core/kernel/recurrence.hpp"

#include <cmath>
#include <type_traits>

namespace bromwich {

std::size_t MarchData::bytes() const {
  const auto numbers = [](const auto& w) -> Index {
    using Kind = std::decay_t<decltype(w)>;
    if constexpr (std::is_same_v<Kind, ModalRecurrence>)
      return 3 * w.decay.size() + w.initial.size();
    else
      return w.decay.size() + 3 * w.input.size();
  };
  Index of_weights = 0;  // those of poles belong to their operator
  if (recurrence_of(*weights)) of_weights = std::visit(numbers, *recurrence_of(*weights));
  if (const LagTable* table = lag_table_of(*weights)) of_weights = table->W.size() + table->S.size();
  return sizeof(double) * std::size_t(of_weights + forcing.size()) + r.bytes();
}

const BasisChoice& TimeOperator::basis() {
  if (!basis_) basis_ = choose_basis();
  return *basis_;
}

std::unique_ptr<SpaceTimeKernel> TimeOperator::kernel_of(const Weights& weights, Index steps,
                                                         ConvolutionChoice choice) {
  const Index rows = steps + 1, n = p_.scene.constraints();
  const LagTable* table = lag_table_of(weights);
  const Recurrence* recurrence = recurrence_of(weights);
  const PoleRecurrence* poles = pole_recurrence_of(weights);
  auto convolution = poles            ? make_pole_convolution(p_.backend, *poles, rows)
                     : table          ? p_.backend.convolution(*table, rows)
                     : by_fft(choice) ? p_.backend.convolution(lag_table(*recurrence, steps), rows)
                                      : p_.backend.convolution(*recurrence, rows);
  return std::make_unique<SpaceTimeKernel>(p_.backend, std::move(convolution), modal() ? p_.face() : FaceBasis{}, rows,
                                           n);
}

bool scan_is_cheaper(double m, double n, double J) {
  const double scan = J * (m * m + 2 * m * n + n * n), length = 2 * J;
  return scan <= 2 * n * 2.5 * length * std::log2(length) + 2 * n * n * length;
}

}  // namespace bromwich
