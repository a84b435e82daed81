#pragma once
// Ranks with a device each, whose values travel from device to device by NCCL, in the stream of the backend.

#include "core/seam/backend.hpp"
#include "core/seam/communicator.hpp"

#include <memory>

namespace bromwich {

/// `job`: the same ranks, by which they find each other; it is not used afterwards. `cuda`: the backend of this rank,
/// in whose stream the messages wait for earlier work; it has to live as long. All ranks make it together. Throws
/// Error, on all ranks, if two of them have one device.
std::unique_ptr<Communicator> make_nccl_communicator(Communicator& job, Backend& cuda);

}  // namespace bromwich
