#pragma once
// The backend on one CUDA device.

#include "../core/seam/backend.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// Names of the devices that can be used, in the order of their numbers; empty where there is none, or no driver.
std::vector<std::string> cuda_devices();

/// Whether this build has the backend at all.
bool cuda_built();

/// Fitted to `bench auto` (bench/results/auto*.json) on one H200. Known in builds without CUDA too.
BackendTraits cuda_traits();

/// What no kernel here takes goes to `host`, with copies to and fro: some of marching, the shifted solves of sparse
/// scenes, batches with positive semidefinite M or dense M above 64. Throws Error where there is no such device.
std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device = 0);

}  // namespace bromwich
