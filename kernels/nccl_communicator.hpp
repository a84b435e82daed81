#pragma once
// Ranks with a device each: rows of arrays travel from device to device by NCCL, in the stream of the backend. Numbers
// of the host, which are few, go the way of the job that brings the ranks together.

#include "core/seam/communicator.hpp"
#include "core/seam/shared_memory.hpp"

#include <memory>

namespace bromwich {

/// `job`: the same ranks; it has to live as long. `place`: of the backend of this rank, whose stream has to live as
/// long too. All ranks make it together. Throws Error, on all ranks, if two of them have one device.
std::unique_ptr<Communicator> make_nccl_communicator(Communicator& job, const SharedMemory::Place& place);

/// What the part bromwich_nccl.so offers (files/loaded_part.hpp).
struct NcclPart {
  decltype(&make_nccl_communicator) make;
};

}  // namespace bromwich
