#include "core/solve/solver.hpp"

#include "core/base/error.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/prepared.hpp"

#include <atomic>
#include <utility>

namespace bromwich {

Solver::Solver(Scene scene, Backend& backend, Options options)
    : scene_(std::move(scene)), backend_(backend), options_(std::move(options)) {
  scene_.validate();
  options_.prepared = std::make_shared<Prepared>();
  options_.prepared->stated = &scene_;
  if (!options_.first_iterate) return;
  first_iterate_ = *options_.first_iterate;
  options_.first_iterate = &first_iterate_;
}

void Solver::set_x0(const Vector& x0) {
  if (scene_.boundary) throw Error("x0", "is given to a scene with boundary values", "make another solver");
  constexpr Index together = 1 << 15;  // values, by one thread
  std::atomic<bool> finite = true;
  backend_.each_range(x0.size(), together, [&](Index first, Index last) {
    if ((0 * x0.segment(first, last - first).array()).sum() != 0) finite = false;  // NaN is not 0 either
  });
  if (x0.size() != scene_.states() || !finite) scene_.validate_x0(x0);  // it throws
  backend_.each_range(x0.size(), together, [&](Index first, Index last) {
    scene_.x0.segment(first, last - first) = x0.segment(first, last - first);
  });
  scene_.exact = {};
  options_.prepared->changes.x0 = true;
}

void Solver::set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints) {
  if (scene_.port && f && scene_.f_entry != SourceEntry::through_F)
    throw Error("f", "is given to a port-Hamiltonian scene without an input", "state B and u of the system");
  const auto exchange = [&] {
    std::swap(scene_.f, f);
    std::swap(scene_.g, g);
    std::swap(scene_.breakpoints, breakpoints);
  };
  exchange();
  try {
    scene_.validate_sources();
  } catch (...) {  // the scene stays as it was where the change is refused
    exchange();
    throw;
  }
  scene_.breakpoints_are_all = false;
  scene_.exact = {};
  if (scene_.port) {  // method goal reads the input there
    PortHamiltonian port = *scene_.port;
    port.u = scene_.f;
    port.jumps = scene_.breakpoints;
    scene_.port = std::make_shared<const PortHamiltonian>(std::move(port));
  }
  options_.prepared->changes.sources = true;
}

Result Solver::solve() {
  try {
    return bromwich::solve(scene_, backend_, options_);
  } catch (...) {  // what was kept may be half of this solve and half of the one before
    options_.prepared->methods.reset();
    throw;
  }
}

}  // namespace bromwich
