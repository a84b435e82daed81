#include "nonlinear/tabulated.hpp"

#include "core/scene/separable.hpp"

#include <algorithm>
#include <cmath>
#include <memory>

namespace bromwich {

TimeFunction tabulated(const TimeFunction& given, double T, Index J, Index width) {
  if (!given) return given;
  // Times T j / J, (T / J) j and t_i + s differ by a few roundings; sides of jumps are 1e-12 T away.
  const double rounding = 16 * epsilon * T, h = T / double(J);
  const auto table = std::make_shared<const RowMatrix>(sample(given, time_grid(T, J), width).table());
  return [given, table, rounding, h, J](double t, Eigen::Ref<Vector> value) {
    const Index j = std::clamp<Index>(Index(std::llround(std::clamp(t / h, -1.0, double(J) + 1))), 0, J);
    if (std::abs(t - double(j) * h) <= rounding)
      value = table->row(j).transpose();
    else
      given(t, value);
  };
}

}  // namespace bromwich
