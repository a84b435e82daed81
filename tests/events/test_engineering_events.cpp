// Circuits and machines by located events, each beside the flow of the oracle.

#include "cpu/cpu_backend.hpp"
#include "tests/support/engineering_trial.hpp"

#include <gtest/gtest.h>

namespace bromwich::oracle {
namespace {

struct Drawn {
  const char* name;
  EngineeringScene (*make)(std::uint32_t);
  std::uint32_t seed;
};

class LocatedEngineering : public testing::TestWithParam<Drawn> {};

// Mirrored and in other units too: the basis that goes on may not depend on the order or the scale of the rows.
TEST_P(LocatedEngineering, FollowsTheOracle) {
  constexpr double tolerance = 1e-3;
  Options options;
  options.method = Method::events;
  options.tolerance = tolerance;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const EngineeringScene s = GetParam().make(GetParam().seed);
  const KnownFlow known = known_flow(s, s.x0, s.T, 0.1 * tolerance);
  ASSERT_TRUE(known.decided) << known.reason;
  for (const Telling telling : {Telling::original, Telling::mirrored, Telling::permuted, Telling::other_units}) {
    const EngineeringTrial t = try_engineering(s, known, retold(s, telling, 1), options, *backend, tolerance);
    EXPECT_EQ(t.verdict, "right") << to_string(telling) << ": " << t.reason << ", error " << t.error;
  }
}

// circuit: behind an edge of a gate y_i = w_i = 0 for several i, and only some of these stay zero. sticking: friction
// that sticks where a stop closes. impact: beside a mass at rest, whose velocity is rounding of the terms that hold it.
// unloaded: friction without a normal force at an impact elsewhere, whose force is zero but for rounding of the mode.
// parallel: diodes that share a current in many ways with the same state. resting: at a stop, beside an impact of other
// masses. near_singular: open diodes of megohms beside closed ones of milliohms.
INSTANTIATE_TEST_SUITE_P(
    Degenerate, LocatedEngineering,
    testing::Values(Drawn{"circuit", random_circuit, 33}, Drawn{"sticking", random_masses, 45},
                    Drawn{"impact", random_masses, 121}, Drawn{"impact_beside_rest", random_masses, 76},
                    Drawn{"unloaded", random_masses, 71}, Drawn{"parallel_of_ten", random_circuit, 188},
                    Drawn{"parallel_of_seven", random_circuit, 228}, Drawn{"resting", random_masses, 86},
                    Drawn{"near_singular", random_circuit, 185}),
    [](const auto& one) { return one.param.name; });

}  // namespace
}  // namespace bromwich::oracle
