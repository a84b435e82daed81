#pragma once
// Which method is fastest, known before one runs.
//
// For Kronecker sums with M of class P, backends know what their methods take (BackendTraits): sums of terms in n
// constraints and J steps. Everything else is marched first; a device does not help there.

#include "../lcp/matrix.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"
#include "../seam/traits.hpp"

namespace bromwich {

/// Seconds, set-up included, within a factor of about 1.5 on machines like those of the study; infinite where nothing
/// is known.
double predicted_seconds(const BackendTraits&, const Scene&, LcpClass, Method, Index J);

/// What `automatic` tries, in this order: the methods of second order, the fastest first, then implicit Euler.
std::vector<Method> methods_by_time(const BackendTraits&, const Scene&, LcpClass, Index J);

/// Whether a device is predicted to be faster than the host for this method, or for the best one where it is
/// `automatic`. `started`: the process has used the device already.
bool faster_on_device(const BackendTraits& device, const BackendTraits& host, const Scene&, Method, Index J,
                      bool started);

}  // namespace bromwich
