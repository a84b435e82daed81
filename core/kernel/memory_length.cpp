#include "core/kernel/memory_length.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich {

std::vector<Index> memory_lengths(const ModalRecurrence& r, Index J) {
  constexpr double rounding = std::numeric_limits<double>::epsilon() / 2;
  std::vector<Index> lengths(std::size_t(r.modes()), J);
  if (r.initial.size() > 0) return lengths;
  if (r.exponentials() == 0) return std::vector<Index>(lengths.size(), 1);
  const auto E = r.decay.array(), C = r.output.array(), G0 = r.start.array();
  const Eigen::Array<double, 1, Eigen::Dynamic> slowest = E.abs().colwise().maxCoeff(),
                                                sum = (C / (1 - E)).colwise().sum(),
                                                size = (C.abs() * G0.abs().max(1) / (1 - E.abs())).colwise().sum();
  for (Index l = 0; l < r.modes(); ++l) {
    if (!(slowest[l] < 1)) continue;
    const double kernel = std::max(std::abs(r.w0[l]), std::abs(r.w0[l] + r.w1[l] + sum[l]));
    const double D = std::ceil(std::log(size[l] / (rounding * kernel)) / -std::log(slowest[l]));
    if (std::isfinite(kernel) && D < double(J)) lengths[std::size_t(l)] = D > 1 ? Index(D) : 1;
  }
  return lengths;
}

}  // namespace bromwich
