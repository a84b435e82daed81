// Pages, checks and log lines of the command.

#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

namespace bromwich {
namespace {

using Json = nlohmann::json;

const std::string solve_small = "solve signorini --set Q=7 --steps 20 --threads 1 ";

TEST_F(Cli, ReportOfASolveIsAPage) {
  const Outcome result = run(solve_small + "--report r.html --json --states 0,1");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string html = read(folder_ / "r.html");
  EXPECT_TRUE(html.starts_with("<!DOCTYPE html>"));
  EXPECT_TRUE(html.ends_with("</html>\n"));
  for (const char* words : {"y: the complementary", "w = N x + M y + g", "x: the states", "Active constraints"})
    EXPECT_TRUE(contains(html, words)) << words;
  EXPECT_EQ(files(), 1u);
  // What the report needs does not change what is printed.
  Json with = Json::parse(result.out), without = Json::parse(run(solve_small + "--json --states 0,1").out);
  for (Json* json : {&with, &without})
    for (const char* measured : {"seconds", "bytes"}) json->erase(measured);
  EXPECT_EQ(with, without);
}

TEST_F(Cli, ReportIsWrittenWhereASolveEndsEarly) {
  const Outcome result = run("solve " BROMWICH_EXAMPLES "/fold.toml --report r.html");
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_TRUE(contains(read(folder_ / "r.html"), "The scene has no solution from t = "));
}

TEST_F(Cli, PlotReadsWhatSolveWrites) {
  ASSERT_EQ(run(solve_small + "--out y.csv --json > y.json").exit_code, 0);
  const Outcome alone = run("plot y.csv");
  EXPECT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_EQ(alone.out, "y.html\n");
  EXPECT_TRUE(contains(read(folder_ / "y.html"), "no summary"));
  const Outcome both = run("plot y.csv --summary y.json --out other.html");
  EXPECT_EQ(both.exit_code, 0) << both.err;
  const std::string html = read(folder_ / "other.html");
  EXPECT_TRUE(contains(html, "passed all checks"));
  EXPECT_TRUE(contains(html, "7 constraints, 49 states, 20 time steps up to T = 4"));
}

TEST_F(Cli, RefusesBadInputOfPlotAndReport) {
  std::ofstream(folder_ / "text.csv") << "hello\n";
  std::ofstream(folder_ / "y.csv") << "t,y0\n0,1\n1,2\n";
  std::ofstream(folder_ / "list.json") << "[1, 2]";
  std::ofstream(folder_ / "other.json") << R"({"schema": "bromwich-bench/1"})";
  const std::vector<BadInput> cases{
      {"plot", {"RESULT", "--out"}},
      {"plot a.csv b.csv", {"RESULT", "one"}},
      {"plot none.csv", {"RESULT", "none.csv", "does not exist"}},
      {"plot text.csv", {"text.csv:1", "header"}},
      {"plot y.dat", {"RESULT", "y.dat", ".csv"}},
      {"plot y.csv --out y.txt", {"--out", "y.txt", ".html"}},
      {"plot y.csv --summary none.json", {"--summary", "none.json"}},
      {"plot y.csv --summary y.csv", {"--summary", "y.csv", "--json"}},
      {"plot y.csv --summary list.json", {"--summary", "list.json", "--json"}},
      {"plot y.csv --summary other.json", {"--summary", "bromwich-bench/1", "bromwich/1"}},
      {solve_small + "--report r.pdf", {"--report", "r.pdf", ".html"}},
      {solve_small + "--report none/r.html", {"--report", "none"}},
      {solve_small + "--log-level loud", {"--log-level", "loud", "info"}},
      {solve_small + "--log-level inof", {"did you mean 'info'"}},
  };
  for (const BadInput& bad : cases) {
    const Outcome result = refused(bad.arguments);
    for (const std::string& word : bad.mentions) EXPECT_TRUE(contains(result.err, word)) << word << "\n" << result.err;
  }
}

TEST_F(Cli, LogLinesGoToStandardError) {
  const Outcome quiet = run(solve_small + "--json");
  EXPECT_EQ(quiet.err, "");
  const Outcome info = run(solve_small + "--json --log-level info");
  if (contains(info.err, "spdlog was not found")) GTEST_SKIP() << info.err;
  EXPECT_TRUE(contains(info.err, "info: method march: 20 steps of 0.2")) << info.err;
  EXPECT_FALSE(contains(info.err, "debug")) << info.err;
  EXPECT_TRUE(contains(run(solve_small + "--log-level debug").err, "debug: M is of class P")) << info.err;
  const Json json = Json::parse(info.out);
  EXPECT_TRUE(contains(json["decisions"].dump(), "method march: 20 steps of 0.2"));
}

TEST_F(Cli, CheckSaysWhatASolveDoes) {
  const Outcome checked = run("check signorini --set Q=7 --steps 20 --json");
  ASSERT_EQ(checked.exit_code, 0) << checked.err;
  const Json check = Json::parse(checked.out), solved = Json::parse(run(solve_small + "--json").out);
  EXPECT_EQ(check["schema"], "bromwich-check/1");
  EXPECT_EQ(check["sizes"]["constraints"], 7);
  EXPECT_EQ(check["sizes"]["states"], 49);
  EXPECT_EQ(check["class"], solved["class"]);
  EXPECT_EQ(check["spectrum"], solved["spectrum"]);
  EXPECT_EQ(check["methods"][0]["method"], solved["method"]);
  EXPECT_EQ(std::size_t(check["methods"][0]["bytes"].get<double>()), solved["bytes_predicted"].get<std::size_t>());
  EXPECT_EQ(check["refusal"], nullptr);
}

TEST_F(Cli, CheckKnowsTheMethodAndItsMemory) {
  for (const char* name : {"template", "diode-bridge", "relay-sliding", "elastic-bar", "bottlenecks"}) {
    const std::string scene = std::string(BROMWICH_EXAMPLES "/") + name + ".toml --json --states all --steps 2000";
    const Json solved = Json::parse(run("solve " + scene + " --threads 1").out);
    const Outcome checked = run("check " + scene);
    ASSERT_EQ(checked.exit_code, 0) << checked.err;
    const Json check = Json::parse(checked.out);
    bool found = false;
    for (const Json& method : check["methods"]) {
      if (method["method"] != solved["method"]) continue;
      found = true;
      EXPECT_EQ(std::size_t(method["bytes"].get<double>()), solved["bytes_predicted"].get<std::size_t>()) << name;
    }
    EXPECT_TRUE(found) << name;
    EXPECT_EQ(check["class"], solved["class"]) << name;
  }
}

TEST_F(Cli, CheckRefusesWhatWillNotBeSolved) {
  const auto scene = [&](const std::string& name, const std::string& more) {
    std::ofstream(folder_ / name) << "name = \"s\"\n[dynamics]\nA = [[-1]]\nB = [[1]]\nx0 = [0]\n"
                                  << more << "[complementarity]\nN = [[1]]\nM = [[1]]\n[time]\nT = 1\nsteps = 10\n";
  };
  scene("good.toml", "f = [\"t < 0.35 ? 1 : -1\"]\n");
  const Outcome good = run("check good.toml --json");
  ASSERT_EQ(good.exit_code, 0) << good.err;
  ASSERT_EQ(Json::parse(good.out)["breakpoints"].size(), 1u) << good.out;
  EXPECT_NEAR(Json::parse(good.out)["breakpoints"][0].get<double>(), 0.35, 1e-9);
  const Outcome boundary = run("check " BROMWICH_EXAMPLES "/periodic-rectifier.toml --method march");
  EXPECT_EQ(boundary.exit_code, 2);
  EXPECT_TRUE(contains(boundary.err, "boundary values")) << boundary.err;
  EXPECT_TRUE(contains(boundary.out, "not solved: ")) << boundary.out;
  const Outcome large = run("check signorini --set Q=511 --steps 16777216", "ulimit -v 8000000 &&");
  EXPECT_EQ(large.exit_code, 2);
  EXPECT_TRUE(contains(large.err, "it needs ")) << large.err;
  refused("check");
  refused("check signorni");
  refused("check signorini --method mrach");
}

// Standard error of the command on a terminal of its own (`script`), for a solve of many seconds that is interrupted.
TEST_F(Cli, ProgressSaysHowLongItTakes) {
  if (std::system("command -v script >/dev/null && command -v timeout >/dev/null") != 0)
    GTEST_SKIP() << "no program 'script' or 'timeout'";
  const std::string inside = "timeout --foreground -s INT 2.5 \"" BROMWICH_CLI "\" solve " BROMWICH_EXAMPLES
                             "/boost.toml --set T=4 --method events >/dev/null";
  const std::string shell = "script -qc '" + inside + "' '" + (folder_ / "tty").string() + "' >/dev/null </dev/null";
  ASSERT_NE(std::system(shell.c_str()), -1);
  const std::string tty = read(folder_ / "tty");
  EXPECT_TRUE(contains(tty, " of 400, about ")) << tty.substr(0, 400);
  EXPECT_TRUE(contains(tty, " left")) << tty.substr(0, 400);
  // The line is taken away before the message.
  const std::size_t taken = tty.rfind("\r\033[K"), message = tty.find("interrupted");
  EXPECT_LT(taken, message);
}

}  // namespace
}  // namespace bromwich
