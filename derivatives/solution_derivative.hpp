#pragma once

#include "../core/result/result.hpp"
#include "../core/scene/scene.hpp"
#include "bromwich/derivative.hpp"
#include "set_margin.hpp"
#include "set_responses.hpp"

namespace bromwich {

/// Leaves out of a gradient what moves w(0) = N x0 + M y_0 + g_0: x0, g, N unless x0 is 0, and M unless y_0 is.
void leave_out_start(DataChange& gradient, const Vector& x0, const RowMatrix& y);

}  // namespace bromwich
