// Shooting over parts of [0, T]: closed forms, and machines whose state circles around an unstable periodic one.

#include "core/shooting/divided_shooting.hpp"

#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "files/scene_file.hpp"
#include "tests/support/engineering_trial.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

// x' = a x + sin(2 pi t) with a constraint that is never active: x(0) = -w / (a^2 + w^2), w = 2 pi.
TEST(DividedShooting, FindsAnUnstablePeriodicState) {
  constexpr double a = 12, w = 2 * 3.14159265358979323846;
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{a}}, Matrix{{1}}, Matrix{{0}}};
  scene.M = Matrix{{1}};
  scene.f = [](double t, Eigen::Ref<Vector> f) { f[0] = std::sin(w * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; };
  scene.T = 1;
  scene.x0 = Vector{{0}};
  EventOptions options;
  options.longest_step = 1.0 / 64;
  const EventSolution guess = integrate_with_events(scene, LcpClass::P, {}, options);
  ASSERT_TRUE(guess.complete) << guess.reason;
  const BoundaryCondition periodic{Matrix{{1}}, Matrix{{-1}}, Vector{{0}}};
  const Vector x0 = shoot_in_parts(scene, periodic, LcpClass::P, {}, options, guess, Vector{{1}});
  ASSERT_EQ(x0.size(), 1);
  // The states between parts fit to 1e-7, of a map that is linear; a change of x(0) is magnified by e^12.
  EXPECT_NEAR(x0[0], -w / (a * a + w * w), 1e-7);
}

// min (dx_1 / 1)^2 + (dx_2 / 2)^2 with dx_1 + dx_2 = 5: dx = (1, 4).
TEST(DividedShooting, TheNearestFeasibleStateCountsInSizes) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(2, 2), Matrix::Zero(2, 1), Matrix{{1, 1}}};
  scene.M = Matrix{{0}};
  scene.T = 1;
  scene.x0 = Vector::Zero(2);
  const Vector z = nearest_feasible(scene, Vector{{-3, -2}}, Vector{{1, 2}});
  EXPECT_NEAR(z[0], -2, 1e-14);
  EXPECT_NEAR(z[1], 2, 1e-14);
  EXPECT_EQ(nearest_feasible(scene, Vector{{3, -2}}, Vector{{1, 2}}), (Vector{{3, -2}}));
}

struct Drawn {
  const char* name;
  std::uint32_t seed;
  oracle::EngineeringScene (*make)(std::uint32_t) = oracle::random_masses;
};

class PeriodicEngineering : public testing::TestWithParam<Drawn> {};

// The oracle integrates one period from the x(0) that was found: it has to come back.
TEST_P(PeriodicEngineering, IsRight) {
  using namespace oracle;
  Options options;
  options.tolerance = 1e-3;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const EngineeringScene s = GetParam().make(GetParam().seed);
  for (const Telling telling : {Telling::original, Telling::other_units}) {
    const EngineeringTrial t = try_periodic(s, retold(s, telling, 1), options, *backend, 1e-3);
    EXPECT_EQ(t.verdict, "right") << to_string(telling) << ": " << t.reason << ", error " << t.error;
    EXPECT_EQ(t.method, "shooting");
  }
}

// stops: between soft stops, without order. threefold: the state settles to three periods. sticking: a mass that
// sticks may stay where it is, and others too. creeping: it stays from a border on. loaded: contacts are closed at the
// ends of periods, with speeds of rounding. resting: nothing moves but by rounding. held, pressed: steps of Newton's
// method leave gaps below zero by rounding. beyond, across: F rises on the way to the piece that has the solution.
// open: a circuit with active sets near singular ones. shorted, idle: y holds the state at zero.
INSTANTIATE_TEST_SUITE_P(Unstable, PeriodicEngineering,
                         testing::Values(Drawn{"stops", 0}, Drawn{"threefold", 21}, Drawn{"sticking", 30},
                                         Drawn{"creeping", 41}, Drawn{"loaded", 62}, Drawn{"resting", 53},
                                         Drawn{"held", 83}, Drawn{"pressed", 192}, Drawn{"beyond", 118},
                                         Drawn{"across", 154}, Drawn{"open", 128, oracle::random_circuit},
                                         Drawn{"shorted", 40, oracle::random_circuit},
                                         Drawn{"idle", 174, oracle::random_circuit}),
                         [](const auto& one) { return one.param.name; });

struct Share {
  const char* name;
  std::uint32_t seed;
  double share;
};

class SharesOfTheEnd : public testing::TestWithParam<Share> {};

// x(0) = share x(T): no period can be passed. The oracle integrates from the x(0) that was found.
TEST_P(SharesOfTheEnd, AreMet) {
  using namespace oracle;
  Options options;
  options.method = Method::shooting, options.tolerance = 1e-3, options.states = StateSelection::all;
  const EngineeringScene s = random_masses(GetParam().seed);
  Scene scene = parse_scene(scene_file(s, true), s.name + ".toml").scene;
  scene.boundary->ET = -GetParam().share * scene.boundary->E0;
  const Result r = solve(scene, *make_cpu_backend(1), options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  const KnownFlow known = known_flow(s, r.x.row(0).transpose(), s.period, 1e-4);
  ASSERT_TRUE(known.decided) << known.reason;
  const Vector off = s.weight.cwiseProduct(r.x.row(0).transpose() - GetParam().share * known.flow.end());
  EXPECT_LE(off.norm(), 1e-3 * s.weight.cwiseProduct(known.flow.end()).norm());
}

// slow: F falls slowly for more than six steps. Others: whole steps find it.
INSTANTIATE_TEST_SUITE_P(Chains, SharesOfTheEnd,
                         testing::Values(Share{"half", 133, 0.5}, Share{"slow", 65, -0.5}, Share{"opposite", 80, -0.5},
                                         Share{"most", 133, 0.9}),
                         [](const auto& one) { return one.param.name; });

}  // namespace
}  // namespace bromwich
