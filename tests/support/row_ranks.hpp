#pragma once
// A backend with the operations on rows that a device has (core/seam/slab_operations.hpp), by naive loops, and ranks
// whose rows travel between such backends: what divides the time points of devices runs without one.

#include "core/seam/backend.hpp"
#include "core/seam/communicator.hpp"

#include <memory>

namespace bromwich {

/// The reference backend, whose arrays are not in reach of the host, with those operations. It records like a device:
/// Error if recorded operations read or write values of the host.
std::unique_ptr<Backend> make_row_backend();

/// A rank whose rows travel between such backends, by way of `host`.
std::unique_ptr<Communicator> make_row_rank(Communicator& host);

/// Divides such backends among the ranks; rows travel as arrays.
std::unique_ptr<Backend> make_backend_over_rows(Communicator& ranks);

}  // namespace bromwich
