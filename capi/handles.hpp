#pragma once
// What the handles of the C interface point to.

#include "bromwich/bromwich.h"
#include "circuits/circuit.hpp"
#include "core/solve/solver.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::capi {

/// A, B, N or E as it was given.
struct GivenMatrix {
  Matrix dense;
  std::optional<SparseMatrix> sparse;
};

/// f or g as it was given, with the times at which it may jump or have a kink; `all`: there are no others.
struct GivenSource {
  TimeFunction function;
  std::vector<double> kinks;
  bool all = true;
};

}  // namespace bromwich::capi

struct bromwich_scene {
  /// Its dynamics are made when they are needed first, and shared by copies.
  mutable bromwich::Scene scene;
  std::shared_ptr<const bromwich::Circuit> circuit;  ///< of a netlist
  bool own = false;                                  ///< made by bromwich_scene_new
  mutable bool stale = false;                        ///< a matrix was set since the dynamics were made
  bromwich::capi::GivenMatrix A, B, N, E;            ///< of an own scene
  bromwich::capi::GivenSource f, g;
  std::vector<double> kinks;  ///< of a scene that was read, or as they were set
  bool kinks_are_all = true;

  const bromwich::Scene& complete() const;
};

struct bromwich_result {
  bromwich::Result result;
  bromwich::Scene scene;
  std::shared_ptr<const bromwich::Circuit> circuit;
  std::shared_ptr<bromwich::Backend> backend;
  bromwich::Options options;  ///< without functions of the caller
  std::optional<bromwich::RowMatrix> w, integral, switches, outputs;
};
