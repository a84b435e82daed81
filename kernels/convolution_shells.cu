// Scans of modes in groups that keep the rates they need (core/kernel/shells.hpp).

#include "kernels/convolution_scan.cuh"
#include "kernels/parts.hpp"

#include <algorithm>

namespace bromwich::cuda {

std::vector<int> scan::counts_of(const Shells& shells) {
  std::vector<int> counts;
  for (Index g = 0; g < Index(shells.of_group.size()); ++g)
    counts.push_back(int((shells.kept(g) + group - 1) / group * group));
  return counts;
}

std::unique_ptr<Convolution> make_shell_scan(const Device& device, const ModalRecurrence& r, Index rows) {
  const scan::DeviceThreads threads(device);
  return scan::make_scan(device, r, find_shells(threads, r, std::max<Index>(rows - 1, 1), scan::lanes, scan::group),
                         rows);
}

}  // namespace bromwich::cuda
