// Rows of results where sources jump and states start on, below and beside constraints.

#include "files/scene_file.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <string>

namespace bromwich {
namespace {

Result solved(const std::string& toml, Method method, Index steps = 100) {
  Options options = options_for(method, steps);
  options.states = StateSelection::all;
  return run(parse_scene(toml, "rows.toml").scene, options);
}

// w and y of each row are of one side: the complementarity of rows is met to rounding, at T too, where e jumps by 0.15.
TEST(LocatedRows, AreOfOneSideWhereSourcesJump) {
  const std::string text =
      "[dynamics]\nA = [[-1]]\nB = [[1]]\nx0 = [0.5]\n[relay]\nC = [[1]]\ne = [\"-0.4 - 0.3*mod(t, 0.5)\"]\n"
      "[time]\nT = 2\nsteps = 100\n";
  const Result r = solved(text, Method::events);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(r.residual, 1e-12);
}

// The same for a periodic state, whose period ends with an edge of the source. A capacitor behind a resistance is
// charged while u = 1, half of each period: x(0) = (1 - q) q / (1 - q^2) with q = e^{-1/2}.
TEST(LocatedRows, OfPeriodicStatesToo) {
  const std::string text =
      "[dynamics]\nA = [[-1]]\nB = [[1]]\nf = [\"pulse(t, 1, 0.5)\"]\n[boundary]\nE0 = [[1]]\nET = [[-1]]\nb = [0]\n"
      "[complementarity]\nN = [[1]]\nM = [[1]]\ng = [\"pulse(t, 1, 0.5)\"]\n[time]\nT = 1\nsteps = 50\n";
  const Result r = solved(text, Method::shooting, 50);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_LE(r.residual, 1e-12);
  const double q = std::exp(-0.5);
  EXPECT_NEAR(r.x(0, 0), (1 - q) * q / (1 - q * q), 1e-10);
}

// A mass on the ground, put a rounding below it: it rests there, pressed by 9.81. With 1 to 20 steps.
TEST(LocatedRows, ARoundingBelowAConstraintIsOnIt) {
  for (const char* x : {"-1.4e-17", "0"})
    for (const Method method : {Method::events, Method::march, Method::euler})
      for (const Index steps : {1, 5, 20}) {
        const Result r =
            solved(std::string("[dynamics]\nA = [[0, 1], [-1, -0.1]]\nB = [[0], [1]]\nf = [0, -9.81]\nx0 = [") + x +
                       ", -2.07]\n[complementarity]\nN = [[1, 0]]\nM = [[0]]\n[time]\nT = 0.5\n",
                   method, steps);
        ASSERT_EQ(r.status, Status::solved) << x << " " << to_string(method) << " " << steps << ": " << r.reason;
        EXPECT_NEAR(r.x(r.steps, 0), 0, 1e-12);
        if (method == Method::events) {
          EXPECT_NEAR(r.y(r.steps, 0), 9.81, 1e-9);
        }
      }
}

// x0 = -1 behind x >= 0: x jumps to 0, and stays there since x' = -x - 1 + y. Behind the jump y = 1; the row has what a
// short part says, off by its length.
TEST(LocatedRows, TheFirstOneIsBehindAnImpulse) {
  for (const Method method : {Method::events, Method::march}) {
    const Result r = solved(
        "[dynamics]\nA = [[-1]]\nB = [[1]]\nf = [-1]\nx0 = [-1]\n[complementarity]\nN = [[1]]\nM = [[0]]\n[time]\nT = "
        "1\n",
        method);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_NEAR(r.y(0, 0), 1, 1e-3) << to_string(method);
  }
}

// A mains bridge whose open diodes have 1e9 ohm: an integration whose own estimate of its error is above one is no
// solution.
TEST(LocatedRows, AnErrorAboveOneIsNotSolved) {
  const std::string text =
      "[definitions]\nu0 = \"325.269*sin(2*pi*50*t)\"\nu1 = \"325.269*sin(2*pi*50*t - 2.0943951023931953)\"\n"
      "u2 = \"325.269*sin(2*pi*50*t + 2.0943951023931953)\"\n[dynamics]\n"
      "A = [[-5.00000075, -5.00000075, 0, 0], [-5.00000075, -5.00000075, 0, 0], [0, 0, -100000000099.99998, 0], "
      "[0, 0, 0, -100000000100.0]]\n"
      "B = [[250, 250, 250, 250, 250, 250], [250, 250, 250, 250, 250, 250], [-33333333333.333332, 66666666666.666664, "
      "-33333333333.333332, 33333333333.333332, -66666666666.666664, 33333333333.333332], [-33333333333.333332, "
      "-33333333333.333332, 66666666666.666664, 33333333333.333332, 33333333333.333332, -66666666666.666664]]\n"
      "f = [0, 0, \"(-u0 + 2*u1 - u2)*66.66666666666667\", \"(-u0 - u1 + 2*u2)*66.66666666666667\"]\nx0 = [0, 0, 0, "
      "0]\n"
      "[complementarity]\n"
      "N = [[0.5, 0.5, 5e8, 5e8], [0.5, 0.5, -5e8, 0], [0.5, 0.5, 0, -5e8], [0.5, 0.5, -5e8, -5e8], [0.5, 0.5, 5e8, "
      "0], "
      "[0.5, 0.5, 0, 5e8]]\n"
      "M = [[500000000.01, 0, 0, -5e8, 0, 0], [0, 500000000.01, 0, 0, -5e8, 0], [0, 0, 500000000.01, 0, 0, -5e8], "
      "[-5e8, 0, 0, 500000000.01, 0, 0], [0, -5e8, 0, 0, 500000000.01, 0], [0, 0, -5e8, 0, 0, 500000000.01]]\n"
      "[time]\nT = 0.06\nsteps = 1000\n";
  const Result r = solved(text, Method::events, 1000);
  EXPECT_TRUE(r.status != Status::solved || r.error_estimate.value_or(1) < 1) << r.warning;
}

}  // namespace
}  // namespace bromwich
