#pragma once
// Arrays of other libraries where they lie, handed over by DLPack: on the host or on a CUDA device.

#include "core/base/error.hpp"
#include "core/seam/shared_memory.hpp"
#include "machine.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <memory>
#include <string>
#include <vector>

namespace bromwich::python {

namespace nb = nanobind;

/// Float64, row by row, wherever it lies.
using AnyTable = nb::ndarray<const double, nb::ndim<2>, nb::c_contig>;

inline SharedMemory& shared(Machine& machine) {
  if (auto* memory = dynamic_cast<SharedMemory*>(machine.backend.get())) return *memory;
  throw Error("backend", "found '" + machine.backend->name() + "', whose memory is its own", "use cpu or cuda");
}

/// Memory of the host is read by the processor alone, that of a device by that device alone.
inline void check_place(const SharedMemory::Place& place, int kind, int number, const std::string& name) {
  const bool of_host = kind != 2;
  if (of_host == (place.kind != 2) && (of_host || number == place.number)) return;
  throw Error(name, of_host ? "lies on the host" : "lies on CUDA device " + std::to_string(number),
              place.kind == 2 ? "put it on CUDA device " + std::to_string(place.number) + ", or use backend='cpu'"
                              : "use backend='cuda', or copy it to the host");
}

/// A DLPack array of these numbers, which live as long as their owner does.
template <class Owner>
nb::ndarray<double> handed_over(const std::shared_ptr<Owner>& owner, double* numbers, const std::vector<Index>& shape,
                                const SharedMemory::Place& place) {
  auto* kept = new std::shared_ptr<Owner>(owner);
  const nb::capsule keeper(kept, [](void* p) noexcept { delete static_cast<std::shared_ptr<Owner>*>(p); });
  const std::vector<std::size_t> sizes(shape.begin(), shape.end());
  return {numbers, sizes.size(), sizes.data(), keeper, nullptr, nb::dtype<double>(), place.kind, place.number};
}

}  // namespace bromwich::python
