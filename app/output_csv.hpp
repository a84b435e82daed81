#pragma once

#include "core/result.hpp"
#include "core/switching.hpp"

#include <cstdio>

namespace bromwich::app {

/// Header `t,y0,...,x<component>,...` and one row per time; shortest decimals that give the same doubles back, `nan`
/// where there is no value. `constraints` columns of y are written even where the result holds none.
void write_csv(const Result& result, Index constraints, std::FILE* file);

/// Header `t,component,on,error` and one row per switch.
void write_switches_csv(const std::vector<Switch>& switches, std::FILE* file);

}  // namespace bromwich::app
