#include "core/solve/solver.hpp"

#include "core/base/error.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/stages.hpp"

#include <utility>

namespace bromwich {

Solver::Solver(Scene scene, Backend& backend, Options options)
    : scene_(std::move(scene)), backend_(backend), options_{std::move(options)} {
  scene_.validate();
  options_.prepared = std::make_shared<Prepared>();
  if (!options_.tuning.first_iterate) return;
  first_iterate_ = *options_.tuning.first_iterate;
  options_.tuning.first_iterate = &first_iterate_;
}

void Solver::set_x0(const Vector& x0) {
  if (scene_.boundary) throw Error("x0", "is given to a scene with boundary values", "make another solver");
  Vector before = std::exchange(scene_.x0, x0);
  try {
    scene_.validate();
  } catch (...) {  // the scene stays as it was where the change is refused
    scene_.x0 = std::move(before);
    throw;
  }
  scene_.exact = {};
}

void Solver::set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints) {
  Scene changed = scene_;
  changed.f = std::move(f);
  changed.g = std::move(g);
  changed.breakpoints = std::move(breakpoints);
  changed.breakpoints_are_all = false;
  changed.exact = {};
  if (changed.port && changed.f && changed.f_entry != SourceEntry::through_F)
    throw Error("f", "is given to a port-Hamiltonian scene without an input", "state B and u of the system");
  if (changed.port) {  // method goal reads the input there
    PortHamiltonian port = *changed.port;
    port.u = changed.f;
    port.jumps = changed.breakpoints;
    changed.port = std::make_shared<const PortHamiltonian>(std::move(port));
  }
  changed.validate();
  scene_ = std::move(changed);
}

Result Solver::solve() {
  try {
    return solve_valid(scene_, backend_, options_);
  } catch (...) {  // what was kept may be half of this solve and half of the one before
    options_.prepared->methods.reset();
    throw;
  }
}

}  // namespace bromwich
