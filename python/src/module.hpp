#pragma once
// The parts of the extension module.

#include "callable.hpp"
#include "core/dynamics/rectangle.hpp"
#include "core/goal/goal.hpp"
#include "core/scene/scene.hpp"

#include <nanobind/nanobind.h>

#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich::python {

/// A scene as Python holds it; a solve and its result share it. Made by make_shared, so that they hold it and not its
/// Python object, which the collector of cycles could not see.
struct Source;

struct Model : std::enable_shared_from_this<Model> {
  Model() = default;
  explicit Model(Scene stated, std::shared_ptr<const QuantityOfInterest> of_file = {})
      : scene(std::move(stated)), quantity(std::move(of_file)) {}

  Scene scene;
  std::shared_ptr<const QuantityOfInterest> quantity = {};  ///< of method goal, where a file states one
  std::optional<Rectangle> rectangle = {};                  ///< whose points the states are, if it is known
  /// What its functions call, for the collector of cycles: an object whose method is a source, and which has the scene.
  std::vector<Kept> callables = {};
  /// Before a solve: a function of Python may have changed since the last one.
  std::vector<std::function<void()>> forget = {};
  /// As they were given, for pickle; null in scenes that were not stated by arrays, and without a source.
  std::shared_ptr<const Source> f = {}, g = {};
  std::vector<double> declared = {};             ///< breakpoints that were given
  Kept shifted = {}, mass = {};                  ///< of supplied dynamics
  bool other_x0 = false, other_sources = false;  ///< than the scene has, in results of a Solver
};

nb::dict dict_of(const Certificate&);

void bind_arrays(nb::module_& m);
void bind_batch(nb::module_& m);
void bind_circuits(nb::module_& m);
void bind_continuation(nb::module_& m);
void bind_derivatives(nb::module_& m);
void bind_errors(nb::module_& m);
void bind_inversion(nb::module_& m);
void bind_lcp(nb::module_& m);
void bind_mechanics(nb::module_& m);
void bind_memories(nb::module_& m);
void bind_nonlinear(nb::module_& m);
void bind_sources(nb::module_& m);
void bind_scenes(nb::module_& m);
void bind_ranks(nb::module_& m);
void bind_report(nb::module_& m);
void bind_results(nb::module_& m);
void bind_scene_arrays(nb::module_& m);
void bind_solving(nb::module_& m);
void bind_state(nb::module_& m);

}  // namespace bromwich::python
