#include "core/solve/solver.hpp"

#include "core/base/error.hpp"
#include "core/solve/prepared.hpp"

#include <utility>

namespace bromwich {

Solver::Solver(Scene scene, Backend& backend, Options options)
    : scene_(std::move(scene)), backend_(backend), options_(std::move(options)) {
  scene_.validate();
  options_.prepared = std::make_shared<Prepared>();
}

// The scene stays as it was where the change is refused.
void Solver::change(Scene changed) {
  changed.exact = {};
  changed.validate();
  scene_ = std::move(changed);
}

void Solver::set_x0(const Vector& x0) {
  if (scene_.boundary) throw Error("x0", "is given to a scene with boundary values", "make another solver");
  Scene changed = scene_;
  changed.x0 = x0;
  change(std::move(changed));
}

void Solver::set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints) {
  Scene changed = scene_;
  changed.f = std::move(f);
  changed.g = std::move(g);
  changed.breakpoints = std::move(breakpoints);
  changed.breakpoints_are_all = false;
  change(std::move(changed));
}

Result Solver::solve() { return bromwich::solve(scene_, backend_, options_); }

}  // namespace bromwich
