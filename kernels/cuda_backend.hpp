#pragma once
// The backend on one CUDA device.

#include "bromwich/backend.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

struct BackendTraits;

/// Names of the usable devices, by device number; empty if there is no device or no driver.
std::vector<std::string> cuda_devices();

/// Whether this build contains the backend.
bool cuda_built();

/// Fitted to `bench auto` (bench/results/auto*.json) on one H200. Also defined in builds without CUDA.
BackendTraits cuda_traits();

/// Problems without a kernel run on `host`, with arrays copied both ways: other marches, shifted solves of sparse
/// dynamics, batches with semidefinite M, dense M above 64 or tridiagonal M above 4096 rows, chains of large sparse
/// maps. Throws Error if there is no such device.
std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device = 0);

}  // namespace bromwich
