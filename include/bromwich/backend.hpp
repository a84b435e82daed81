#pragma once

#include <memory>
#include <type_traits>

namespace bromwich {

/// A machine with its memory, on which scenes are solved: one of make_cpu_backend (cpu/cpu_backend.hpp) or
/// make_cuda_backend (kernels/cuda_backend.hpp).
class Backend;

}  // namespace bromwich

/// Deletes a backend where its class is known.
template <>
struct std::default_delete<bromwich::Backend> {
  default_delete() = default;
  template <class Derived>
  requires std::is_convertible_v<Derived*, bromwich::Backend*> default_delete(const std::default_delete<Derived>&)
  noexcept {}
  void operator()(bromwich::Backend*) const;
};
