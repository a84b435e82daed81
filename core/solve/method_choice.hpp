#pragma once
// Prediction of the fastest method.
//
// For Kronecker sums with M of class P, backends know the times of their methods (BackendTraits): sums of terms in n
// constraints and J steps. All other scenes are marched first; a device does not help there.

#include "../lcp/matrix.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../seam/traits.hpp"

namespace bromwich {

/// Seconds, set-up included, within a factor of about 1.5 on machines like those of the study; infinite if unknown.
double predicted_seconds(const BackendTraits&, const Scene&, LcpClass, Method, Index J);

/// The methods that `automatic` tries, in this order: those of second order, the fastest first, then implicit Euler.
std::vector<Method> methods_by_time(const BackendTraits&, const Scene&, LcpClass, Index J);

/// Whether a device is predicted to be faster than the host for this method, or for the best method if it is
/// `automatic`. `started`: the process has used the device already.
bool faster_on_device(const BackendTraits& device, const BackendTraits& host, const Scene&, Method, Index J,
                      bool started);

}  // namespace bromwich
