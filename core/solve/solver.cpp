#include "core/solve/solver.hpp"

#include "core/base/error.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/engines.hpp"
#include "core/solve/prepared.hpp"

#include <algorithm>
#include <atomic>
#include <utility>

namespace bromwich {

namespace {

constexpr Index values_of_a_thread = 1 << 15;  ///< of x0: 256 KiB, a few times what it costs to wake a thread

}  // namespace

Solver::Solver(Scene scene, Backend& backend, Options options)
    : scene_(std::move(scene)),
      backend_(backend),
      options_(std::make_unique<InnerOptions>(InnerOptions{with_defaults(std::move(options), scene_)})) {
  scene_.validate();
  scene_.dynamics = Dynamics(scene_.dynamics);  // whose values nobody else can change
  options_->prepared = std::make_shared<Prepared>();
  options_->prepared->stated = &scene_;
  options_->family = std::make_shared<GridFamily>(controls_error(*options_));
  if (!options_->tuning.first_iterate) return;
  first_iterate_ = *options_->tuning.first_iterate;
  options_->tuning.first_iterate = &first_iterate_;
}

Solver::~Solver() = default;

void Solver::set_x0(const Vector& x0) {
  if (x0.size() != scene_.states()) return take_x0(next_x0_ = x0);  // it throws
  next_x0_.resize(x0.size());
  std::atomic<bool> valid = true;
  backend_.each_range(x0.size(), values_of_a_thread, [&](Index begin, Index end) {
    constexpr Index together = 512;  // values, looked at while they are in the first cache
    double sum = 0;                  // 0 but for NaN and infinity
    for (Index first = begin; first < end; first += together) {
      const Index count = std::min(together, end - first);
      next_x0_.segment(first, count) = x0.segment(first, count);
      sum += (0 * next_x0_.segment(first, count).array()).sum();
    }
    if (!(sum == 0)) valid = false;
  });
  take_x0(next_x0_, valid);
}

void Solver::set_x0(Vector&& x0) { take_x0(x0); }

void Solver::take_x0(Vector& x0, bool valid) {
  if (scene_.boundary) throw Error("x0", "is given to a scene with boundary values", "make another solver");
  if (!valid) scene_.validate_x0(x0);
  scene_.x0.swap(x0);
  scene_.exact = {};
  options_->prepared->add({true, false});
}

void Solver::set_sources(TimeFunction f, TimeFunction g, std::vector<double> breakpoints, bool breakpoints_are_all) {
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
  scene_.breakpoints_are_all = breakpoints_are_all;
  scene_.no_pulses = false;
  scene_.exact = {};
  if (scene_.port) {  // method goal reads the input there
    PortHamiltonian port = *scene_.port;
    port.u = scene_.f;
    port.jumps = scene_.breakpoints;
    scene_.port = std::make_shared<const PortHamiltonian>(std::move(port));
  }
  options_->prepared->add({false, true});
}

Result Solver::solve() {
  try {
    options_->prepared->end_of_solve();
    return solve_valid(scene_, backend_, *options_);
  } catch (...) {  // what was kept may be half of this solve and half of the one before
    options_->prepared->grids.clear();
    throw;
  }
}

PreparationCounts Solver::made() const { return options_->family->counts(); }

}  // namespace bromwich
