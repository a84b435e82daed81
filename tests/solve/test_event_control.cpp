// Method events by name: fixed steps, scenes that it refuses, residual.

#include "core/catalogue/catalogue.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

TEST(EventControl, SolvesOnTheGridOfTheOptions) {
  const Scene scene = make_scene("bridge");
  const Result r = run(scene, options_for(Method::events, 50));
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.steps, 50);
  EXPECT_EQ(r.method, Method::events);
  Vector x(scene.states()), y(scene.constraints());
  for (Index j = 1; j <= r.steps; ++j) {
    scene.exact(r.t[j], x, y);
    EXPECT_LE((r.y.row(j).transpose() - y).cwiseAbs().maxCoeff(), 1e-7);
  }
}

TEST(EventControl, SaysWhatItDoesNotTake) {
  const Result large = run(make_scene("signorini", {{"Q", 127}}), options_for(Method::events, 20));
  EXPECT_EQ(large.status, Status::unsupported);
  EXPECT_NE(large.reason.find("method march"), std::string::npos) << large.reason;
  const Result boundary = run(make_scene("lq-control"), options_for(Method::events, 20));
  EXPECT_EQ(boundary.status, Status::unsupported);
  EXPECT_NE(boundary.reason, "");
}

}  // namespace
}  // namespace bromwich
