// Runs in parts of time: how many there are, what they report, and that they are one run.

#include "app/parts_run.hpp"
#include "catalogue/catalogue.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace bromwich::app {
namespace {

struct Observed {
  Result result;
  std::vector<std::string> parts;  ///< what the log says of them
  std::vector<Progress> progress;
};

Observed in_parts(const Scene& scene, Options options, double seconds) {
  Observed observed;
  options.log = [&](const LogEntry& entry) {
    if (entry.text.starts_with("part of ")) observed.parts.push_back(entry.text);
  };
  options.progress = [&](const Progress& progress) { observed.progress.push_back(progress); };
  PartsOptions parts;
  parts.seconds = seconds;
  const auto backend = make_cpu_backend(1);
  observed.result = solve_in_parts(scene, *backend, options, parts, nullptr);
  return observed;
}

// The first part has 64 steps, as nobody knows how long it takes. Where checkpoints are days apart, the next one has
// 256 times the steps or as many as the memory of a part holds: 2^22 values, 2 x 79 for each step.
TEST(PartsRun, TakesPartsAsLongAsTheIntervalAllows) {
  const Scene scene = make_scene("signorini", {{"Q", 79}});
  Options options = options_for(Method::march, 4000);
  options.states = StateSelection::list;
  options.components = {0, 3000, 6240};
  const Observed observed = in_parts(scene, options, 1e6);
  ASSERT_EQ(observed.result.status, Status::solved) << observed.result.reason;
  ASSERT_EQ(observed.parts.size(), 2) << observed.parts.back();
  EXPECT_TRUE(observed.parts[0].starts_with("part of 64 steps"));
  EXPECT_TRUE(observed.parts[1].starts_with("part of 3936 steps"));

  // The arrays are those of the last part. A state from contours is accurate to 1e-14 of the terms of its sums, 4000 of
  // size 1 at most.
  const Result whole = run(scene, options);
  const Result& last = observed.result;
  ASSERT_EQ(last.y.rows(), 3937);
  EXPECT_LE((last.y - whole.y.bottomRows(3937)).cwiseAbs().maxCoeff(), 1e-10);
  EXPECT_LE((last.x - whole.x.bottomRows(3937)).cwiseAbs().maxCoeff(), 1e-10);
}

TEST(PartsRun, ReportsTheStepsOfTheRun) {
  const Observed observed = in_parts(make_scene("signorini", {{"Q", 15}}), options_for(Method::march, 1000), 1e-6);
  ASSERT_EQ(observed.result.status, Status::solved) << observed.result.reason;
  EXPECT_GT(observed.parts.size(), 2u);
  ASSERT_FALSE(observed.progress.empty());
  Index done = 0;
  for (const Progress& progress : observed.progress) {
    EXPECT_EQ(progress.total, 1000);
    EXPECT_GE(progress.iteration, done);
    done = progress.iteration;
  }
  EXPECT_GT(done, 900);
  EXPECT_LE(done, 1000);
}

}  // namespace
}  // namespace bromwich::app
