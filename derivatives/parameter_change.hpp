#pragma once
// The change of the data of a scene with a parameter, by central differences of the data,
//
//     d/dp = [8 (v(p+d) - v(p-d)) - (v(p+2d) - v(p-2d))]/(12 d),
//
// for x0, b, the matrices, and the tables of f and g. d is 1e-3 p, or smaller where the data bend on that distance:
// the two-point formula with d has to give the same to 1e-4, so that the error of this one is about 1e-8 or less. Data
// that have a kink at p are refused. Where a source jumps in time, rows beside the jump have the limits of their side,
// and the time of the jump is differentiated too.

#include "../core/goal/quantities.hpp"
#include "../core/kernel/discrete_problem.hpp"
#include "../core/scene/scene.hpp"
#include "kronecker_states.hpp"
#include "solution_derivative.hpp"

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// A scene, and where it states one its quantity of interest.
struct ParameterScene {
  Scene scene;
  std::shared_ptr<const QuantityOfInterest> quantity = {};
};

struct VariedParameter {
  std::string name;
  double value = 0;
  std::function<ParameterScene(double value)> scene_of;  ///< with all other parameters held
};

/// The scenes with parameter p - 2d, p - d, p + d and p + 2d.
struct ParameterNeighbours {
  std::string name;
  double step = 0;  ///< d
  std::array<ParameterScene, 4> at;
  /// Times near which sources have a kink or a jump that moves with the parameter, and how far at most.
  std::vector<double> moving;
  double moved = 0;
  std::vector<MovingJump> jumps;  ///< those with a jump, change: per unit of the parameter
};

/// Per unit of the parameter.
struct ParameterChange {
  DataChange data;
  KroneckerChange sum = {};            ///< of a Kronecker sum that is not written out
  bool of_sum = false;                 ///< whether `sum` is not zero
  std::vector<MovingJump> jumps = {};  ///< times at which f or g jumps
  ChangesInModes in_modes = {};        ///< of a scene with memories, in the modes that were asked for
};

/// `t`: times at which the data are looked at to choose d. `written_out`: A, B, N and E as dense matrices and f with m
/// columns; otherwise f is that of f = B f. Throws Error where the scene for a neighbouring value cannot be made or
/// has other sizes, T, free rows, memories or ends, where jumps of f or g appear or vanish, and where the data are not
/// smooth at p.
ParameterNeighbours neighbours_of(const VariedParameter&, const Scene&, const Vector& t, bool written_out);

/// With tables at the times `t`. `modes`: those of ParameterChange::in_modes. Throws Error where the dynamics change
/// and are not written out, except for what KroneckerChange has.
ParameterChange parameter_change(const ParameterNeighbours&, const Scene&, const Vector& t, bool written_out,
                                 const std::vector<std::vector<Index>>& modes = {});

/// Modes in which each mode of a memory is once; none without memories.
std::vector<std::vector<Index>> each_mode(const Scene&);

}  // namespace bromwich
