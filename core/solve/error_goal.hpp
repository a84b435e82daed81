#pragma once
// The goal of error control, and the sizes in which errors are measured.

#include "../accuracy/convergence.hpp"
#include "../result/inner_options.hpp"
#include "../scene/scene.hpp"

namespace bromwich {

/// Tolerances of y and of the states; 0 where a kind is not controlled.
struct ErrorGoal {
  double y, x;

  explicit ErrorGoal(const Options&);
  double smallest() const;
};

inline constexpr double assumed_tolerance = 1e-4;  ///< of located events where none is given

/// The sizes to which errors of components are compared: relative, absolute, or in the units of the scene.
ComponentSizes sizes_for(const Scene&, const InnerOptions&);

}  // namespace bromwich
