// Scenes of a sweep that several threads read, against those that one reader reads.

#include "app/sweep_scenes.hpp"
#include "core/base/error.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/app/cli.hpp"

#include <set>

namespace bromwich {
namespace {

class SweepScenes : public Cli {
 protected:
  /// 300 scenes, R outside and a inside; x0 = 1/a has no value in the scenes with a = 0, the first one among them.
  std::string write_file(const std::string& changed) const {
    const std::string file = (folder_ / "s.toml").string();
    std::ofstream(file) << R"toml(
[parameters]
R = 1
a = 1
[dynamics]
A = [["-1 - )toml" << (changed == "dynamics" ? "R" : "0")
                        << R"toml("]]
B = [[1]]
f = ["sin(3*t)*)toml" << (changed == "sources" ? "R" : "1")
                        << R"toml("]
x0 = ["1/a"]
[complementarity]
N = [[1]]
M = [["R"]]
[time]
T = 2
steps = 50
[sweep]
R = [1, 4]
a = {from = 0, to = 1, points = 150}
)toml";
    return file;
  }
};

double source_at(const Scene& scene, double t) {
  Vector f(1);
  scene.f(t, f);
  return f[0];
}

TEST_F(SweepScenes, AreThoseOfOneReader) {
  for (const std::string changed : {"x0", "dynamics", "sources"}) {
    const std::string file = write_file(changed);
    const Sweep sweep = *read_sweep(file);
    app::SweepScenes reading(file, {}, sweep);
    EXPECT_EQ(reading.first().scene.x0[0], 149);  // the second one
    const std::unique_ptr<Backend> threads = make_cpu_backend(4);
    for (const auto& [first, count] : {std::pair<Index, Index>(0, 150), {150, 150}, {0, 300}}) {
      const app::ReadScenes read = reading.read(first, count, *threads, [] { return false; });
      ASSERT_EQ(Index(read.places.size()), count);
      std::set<const LinearSystem*> dynamics;
      for (Index i = 0; i < count; ++i) {
        const std::size_t k = std::size_t(i);
        if ((first + i) % 150 == 0) {
          EXPECT_EQ(read.places[k], -1);
          EXPECT_NE(read.errors[k].find("x0"), std::string::npos) << read.errors[k];
          continue;
        }
        ASSERT_EQ(read.places[k], i - 1 - (i > 150));
        EXPECT_EQ(read.errors[k], "");
        const Scene &scene = read.scenes[std::size_t(read.places[k])],
                    single = app::choose_scene(file, sweep.settings(first + i)).scene;
        EXPECT_EQ(scene.x0, single.x0);
        EXPECT_EQ(source_at(scene, 0.4), source_at(single, 0.4));
        EXPECT_EQ(std::get<Matrix>(scene.M), std::get<Matrix>(single.M));
        EXPECT_EQ(get_if<DenseDynamics>(&scene.dynamics)->A, get_if<DenseDynamics>(&single.dynamics)->A);
        dynamics.insert(&*scene.dynamics);
      }
      const bool both = count == 300;
      EXPECT_EQ(read.same_sources, !(both && changed == "sources")) << changed << " " << first;
      // A reader keeps one value: beside those of the first scene there is one for each range with the other R.
      if (!(both && changed == "dynamics")) {
        EXPECT_EQ(dynamics.size(), 1u) << changed << " " << first;
      }
    }
  }
}

TEST_F(SweepScenes, StopOnRequest) {
  const std::string file = write_file("x0");
  app::SweepScenes reading(file, {}, *read_sweep(file));
  const app::ReadScenes read = reading.read(0, 300, HostThreads(), [] { return true; });
  EXPECT_TRUE(read.scenes.empty());
  for (const std::string& error : read.errors) EXPECT_NE(error.find("stopped on request"), std::string::npos) << error;
}

}  // namespace
}  // namespace bromwich
