// The command under system failures: memory, disk, signals, bad files. Every outcome is one clear line, no file of the
// user is lost, and nothing is left behind.

#include "tests/app/cli.hpp"

#include <sys/stat.h>

#include <random>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BROMWICH_SANITIZED 1
#endif

namespace bromwich {
namespace {

// w = 1 - t: y = 0 until t = 1, infeasible afterwards.
const std::string infeasible = R"toml(
[dynamics]
A = [[0]]
B = [[0]]
x0 = [0]
[complementarity]
N = [[0]]
M = [[0]]
g = ["1 - t"]
[time]
T = 2
steps = 20
[output]
states = "all"
)toml";

class CliFaults : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    save("decay.toml", decay);
  }
  void save(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  static void expect_one_line(const Outcome& outcome, const std::string& what) {
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << what << "\n" << outcome.err;
    EXPECT_TRUE(outcome.err.starts_with("bromwich: ")) << what << "\n" << outcome.err;
  }
};

TEST_F(CliFaults, LongLinesOfAScene) {
  std::string row = "\"-1\"";
  for (int j = 1; j < 40; ++j) row += ", 0.000000000000000000";
  std::string A = "[" + row + "]", b = "[1]", x0 = "0", N = "1";
  for (int i = 1; i < 40; ++i) {
    A += ", [" + row + "]";
    b += ", [0]";
    x0 += ", 0";
    N += ", 0";
  }
  save("wide.toml", "[dynamics]\nA = [" + A + "]\nB = [" + b + "]\nx0 = [" + x0 + "]\n[complementarity]\nN = [[" + N +
                        "]]\nM = [[1]]\n[time]\nT = 1\nsteps = 4\n");
  const Outcome outcome = run("solve wide.toml --out y.csv");
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_TRUE(contains(refused("solve wide.toml --out wide.csv --switches wide.toml").err, "input of the scene"));
}

TEST_F(CliFaults, InputsAreNotOverwritten) {
  save("A.csv", "-1\n");
  std::string text = decay;
  text.replace(text.find("[[-1]]"), 6, "\"\\u0041.csv\"");  // A.csv, written with an escape
  save("table.toml", text);
  EXPECT_TRUE(contains(refused("solve table.toml --out A.csv").err, "input of the scene"));
  EXPECT_EQ(read(folder_ / "A.csv"), "-1\n");
}

TEST_F(CliFaults, LongExpressions) {
  for (const std::size_t length : {19997u, 19999u, 20001u, 200001u}) {
    std::string sum = "t";
    while (sum.size() + 2 <= length) sum += "+0";
    save("long.toml", decay + "[exact]\nx = [\"2*exp(-t)\"]\n");
    std::string text = decay;
    text.replace(text.find("x0 = [\"x0\"]"), 11, "x0 = [2]\nf = [\"" + sum + "\"]");
    save("long.toml", text);
    const Outcome outcome = run("solve long.toml --steps 8 --no-confirm");  // a value takes milliseconds
    EXPECT_EQ(outcome.exit_code, 0) << length << " " << outcome.err;
  }
  std::string text = decay;
  text.replace(text.find("x0 = [\"x0\"]"), 11, "x0 = [2]\nf = [\"" + std::string(100000, '(') + "t\"]");
  save("deep.toml", text);
  EXPECT_TRUE(contains(refused("solve deep.toml").err, "dynamics.f"));
}

TEST_F(CliFaults, ClosedStreams) {
  for (const std::string closed : {">&- 2>&-", "<&- >&- 2>&-", ">&-", "<&- >&-"}) {
    const Outcome outcome = run("solve decay.toml --out y.csv", "sh -c '\"$0\" \"$@\" " + closed + "'");
    EXPECT_EQ(outcome.exit_code, 2) << closed;
    const auto lines = split(read(folder_ / "y.csv"), '\n');
    ASSERT_EQ(lines.size(), 10u) << closed;
    EXPECT_EQ(lines[0], "t,y0,x0");
    if (!contains(closed, "2>")) {
      EXPECT_TRUE(contains(outcome.err, "standard output")) << outcome.err;
    }
    fs::remove(folder_ / "y.csv");
  }
  EXPECT_EQ(run("solve decay.toml --json", "sh -c '\"$0\" \"$@\" 2>&-'").exit_code, 0);
  EXPECT_EQ(run("solve none.toml", "sh -c '\"$0\" \"$@\" >&- 2>&-'").exit_code, 2);
}

TEST_F(CliFaults, FullDisk) {
  if (!fs::exists("/dev/full")) GTEST_SKIP();
  const Outcome outcome = run("solve decay.toml > /dev/full");
  EXPECT_EQ(outcome.exit_code, 2);
  expect_one_line(outcome, "/dev/full");
  EXPECT_EQ(run("solve decay.toml", "sh -c '\"$0\" \"$@\" 2>/dev/full'").exit_code, 0);
  EXPECT_EQ(run("solve none.toml", "sh -c '\"$0\" \"$@\" 2>/dev/full'").exit_code, 2);
}

TEST_F(CliFaults, LimitOfTheSizeOfFiles) {
  save("y.csv", "precious");
  for (const std::string steps : {"1000", "200000"}) {
    const Outcome outcome = run("solve decay.toml --out y.csv --steps " + steps, "ulimit -f 4 &&");
    EXPECT_EQ(outcome.exit_code, 2);
    expect_one_line(outcome, "ulimit -f");
    EXPECT_TRUE(contains(outcome.err, "could not be written (File too large)")) << outcome.err;
    EXPECT_EQ(read(folder_ / "y.csv"), "precious");
    EXPECT_EQ(files(), 2u);
  }
}

TEST_F(CliFaults, AKilledRunLeavesNothing) {
  // Writing takes most of the time of this one.
  const std::string command = "solve decay.toml --method march --steps 2000000 --out y.csv";
  for (const std::string seconds : {"0.3", "0.6", "0.9", "1.2", "1.5"}) {
    run(command, "timeout --foreground -s KILL " + seconds);
    for (const auto& entry : fs::directory_iterator(folder_)) {
      const std::string name = entry.path().filename();
      EXPECT_TRUE(name == "decay.toml" || name == "y.csv") << name;
    }
    if (fs::exists(folder_ / "y.csv")) {
      EXPECT_TRUE(read(folder_ / "y.csv").ends_with('\n'));
    }
  }
}

TEST_F(CliFaults, PipesAndDevicesAreNoScenes) {
  ASSERT_EQ(::mkfifo((folder_ / "pipe.toml").c_str(), 0600), 0);
  ASSERT_EQ(::mkfifo((folder_ / "pipe.csv").c_str(), 0600), 0);
  std::string text = decay;
  text.replace(text.find("[[-1]]"), 6, "\"pipe.csv\"");
  save("table.toml", text);
  for (const std::string scene : {"pipe.toml", "table.toml", "/dev/zero"}) {
    const Outcome outcome = run("solve " + scene, "timeout 60");
    EXPECT_EQ(outcome.exit_code, 2) << scene;
    expect_one_line(outcome, scene);
    EXPECT_TRUE(contains(outcome.err, "is no regular file")) << outcome.err;
  }
}

TEST_F(CliFaults, LinksAreFollowed) {
  fs::create_symlink("target.csv", folder_ / "link.csv");
  fs::create_symlink("link.csv", folder_ / "second.csv");
  ASSERT_EQ(run("solve decay.toml --out second.csv").exit_code, 0);
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.csv"));
  EXPECT_TRUE(fs::is_symlink(folder_ / "second.csv"));
  EXPECT_TRUE(fs::is_regular_file(fs::symlink_status(folder_ / "target.csv")));
  fs::create_symlink("none/target.csv", folder_ / "far.csv");
  EXPECT_TRUE(contains(refused("solve decay.toml --out far.csv").err, "does not exist"));
  fs::create_symlink("loop.csv", folder_ / "loop.csv");
  refused("solve decay.toml --out loop.csv");
  EXPECT_TRUE(fs::is_symlink(folder_ / "loop.csv"));
}

TEST_F(CliFaults, MemoryThatRunsOut) {
#ifdef BROMWICH_SANITIZED
  GTEST_SKIP() << "sanitizers need their own address space";
#endif
  int refused = 0, begun = 0;
  for (const std::string limit : {"60000", "120000", "250000", "500000", "1000000"}) {
    // Libraries of CUDA alone may need more.
    if (run("--version", "ulimit -v " + limit + " &&").exit_code != 0) continue;
    ++begun;
    for (const std::string method : {"contour", "march"}) {
      const Outcome outcome = run("solve signorini --set Q=255 --steps 3000 --threads 4 --method " + method,
                                  "ulimit -v " + limit + " && timeout 100");
      EXPECT_TRUE(outcome.exit_code == 0 || outcome.exit_code == 2) << limit << " " << method << outcome.exit_code;
      if (outcome.exit_code == 0) continue;
      expect_one_line(outcome, limit + " " + method);
      ++refused;
    }
  }
  if (begun == 0) GTEST_SKIP() << "the program does not start within these limits";
  EXPECT_GT(refused, 0);
}

TEST_F(CliFaults, FilesOfAnEarlyEndSaySo) {
  save("ends.toml", infeasible);
  for (const std::string method : {"march", "euler"}) {
    const Outcome outcome = run("solve ends.toml --out y.csv --switches s.csv --method " + method);
    EXPECT_EQ(outcome.exit_code, 3);
    const auto lines = split(read(folder_ / "y.csv"), '\n');
    ASSERT_GE(lines.size(), 10u);  // t = 0, ..., 0.8 at least
    EXPECT_LE(lines.size(), 13u);  // t = 1 at most, header and comment
    for (std::size_t j = 0; j + 1 < lines.size(); ++j) EXPECT_FALSE(contains(lines[j], "nan")) << lines[j];
    const std::string last = split(lines[lines.size() - 2], ',')[0];
    EXPECT_TRUE(lines.back().starts_with("# ended at t = " + last + ": infeasible, ")) << lines.back();
    EXPECT_TRUE(split(read(folder_ / "s.csv"), '\n').back().starts_with("# ended at t = " + last + ": infeasible, "));
  }
}

// tests/files/test_fuzz.cpp reads many more of them, in one process.
TEST_F(CliFaults, MutatedScenesEndInOneLine) {
  std::mt19937 random(7);
  const auto below = [&](std::size_t count) {
    return std::uniform_int_distribution<std::size_t>(0, count - 1)(random);
  };
  const std::string characters = "0123456789.-+e[]()\"'=#,\n tx\x7f\xff";
  for (int trial = 0; trial < 60; ++trial) {
    std::string text = decay;
    for (std::size_t count = 1 + below(3); count > 0; --count)
      text[below(text.size())] = characters[below(characters.size())];
    save("mutated.toml", text);
    const Outcome outcome = run("solve mutated.toml --steps 8 --out y.csv", "timeout 60");
    EXPECT_TRUE(outcome.exit_code == 0 || outcome.exit_code == 2 || outcome.exit_code == 3)
        << outcome.exit_code << " from\n"
        << text;
    if (outcome.exit_code != 0) expect_one_line(outcome, text);
  }
}

}  // namespace
}  // namespace bromwich
