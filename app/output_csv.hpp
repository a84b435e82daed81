#pragma once

#include "core/result.hpp"

#include <cstdio>

namespace bromwich::app {

/// Header `t,y0,...,x<component>,...` and one row per time; shortest decimals that give the same doubles back, `nan`
/// where there is no value. `constraints` columns of y are written even where the result holds none.
void write_csv(const Result& result, Index constraints, std::FILE* file);

}  // namespace bromwich::app
