#pragma once

#include "app/columns.hpp"
#include "core/goal/energy_balance.hpp"
#include "core/result/result.hpp"
#include "core/result/switching.hpp"
#include "files/result_file.hpp"

#include <cstdio>

namespace bromwich::app {

/// The energies of a result: of the steps and at the time points.
struct Energies {
  EnergyBalance balance;
  PowerBalance power;
};

/// The columns of --energies.
std::vector<TimeSeries> energy_series(const Energies&);

/// The modes of memories.
std::vector<TimeSeries> mode_series(const Scene&, const Result&);

/// Header `t,` and the names of the columns, and one row per time. Numbers are the shortest decimals that round to the
/// same doubles, `nan` for missing values. With `energies`, the columns energy, supplied_power and dissipated_power at
/// the time, and supplied, dissipated and violation over the step that ends there. `sampled` has the rows: those of
/// `result`, or others; `contacts` what columns of contacts have there. A result that is not solved ends with a
/// comment.
void write_csv(const Scene& scene, const Result& sampled, const Result& result, const std::vector<Column>& columns,
               std::FILE* file, const std::vector<TimeSeries>& contacts = {}, const Energies* energies = nullptr);

/// Header `t,component,on,error` and one row per switch, followed by the same comment. Components have the names of the
/// scene, otherwise their numbers. For relays `t,relay,from,to,error`: lambda is -1, 1, or 0 between them.
void write_switches_csv(const Scene& scene, const std::vector<Switch>& switches, const Result& result, std::FILE* file);

}  // namespace bromwich::app
