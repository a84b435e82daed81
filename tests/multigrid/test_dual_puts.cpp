// American options by cycles in w, against published values and trees.

#include "core/scene/component_names.hpp"
#include "tests/multigrid/dual_scenes.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace bromwich {
namespace {

double value_at_the_spot(const Scene& scene, Method method, Index steps) {
  Options options = options_for(method, steps);
  options.states = StateSelection::list;
  options.components = {find_state(scene, "spot")};
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  return r.x(r.x.rows() - 1, 0);
}

// Published values. The error of the mesh is of order two, 6.4e-5 with 800 points, and 41 over their square; twice
// that.
TEST(DualPuts, ValueAmericanPuts) {
  struct Known {
    ParameterValues parameters;
    double value;
  };
  const std::vector<Known> puts{
      {{{"q", 0.05}, {"sigma", 0.25}}, 9.569445299}, {{}, 6.0903706}, {{{"S", 36}, {"K", 40}, {"r", 0.06}}, 4.4866744}};
  for (const Known& put : puts)
    for (const double points : {100., 200.}) {
      ParameterValues parameters = put.parameters;
      parameters["points"] = points;
      EXPECT_NEAR(value_at_the_spot(make_scene("put", parameters), Method::dual, 200), put.value,
                  82 / (points * points));
    }
}

// With two dividends of two per cent, against a binomial tree: 7.55751 to 3.2e-4 (scripts/put_reference).
TEST(DualPuts, ValueAmericanPutsWithDividends) {
  const Scene scene = make_scene("put", {{"dividend", 0.02}, {"dividends", 2}, {"points", 600}});
  EXPECT_NEAR(value_at_the_spot(scene, Method::dual, 100), 7.55751, 3.2e-4 + 82. / 360000);
}

// The lower of two prices: 11.98751 to 5.7e-5 by trees. The error is of order two in the points, 0.036 with 30 less
// that with 60, so that 43 over their square is expected; twice that.
TEST(DualPuts, ValueAmericanPutsOnTwoAssets) {
  for (const double points : {24., 32.})
    EXPECT_NEAR(value_at_the_spot(make_scene("put-on-two", {{"points", points}}), Method::automatic, 16), 11.98751,
                86 / (points * points) + 5.7e-5);
}

}  // namespace
}  // namespace bromwich
