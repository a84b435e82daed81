#pragma once
// Structures with contacts of the tests, and their solution by located events.

#include "tests/mechanics/structures.hpp"
#include "tests/support/run.hpp"

namespace bromwich {

/// By located events, with all states.
inline Result located(const Scene& scene) {
  Options options = options_for(scene.boundary ? Method::shooting : Method::events);
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r;
}

inline Vector last_state(const Result& r) { return r.x.row(r.x.rows() - 1).transpose(); }

}  // namespace bromwich
