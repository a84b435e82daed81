#pragma once
// The solution of an engineering scene by steps that hold no basis: SDIRK of order 2, stiffly accurate, whose every
// stage is a complementarity problem, with steps halved where two halves differ from one whole, and implicit Euler
// where x jumps. Slower and less accurate than switched_flow, but it needs no events, and passes where they accumulate.

#include "tests/support/switched_flow.hpp"

namespace bromwich::oracle {

struct StageSteps {
  double error = 1e-9;        ///< of a step, relative to the largest values so far
  double shortest = 1e-8;     ///< steps, relative to the shortest time of a source
  double resistance = 1e-14;  ///< added to the diagonal of M, relative to what else limits y: diodes side by side then
                              ///< share their current in one way
  long most = 400000;         ///< steps after which the flow is undecided
};

Flow stepped_flow(const EngineeringScene&, const Vector& x0, double T, const StageSteps& = {});

}  // namespace bromwich::oracle
