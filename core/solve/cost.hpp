#pragma once
// Memory and operations of a method, predicted: m states, n constraints, J steps, c state components, k source
// functions.

#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../seam/backend.hpp"

namespace bromwich {

struct Cost {
  double bytes = 0;       ///< memory at its largest, within a factor of about two
  double operations = 0;  ///< floating-point multiplications, order of magnitude (an iteration: for 100 sweeps)
  std::string largest;    ///< the largest part of the memory
};

/// For a named method; `automatic` stands for march.
Cost predicted_cost(const Scene&, Method, Index J, Index components, int threads = 1);

/// The part of the memory that is on a device with its own memory, without operations.
Cost predicted_device_cost(const Scene&, Method, Index J, Index components);

/// Whether the device has that many bytes free; true if the backend uses the memory of the host.
bool fits_on_device(const Scene&, Method, Index J, Index components, const DeviceInfo&);

/// Refuses runs that are too large: an operating system that overcommits memory would kill them without a message.
/// Throws Error with the numbers if the method needs more than options.memory_limit, more than the free memory of the
/// device, or more than 10^16 operations (weeks); for `automatic`, if no method fits. Returns the cost of the method,
/// for `automatic` that of the first method that fits.
Cost refuse_what_does_not_fit(const Scene&, const Options&, Index J, Index components, const DeviceInfo& = {});

}  // namespace bromwich
