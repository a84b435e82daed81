#pragma once
// What the rows of one grid say against themselves, for dense scenes, without another solve.
//
// Local errors: the step of 2h from t_{j-1} to t_{j+1}, with F = B y + phi linear between its ends, differs from the
// two steps of h that were taken by
//
//     τ_j = (L' - E L) F_{j-1} - (E W + L) F_j + (W' - W) F_{j+1}
//
// with E, L, W of h and L', W' of 2h (exponential_step.hpp). Of order 2, this is 8 - 2 parts of an error of which the
// two steps have 2: τ_j / 3. Where y may jump it does so somewhere in a step, which x knows to h B |y_j - y_{j-1}| / 2.
//
// Contacts: a force that acts for a step or two and moves the state, and w that falls towards 0 on one side of a step
// and rises on the other, so steeply that the lines meet below 0.

#include "bromwich/nonlinear.hpp"
#include "nonlinear_scene.hpp"

#include <string>
#include <vector>

namespace bromwich {

/// Why half the step should confirm a result; empty if nothing speaks against it. `breaks`: where steps were divided,
/// which are not looked at. The scene is one of in_states with dense matrices, the result solved.
std::string doubts_of(const NonlinearScene&, const NonlinearResult&, const std::vector<double>& breaks);

}  // namespace bromwich
