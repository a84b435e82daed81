#pragma once
// phi and gamma of a scene file: expressions of t, x and y as functions with exact derivatives.

#include "files/formula.hpp"
#include "nonlinear/nonlinear_scene.hpp"

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

/// Whether it stands for nothing else in expressions.
bool can_be_variable(const std::string& name);

/// Numbers of the variables of formulas: x0, x1, ... and their names from 0, y0, y1, ... and their names from `seen`
/// on. `letter`: that of what the functions see besides y, x or v. A name that can be one is a variable.
std::map<std::string, std::size_t> variables_of(char letter, Index seen, const std::vector<std::string>& x_names,
                                                Index constraints, const std::vector<std::string>& y_names);

/// One entry for each formula; variables 0, ..., seen - 1 are x, those after them y.
struct StateFunctions {
  NonlinearFunction value;
  NonlinearDerivative derivative;
};
StateFunctions state_functions(std::vector<Formula> formulas, Index seen);

}  // namespace bromwich
