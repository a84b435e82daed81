#include "catalogue/catalogue.hpp"
#include "core/result/log.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace bromwich {
namespace {

TEST(Log, FormatsAndIsSilentWithoutAReceiver) {
  std::vector<LogEntry> entries;
  const Log log = [&](const LogEntry& entry) { entries.push_back(entry); };
  note(log, LogLevel::info, "grid of %ld steps: %s", 400L, "solved");
  note(Log(), LogLevel::info, "%s", "nobody reads this");
  ASSERT_EQ(entries.size(), 1u);
  EXPECT_EQ(entries[0].text, "grid of 400 steps: solved");
  EXPECT_EQ(entries[0].level, LogLevel::info);
}

std::string lines_of(const Scene& scene, Options options) {
  std::string lines;
  options.log = [&](const LogEntry& entry) { lines += entry.text + "\n"; };
  solve(scene, *make_cpu_backend(1), options);
  return lines;
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

TEST(Log, SaysWhichMethodsAndGridsAreTaken) {
  Options options;
  options.steps = 40;
  const std::string automatic = lines_of(make_scene("signorini", {{"Q", 7}}), options);
  EXPECT_TRUE(contains(automatic, "auto tries march")) << automatic;
  EXPECT_TRUE(contains(automatic, "method march: 40 steps of 0.1")) << automatic;
  options.method = Method::euler;
  const std::string named = lines_of(make_scene("signorini", {{"Q", 7}}), options);
  EXPECT_FALSE(contains(named, "auto")) << named;
  EXPECT_TRUE(contains(named, "method euler: 40 steps")) << named;
}

TEST(Log, SaysHowTheErrorFalls) {
  Options options;
  options.steps = 20;
  options.tolerance = 1e-2;
  std::vector<double> estimates;
  std::string lines;
  options.log = [&](const LogEntry& entry) { lines += entry.text + "\n"; };
  const Result result = solve(make_scene("signorini", {{"Q", 7}}), *make_cpu_backend(1), options);
  ASSERT_TRUE(result.errors);
  ASSERT_EQ(result.errors->estimates.size(), result.errors->grids.size());
  EXPECT_EQ(result.errors->estimates.back(), result.error_estimate);
  for (const Index J : result.errors->grids)
    EXPECT_TRUE(contains(lines, "march on " + std::to_string(J) + " steps: error ")) << lines;
}

}  // namespace
}  // namespace bromwich
