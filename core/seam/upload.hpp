#pragma once

#include "../scene/separable.hpp"
#include "backend.hpp"

namespace bromwich {

/// Writes the values of a source to the first rows of an array of its width.
inline void upload(Backend& backend, const SampledSource& source, Array& to) {
  source.factored() ? backend.upload_product(source.values(), source.shapes(), to)
                    : backend.upload(source.values(), to);
}

}  // namespace bromwich
