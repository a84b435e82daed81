#pragma once
// Which method is fastest, known before one runs.
//
// Kronecker sums with M of class P: seconds as sums of terms in n constraints, J steps and S sweeps, fitted to
// `bench auto` (bench/results/auto*.json) on x86-64 processors of 2 and 16 cores and one H200; in milliseconds
//
//     march, processor      0.013 n + 1.2e-4 n^2 + 3.4e-5 n J + 6e-4 J
//     march, device         0.5 + 0.017 n + 2.8e-5 n^2 + 1e-5 n J + 2.4e-3 J
//     contour, device       0.8 + 1.5e-6 n J + 1.9e-4 J + S (0.042 + 3.9e-8 n J),   S = 10 + 0.6 n
//     multigrid, device     (0.32 + 2.5e-3 n) log2 J + 2e-6 n J + 8.5e-5 J
//
// On the processor marching was the fastest in all of the study. Everything else is marched first; a device does not
// help there.

#include "../lcp/matrix.hpp"
#include "../result/options.hpp"
#include "../result/result.hpp"

namespace bromwich {

/// Seconds, set-up included, within a factor of about 1.5 on machines like those of the study; infinite where nothing
/// is known.
double predicted_seconds(const Scene&, LcpClass, Method, Index J, bool on_device);

/// What `automatic` tries, in this order: the methods of second order, the fastest first, then implicit Euler.
std::vector<Method> methods_by_time(const Scene&, LcpClass, Index J, bool on_device);

/// What a process spends on a device before its first use.
inline constexpr double device_start_seconds = 0.15;

/// Whether a CUDA device is predicted to be faster than the processor for this method, or for the best one where it is
/// `automatic`. `started`: the process has used the device already.
bool faster_on_device(const Scene&, Method, Index J, bool started);

}  // namespace bromwich
