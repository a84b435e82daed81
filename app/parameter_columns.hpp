#pragma once
// Parameters of a scene, and derivatives of columns of output with respect to them.

#include "app/columns.hpp"
#include "app/scene_choice.hpp"
#include "derivatives/parameter_derivative.hpp"

#include <string>
#include <vector>

namespace bromwich::app {

/// Names among the parameters of a scene, "R,C". Throws Error, naming `argument`, for unknown and repeated ones.
std::vector<std::string> parse_parameters(const std::string& argument, const std::string& words,
                                          const ParameterValues& parameters);

/// The parameter `name` of the scene of `source` with these settings.
VariedParameter scene_parameter(SceneSource& source, const ParameterValues& settings, const std::string& name,
                                double value);

/// A column of a change of the solution, linear between the times `t` of its rows, at other times. For N x: N does not
/// change.
Vector column_of(const SolutionChange&, const Vector& t, const Scene&, const Column&, const std::vector<double>& at);

}  // namespace bromwich::app
