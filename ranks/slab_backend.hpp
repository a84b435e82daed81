#pragma once
// A backend whose arrays are divided into slabs of time, one for each rank; docs/slabs.md has the protocol. All ranks
// run the same solve: what reaches the host is the same on all of them, up to whole results.

#include "../core/seam/backend.hpp"
#include "../core/seam/communicator.hpp"

#include <memory>

namespace bromwich {

/// `local` computes the slab of this rank. The communicator must outlive the backend.
std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, Communicator&);
/// The backend keeps the communicator, which ends before `local`.
std::unique_ptr<Backend> make_slab_backend(std::unique_ptr<Backend> local, std::unique_ptr<Communicator>);

}  // namespace bromwich
