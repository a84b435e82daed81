#pragma once
// The parts of the extension module.

#include "core/goal/goal.hpp"
#include "core/scene/scene.hpp"

#include <nanobind/nanobind.h>

#include <memory>

namespace bromwich::python {

namespace nb = nanobind;

/// A scene as Python holds it; a solve and its result share it.
struct Model {
  Scene scene;
  std::shared_ptr<const QuantityOfInterest> quantity;  ///< of method goal, where a file states one
};

void bind_errors(nb::module_& m);
void bind_sources(nb::module_& m);
void bind_scenes(nb::module_& m);
void bind_results(nb::module_& m);
void bind_solving(nb::module_& m);

}  // namespace bromwich::python
