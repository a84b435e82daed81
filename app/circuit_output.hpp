#pragma once
// The outputs of a circuit, V(node) and I(element), as the states of a scene without constraints: files, pages and
// columns of results take them as they take any states.

#include "circuits/circuit.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// Names, units and T; its dynamics do nothing.
Scene output_scene(const Circuit&);

/// The rows of a result with all states.
Result output_result(const Circuit&, const Result&);

}  // namespace bromwich::app
