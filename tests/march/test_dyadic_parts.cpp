// Parts of steps of sparse scenes and Kronecker sums.

#include "core/march/dyadic_parts.hpp"

#include "core/kernel/discretise.hpp"
#include "tests/support/run.hpp"

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace bromwich {
namespace {

constexpr double unit = 0x1p-18;  // of a step

// x_i' = -x_i + y_i, f and g as given; k > 64 constraints never matter here.
Scene scene_with(const TimeFunction& f, const TimeFunction& g, std::vector<double> breakpoints) {
  SparseDynamics d;
  d.A.resize(1, 1), d.B.resize(1, 1), d.N.resize(1, 1);
  d.A.insert(0, 0) = -1, d.B.insert(0, 0) = 1, d.N.insert(0, 0) = 1;
  Scene scene;
  scene.dynamics = d;
  scene.M = Matrix{{1}};
  scene.f = f;
  scene.g = g;
  scene.breakpoints = std::move(breakpoints);
  scene.breakpoints_are_all = true;
  scene.x0 = Vector::Zero(1);
  scene.T = 1;
  return scene;
}

struct Parts {
  std::vector<DyadicPart> all;
  std::set<double> lengths;
};

Parts parts_of(const Scene& scene, Index J, bool from_start = false) {
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem p = discretise(scene, *backend, J);
  DyadicParts parts(p, from_start, false);
  Parts found;
  for (Index j = 1; j <= J; ++j)
    for (const DyadicPart& part : parts.of(j, {}, false)) {
      found.all.push_back(part);
      found.lengths.insert(part.length);
    }
  return found;
}

// Whatever the jumps: parts follow each other from 0 to T, there are at most 19 lengths h 2^-k, sources are looked at
// from where the part before ended or behind a jump there, and no jump lies inside of where a part looks.
TEST(DyadicParts, CoverTheStepsWithFewLengths) {
  std::mt19937 random(1);
  for (int round = 0; round < 50; ++round) {
    std::uniform_real_distribution<double> anywhere(0, 1);
    std::vector<double> jumps(std::size_t(1 + round % 7));
    for (double& t : jumps) t = anywhere(random);
    std::sort(jumps.begin(), jumps.end());
    const auto g = [jumps](double t, Eigen::Ref<Vector> v) {
      v[0] = double((std::upper_bound(jumps.begin(), jumps.end(), t) - jumps.begin()) % 2);
    };
    constexpr Index J = 16;
    const Parts parts = parts_of(scene_with({}, g, jumps), J);
    EXPECT_LE(parts.lengths.size(), 19u);
    for (const double length : parts.lengths) {
      const double octave = std::log2(length * J);
      EXPECT_NEAR(octave, std::round(octave), 1e-9);
    }
    double end = 0, seen = 0;
    for (const DyadicPart& part : parts.all) {
      EXPECT_NEAR(part.end - part.length, end, 1e-14);
      EXPECT_NEAR(part.to - part.from, part.length, 2 * unit / J);
      EXPECT_NEAR(part.to, part.end, unit / J);
      EXPECT_NEAR(part.from, seen, 1e-14);  // these jumps are far apart: nothing is passed over
      for (const double t : jumps) EXPECT_FALSE(t > part.from + 1e-13 && t < part.to - 1e-13) << t;
      end = part.end;
      seen = part.to;
    }
    EXPECT_NEAR(end, 1, 1e-14);
  }
}

// Behind a jump a part is at most a quarter of its distance to it, in the next steps too; kinks make no such parts.
TEST(DyadicParts, GrowBehindJumps) {
  constexpr Index J = 400;
  const double at = 0.30999;  // just before a point of the grid
  const auto jump = [at](double t, Eigen::Ref<Vector> v) { v[0] = t < at ? -1 : 1; };
  const auto kink = [at](double t, Eigen::Ref<Vector> v) { v[0] = std::abs(t - at); };
  for (const bool in_f : {false, true}) {
    const Parts parts = parts_of(in_f ? scene_with(jump, {}, {at}) : scene_with({}, jump, {at}), J);
    Index layer = 0;
    for (const DyadicPart& part : parts.all) {
      const double behind = part.end - part.length - at;
      if (behind < unit / J) continue;
      EXPECT_LE(part.length, std::max(unit / J, 0.25 * (behind + unit / J)) * (1 + 1e-9));
      layer += part.length < 0.99 / J;
    }
    EXPECT_GE(layer, 18 * 4 - 8);
  }
  EXPECT_LE(Index(parts_of(scene_with({}, kink, {at}), J).all.size()), J + 2 * 10);
  // Where grids are compared, the first step is the begin of a layer.
  EXPECT_LE(parts_of(scene_with({}, jump, {at}), J, true).all.front().length, unit / J * (1 + 1e-9));
}

// A pulse shorter than a unit is a part: it may move the state. A jump that takes a while, less than a unit, is not.
TEST(DyadicParts, KeepPulsesShorterThanAUnit) {
  constexpr Index J = 10;
  const double at = 0.123, wide = 1e-8;
  const auto pulse = [=](double t, Eigen::Ref<Vector> v) { v[0] = t > at && t < at + wide ? -5 : 1; };
  const auto ramp = [=](double t, Eigen::Ref<Vector> v) { v[0] = std::clamp((t - at) / wide, 0.0, 1.0); };
  const auto inside = [=](const DyadicPart& part) {
    return std::abs(part.from - at) < 1e-12 && std::abs(part.to - at - wide) < 1e-12;
  };
  const Parts with_pulse = parts_of(scene_with({}, pulse, {at, at + wide}), J),
              with_ramp = parts_of(scene_with({}, ramp, {at, at + wide}), J);
  EXPECT_EQ(std::count_if(with_pulse.all.begin(), with_pulse.all.end(), inside), 1);
  EXPECT_EQ(std::count_if(with_ramp.all.begin(), with_ramp.all.end(), inside), 0);
}

}  // namespace
}  // namespace bromwich
