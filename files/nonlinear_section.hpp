#pragma once
// The section [nonlinear] of a scene file.

#include "files/sections.hpp"
#include "nonlinear/nonlinear_scene.hpp"

#include <optional>

namespace bromwich {

/// phi and gamma as functions of x, or of v = N x, of y and of t, beside the linear scene of the other sections; empty
/// without the section.
std::optional<NonlinearScene> read_nonlinear(const Sections&, const Scene& linear);

}  // namespace bromwich
