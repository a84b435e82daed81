// Scene files that include others, and byte order marks and line ends of other systems.

#include "tests/files/scene_texts.hpp"

#include <gtest/gtest.h>

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

/// Files of a test in a folder of their own.
class Included : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("bromwich_include_" + std::to_string(::getpid()));
    fs::create_directories(folder_ / "sub");
  }
  void TearDown() override { fs::remove_all(folder_); }
  void save(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  SceneFile read(const std::string& name, const ParameterValues& settings = {}) const {
    return read_scene_file(folder_ / name, settings);
  }
  std::string refused_section(const std::string& name) const {
    std::string found = refusal([&] { read(name); });
    for (std::size_t at; (at = found.find(folder_.string() + "/")) != std::string::npos;)
      found.erase(at, folder_.string().size() + 1);
    return found;
  }

  fs::path folder_;
};

TEST_F(Included, KeysOfTheFileReplaceThoseOfIncludedOnes) {
  save("sub/common.toml",
       "[parameters]\nR = 2\nC = \"2*R\"\n[dynamics]\nA = \"A.csv\"\nB = [[1]]\nx0 = [\"C\"]\n[time]\nT = 5\n");
  save("sub/A.csv", "-3\n");
  save("later.toml", "[time]\nT = 7\nsteps = 9\n");
  save("main.toml",
       "include = [\"sub/common.toml\", \"later.toml\"]\n[parameters]\nR = 10\n[complementarity]\nN = [[1]]\nM = "
       "[[\"R\"]]\n");
  const SceneFile file = read("main.toml");
  EXPECT_EQ(get<DenseDynamics>(file.scene.dynamics).A, Matrix{{-3}}) << "relative to the included file";
  EXPECT_EQ(file.scene.x0, Vector{{20}}) << "C follows the replaced R";
  EXPECT_EQ(file.scene.T, 7);
  EXPECT_EQ(file.scene.default_steps, 9);
  EXPECT_EQ(file.scene.name, "main");
  EXPECT_EQ(read("main.toml", {{"R", 1}}).scene.x0, Vector{{2}});
  std::set<std::string> inputs;
  for (const fs::path& input : file.inputs) inputs.insert(input.filename());
  EXPECT_EQ(inputs, (std::set<std::string>{"A.csv", "common.toml", "later.toml", "main.toml"}));
}

TEST_F(Included, MistakesNameTheFileThatHasThem) {
  save("common.toml", "[parameters]\nR = 2\n\n[dynamics]\nA = [[1, 2]]\n");
  save("main.toml", "include = \"common.toml\"\n" + with_replaced(two_states, "A = [[-2, 1], [1, -2]]\n", ""));
  EXPECT_TRUE(refused_section("main.toml").starts_with("common.toml:5: dynamics.A: is 1 x 2; make it square"))
      << refused_section("main.toml");
  save("key.toml", "[dynamics]\nQ = 1\n");
  save("main.toml", "include = [\"key.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml").starts_with("key.toml:2: dynamics.Q: is no known key"))
      << refused_section("main.toml");
  save("broken.toml", "\n[dynamics\n");
  save("main.toml", "include = [\"broken.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml").starts_with("broken.toml:2: ")) << refused_section("main.toml");
  save("main.toml", "include = [\"none.toml\"]\n" + two_states);
  EXPECT_TRUE(refused_section("main.toml")
                  .starts_with("main.toml:1: include: the file 'none.toml' does not exist; name a file"))
      << refused_section("main.toml");
  save("main.toml", "include = 3\n" + two_states);
  EXPECT_EQ(refused_section("main.toml"),
            "main.toml:1: include: found 3; give a list of files such as [\"common.toml\"]");
}

TEST_F(Included, CyclesAreRefused) {
  save("a.toml", "include = [\"b.toml\"]\n" + two_states);
  save("b.toml", "\ninclude = [\"sub/../a.toml\"]\n");
  EXPECT_EQ(refused_section("a.toml"),
            "b.toml:2: include: 'sub/../a.toml' includes itself, directly or through other files; remove one of these "
            "includes");
  save("c.toml", "include = [\"c.toml\"]\n");
  EXPECT_TRUE(refused_section("c.toml").starts_with("c.toml:1: include: 'c.toml' includes itself"))
      << refused_section("c.toml");
  save("twice.toml", "include = [\"d.toml\", \"e.toml\"]\n" + two_states);
  save("d.toml", "include = [\"e.toml\"]\n");
  save("e.toml", "[parameters]\nR = 1\n");
  EXPECT_EQ(read("twice.toml").parameters.at("R"), 1) << "twice, but no cycle";
}

TEST_F(Included, ByteOrderMarksAndLineEndsOfWindowsAreAccepted) {
  const auto windows = [](std::string text) {
    for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2) text.replace(at, 1, "\r\n");
    return "\xEF\xBB\xBF" + text;
  };
  const std::string text = with_replaced(with_replaced(two_states, "[[-2, 1], [1, -2]]", "\"A.mtx\""), "x0 = [1, 0]",
                                         "x0 = \"x0.csv\"\nf = \"f.csv\"");
  save("scene.toml", windows(text));
  save("A.mtx", windows("%%MatrixMarket matrix coordinate real general\n2 2 4\n1 1 -2\n1 2 1\n2 1 1\n2 2 -2\n"));
  save("x0.csv", windows("1, 0\n"));
  save("f.csv", windows("t,f0,f1\n0,0,1\n1,2,3\n"));
  const SceneFile file = read("scene.toml");
  EXPECT_EQ(get<DenseDynamics>(file.scene.dynamics).A, (Matrix{{-2, 1}, {1, -2}}));
  EXPECT_EQ(file.scene.x0, (Vector{{1, 0}}));
  Vector f(2);
  file.scene.f(0.5, f);
  EXPECT_EQ(f, (Vector{{1, 2}}));
  save("wide.toml", std::string("\xFF\xFE[\0", 4));
  EXPECT_TRUE(refused_section("wide.toml").ends_with("the file 'wide.toml' is in UTF-16; save it as UTF-8"))
      << refused_section("wide.toml");
}

}  // namespace
}  // namespace bromwich
