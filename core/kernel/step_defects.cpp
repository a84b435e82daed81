#include "core/kernel/step_defects.hpp"

namespace bromwich {

void StepDefects::add_to(RowMatrix& x) const {
  for (std::size_t i = 0; i < steps.size(); ++i) x.row(steps[i]) += values.row(Index(i));
}

}  // namespace bromwich
