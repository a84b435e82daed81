#pragma once
// The backend on one CUDA device.

#include "core/backend.hpp"

#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// Names of the devices that can be used, in the order of their numbers; empty where there is none, or no driver.
std::vector<std::string> cuda_devices();

/// Whether this build has the backend at all.
bool cuda_built();

/// What is sequential in time or runs once in a set-up (marching, the shifted solves), and the few batches that no
/// kernel here takes (positive semidefinite M, dense M above 64), goes to `host`, with copies to and fro. Throws Error
/// where there is no such device.
std::unique_ptr<Backend> make_cuda_backend(std::unique_ptr<Backend> host, int device = 0);

}  // namespace bromwich
