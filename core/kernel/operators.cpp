#include "core/kernel/operators.hpp"

namespace bromwich {

std::unique_ptr<TimeOperator> make_time_operator(const DiscreteProblem& p) {
  if (p.small_state()) return make_dense_operator(p);
  if (p.modes()) return make_modal_operator(p);
  return poles_pay(p) ? make_pole_operator(p) : make_lag_operator(p);
}

}  // namespace bromwich
