// Scans of modes in groups that keep the rates they need (core/kernel/shells.hpp).

#include "core/kernel/shells.hpp"
#include "kernels/convolution_scan.cuh"
#include "kernels/parts.hpp"

#include <algorithm>
#include <utility>

namespace bromwich::cuda {

scan::GroupedModes scan::in_groups(const ModalRecurrence& r, Index steps) {
  Shells shells = in_shells(r, steps, lanes, group);
  GroupedModes modes{std::move(shells.recurrence), {}};
  for (const Index count : shells.counts) modes.counts.push_back(int((count + group - 1) / group * group));
  return modes;
}

std::unique_ptr<Convolution> make_shell_scan(const Device& device, const ModalRecurrence& r, Index rows) {
  const scan::GroupedModes modes = scan::in_groups(r, std::max<Index>(rows - 1, 1));
  return scan::make_scan(device, modes.recurrence, r.modes(), rows, modes.counts);
}

}  // namespace bromwich::cuda
