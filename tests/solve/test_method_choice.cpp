// The order in which `auto` tries the methods. `bench auto` measures the quality of the predictions.

#include "catalogue/catalogue.hpp"
#include "core/solve/method_choice.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

constexpr Index many = 1 << 16;

Scene heated(double Q) { return make_scene("signorini", {{"Q", Q}}); }

TEST(MethodChoice, TriesEachMethodOnceAndImplicitEulerLast) {
  for (const double Q : {7., 127., 511., 1500.})
    for (const Index J : {17, 64, 4096})
      for (const BackendTraits& traits : {cpu_traits(), cuda_traits()}) {
        std::vector<Method> methods = methods_by_time(traits, heated(Q), LcpClass::P, J);
        EXPECT_EQ(methods.back(), Method::euler);
        EXPECT_TRUE(std::count(methods.begin(), methods.end(), Method::march));
        EXPECT_TRUE(std::count(methods.begin(), methods.end(), Method::contour));
        std::sort(methods.begin(), methods.end());
        EXPECT_EQ(std::unique(methods.begin(), methods.end()), methods.end()) << Q << ' ' << J;
      }
}

TEST(MethodChoice, MarchesOnAProcessorAndWhereNothingIsKnown) {
  for (const Index J : {16, 4096, int(many)})
    EXPECT_EQ(methods_by_time(cpu_traits(), heated(511), LcpClass::P, J).front(), Method::march);
  for (const char* name : {"dlcp-small", "bridge"}) {
    const Scene scene = make_scene(name, {});
    EXPECT_EQ(methods_by_time(cuda_traits(), scene, LcpClass::unknown, many).front(), Method::march) << name;
    EXPECT_TRUE(std::isinf(predicted_seconds(cuda_traits(), scene, LcpClass::P, Method::march, many))) << name;
    EXPECT_FALSE(faster_on_device(cuda_traits(), cpu_traits(), scene, Method::automatic, many, true)) << name;
  }
  EXPECT_EQ(methods_by_time(cuda_traits(), heated(511), LcpClass::Z, many).front(), Method::march)
      << "fitted to class P";
}

// On a device a step of a march is bound by the start of its kernels; cycles need J / 4 steps on their third grid.
TEST(MethodChoice, CyclesOnFacesOnADevice) {
  const Scene small = make_scene("signorini3d", {{"Q", 15}}), large = make_scene("signorini3d", {{"Q", 63}});
  for (const Index J : {64, 1024, int(many)})
    EXPECT_EQ(methods_by_time(cpu_traits(), large, LcpClass::P, J).front(), Method::march);
  EXPECT_EQ(methods_by_time(cuda_traits(), large, LcpClass::P, 1024).front(), Method::multigrid);
  EXPECT_EQ(methods_by_time(cuda_traits(), small, LcpClass::P, 64).front(), Method::march) << "no coarser grids";
  EXPECT_TRUE(faster_on_device(cuda_traits(), cpu_traits(), large, Method::automatic, many, false));
  EXPECT_FALSE(faster_on_device(cuda_traits(), cpu_traits(), small, Method::automatic, 64, false));
}

TEST(MethodChoice, PredictionsGrowWithTheScene) {
  for (const Method method : {Method::march, Method::contour, Method::multigrid})
    for (const double Q : {15., 127., 511.})
      for (const Index J : {256, 4096}) {
        const double seconds = predicted_seconds(cuda_traits(), heated(Q), LcpClass::P, method, J);
        EXPECT_LT(seconds, predicted_seconds(cuda_traits(), heated(Q + 8), LcpClass::P, method, J));
        EXPECT_LT(seconds, predicted_seconds(cuda_traits(), heated(Q), LcpClass::P, method, 2 * J));
      }
}

TEST(MethodChoice, TakesGridsThatCanBeHalvedForMultigridOnly) {
  const auto offers = [](Index J) {
    const std::vector<Method> methods = methods_by_time(cuda_traits(), heated(511), LcpClass::P, J);
    return std::count(methods.begin(), methods.end(), Method::multigrid) == 1;
  };
  EXPECT_TRUE(offers(4096));
  EXPECT_FALSE(offers(4095));
  EXPECT_FALSE(offers(4098)) << "one halving is too few";
  EXPECT_FALSE(offers(128));
}

TEST(MethodChoice, ADeviceHasToPayForItsStart) {
  const Scene small = heated(15), large = heated(511);
  EXPECT_FALSE(faster_on_device(cuda_traits(), cpu_traits(), small, Method::automatic, 64, true));
  EXPECT_TRUE(faster_on_device(cuda_traits(), cpu_traits(), large, Method::automatic, many, false));
  bool warm = false, cold = false;
  for (Index J = 64; J <= many; J *= 2) {
    const bool now = faster_on_device(cuda_traits(), cpu_traits(), large, Method::automatic, J, true),
               first = faster_on_device(cuda_traits(), cpu_traits(), large, Method::automatic, J, false);
    EXPECT_TRUE(now || !first) << J;
    EXPECT_TRUE(now || !warm) << J << ": once faster, always faster";
    EXPECT_TRUE(first || !cold) << J;
    warm = now;
    cold = first;
  }
  EXPECT_FALSE(faster_on_device(cuda_traits(), cpu_traits(), large, Method::euler, many, true));
}

}  // namespace
}  // namespace bromwich
