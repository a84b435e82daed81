// Derivatives of some examples against differences of solves. All of them: `bromwich bench derivatives`.

#include "bench/studies/derivative_check.hpp"

#include "files/scene_file.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

namespace bromwich::derivative_check_test {
namespace {

TEST(DerivativeCheck, OfSomeExamples) {
  if (!scene_files_available()) GTEST_SKIP() << "this build has no reader for scene files";
  const auto backend = make_cpu_backend(2);
  for (const auto& [name, kind] : {std::pair("rlcd", "discrete"),
                                   {"bottlenecks", "discrete"},
                                   {"fit/stop", "discrete"},
                                   {"periodic-rectifier", "boundary"},
                                   {"lq-control", "boundary"},
                                   {"fit/friction", "located"}}) {
    const Scene scene = read_scene_file(std::filesystem::path(BROMWICH_EXAMPLES) / (std::string(name) + ".toml")).scene;
    const app::DerivativeCheck check = app::check_derivatives(scene, *backend, scene.steps(), 3);
    EXPECT_EQ(check.kind, kind) << name << ": " << check.reason;
    EXPECT_GE(check.error.size(), 5u) << name;
    EXPECT_EQ(check.verdict(), app::Verdict::agrees) << name << ": " << check.largest_error();
    EXPECT_LE(check.identity, 1e-12) << name;
  }
}

}  // namespace
}  // namespace bromwich::derivative_check_test
