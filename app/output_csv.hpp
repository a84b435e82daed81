#pragma once

#include "core/goal/energy_balance.hpp"
#include "core/result/result.hpp"
#include "core/result/switching.hpp"

#include <cstdio>

namespace bromwich::app {

/// The energies of a result: of the steps and at the time points.
struct Energies {
  EnergyBalance balance;
  PowerBalance power;
};

/// Header `t,y0,...,x<component>,...` and one row per time. Numbers are the shortest decimals that round to the same
/// doubles, `nan` for missing values. `constraints` columns of y are written even if the result has none. With
/// `energies`, the columns energy, supplied_power and dissipated_power at the time, and supplied, dissipated and
/// violation over the step that ends there.
void write_csv(const Result& result, Index constraints, std::FILE* file, const Energies* energies = nullptr);
/// The same for the rows of `sampled`, at other times than those of `result`.
void write_csv(const Result& sampled, const Result& result, Index constraints, std::FILE* file,
               const Energies* energies = nullptr);

/// Header `t,component,on,error` and one row per switch, followed by the same comment.
void write_switches_csv(const std::vector<Switch>& switches, const Result& result, std::FILE* file);

}  // namespace bromwich::app
