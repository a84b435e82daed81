// The command from outside: output streams, and the files it writes.

#include "kernels/cuda_backend.hpp"
#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

using Json = nlohmann::json;

/// Small enough that every solve of these tests takes milliseconds.
const std::string small = "solve signorini --set Q=7 --steps 20 --threads 1";

TEST_F(Cli, NumbersMayBeExpressionsOrHaveAnExponent) {
  const Outcome result = run("solve signorini --set k=3 --set Q=7 T=2/2 --steps 2e1 --json");
  EXPECT_EQ(result.exit_code, 2) << "k is no parameter";
  const Outcome good = run("solve signorini --set Q=2^3-1 T=2*pi/4 --steps 2e1 --threads 1 --json");
  ASSERT_EQ(good.exit_code, 0) << good.err;
  const Json json = Json::parse(good.out);
  EXPECT_EQ(json["parameters"]["Q"], 7);
  EXPECT_DOUBLE_EQ(json["parameters"]["T"].get<double>(), std::acos(-1.0) / 2);
  EXPECT_EQ(json["steps"], 20);
}

// w = N x + M y + g: of the columns themselves, M = tridiag(-1, 4, -1) and g = 4 psi_i - psi_(i-1) - psi_(i+1).
TEST_F(Cli, WritesTheColumnsThatAreGiven) {
  ASSERT_EQ(run(small + " --columns w3,y2,y3,y4,trace3 --out c.csv").exit_code, 0);
  const auto lines = split(read(folder_ / "c.csv"), '\n');
  EXPECT_EQ(lines[0], "t,w3,y2,y3,y4,trace3");
  ASSERT_EQ(lines.size(), 22u);
  for (std::size_t k = 1; k < lines.size(); ++k) {
    const auto cells = split(lines[k], ',');
    const auto at = [&](std::size_t i) { return std::stod(cells[i]); };
    const double psi = std::sin(2 * std::acos(-1.0) * at(0));  // lines 2, 3, 4 of 7 lie in the middle
    EXPECT_NEAR(at(1), at(5) + 4 * at(3) - at(2) - at(4) + 2 * psi, 1e-13 * 40);
    EXPECT_NEAR(std::min(at(1), at(3)), 0, 1e-10) << "complementary";
  }
  ASSERT_EQ(run(small + " --columns y,x --out c.csv").exit_code, 0);
  EXPECT_EQ(split(split(read(folder_ / "c.csv"), '\n')[0], ',').size(), 1u + 7u + 49u);
  ASSERT_EQ(run(small + " --columns w0,x5 --at 0.123,4 --out c.csv").exit_code, 0);
  const auto sampled = split(read(folder_ / "c.csv"), '\n');
  ASSERT_EQ(sampled.size(), 3u);
  EXPECT_EQ(sampled[0], "t,w0,x5");
  EXPECT_FALSE(contains(sampled[1], "nan")) << sampled[1];
}

TEST_F(Cli, HelpAndVersionGoToStandardOutput) {
  for (const std::string arguments : {"--help", "-h", "solve --help", "bench --help", "scenes --help", "info --help"}) {
    const Outcome result = run(arguments);
    EXPECT_EQ(result.exit_code, 0) << arguments;
    EXPECT_TRUE(contains(result.out, "Usage:")) << arguments;
    EXPECT_EQ(result.err, "") << arguments;
  }
  EXPECT_TRUE(contains(run("solve --help").out, "bromwich solve signorini"));
  const Outcome version = run("--version");
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_TRUE(version.out.starts_with("bromwich ")) << version.out;
}

TEST_F(Cli, HelpThatCannotBeWrittenIsAFailure) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "this system has no device that is always full";
  for (const std::string arguments : {"--help", "solve --help", "--version", "scenes"}) {
    const Outcome result = run(arguments + " >/dev/full");
    EXPECT_EQ(result.exit_code, 2) << arguments;
    EXPECT_TRUE(contains(result.err, "standard output")) << result.err;
  }
}

TEST_F(Cli, HelpNamesEveryMethodThatIsAccepted) {
  const std::string help = run("solve --help").out;
  for (const char* method : {"auto", "multigrid", "dual", "contour", "contour-literal", "march", "euler"})
    EXPECT_TRUE(contains(help, method)) << method;
}

TEST_F(Cli, ListsScenesWithDefaults) {
  const Outcome result = run("scenes");
  EXPECT_EQ(result.exit_code, 0);
  const auto lines = split(result.out, '\n');
  const auto line_of = [&](const std::string& name) {
    return *std::find_if(lines.begin(), lines.end(), [&](const auto& line) { return line.starts_with(name + " "); });
  };
  ASSERT_TRUE(contains(result.out, "signorini ") && contains(result.out, "\nbridge "));
  for (const char* word : {"Q=39", "dx", "c=0.002", "T=4"}) EXPECT_TRUE(contains(line_of("signorini"), word)) << word;
}

TEST_F(Cli, ScenesSayWhetherFilesAreRead) { EXPECT_TRUE(contains(run("scenes").out, ".toml")); }

TEST_F(Cli, InfoNamesVersionBackendAndThreads) {
  const Outcome result = run("info");
  EXPECT_EQ(result.exit_code, 0);
  for (const char* word : {"version", "backends", "cpu", "threads"}) EXPECT_TRUE(contains(result.out, word)) << word;
}

TEST_F(Cli, JsonIsOneObjectWithTheKeysOfTheContract) {
  const Outcome result = run(small + " --json --out y.csv");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err, "");  // no terminal, so no progress either
  const Json json = Json::parse(result.out);
  ASSERT_TRUE(json.is_object());
  for (const char* key : {"schema", "scene", "status", "infeasible_at", "method", "backend", "steps", "iterations",
                          "cycles", "work", "residual", "error_estimate", "lcp", "seconds", "bytes", "bytes_predicted"})
    EXPECT_TRUE(json.contains(key)) << key;
  for (const char* key : {"solved", "newton", "fallbacks"}) EXPECT_TRUE(json["lcp"].contains(key)) << key;
  for (const char* key : {"total", "setup", "solve", "lcp", "convolution", "transform", "other"})
    EXPECT_TRUE(json["seconds"].contains(key)) << key;
  EXPECT_EQ(json["schema"], "bromwich/1");
  EXPECT_EQ(json["scene"], "signorini");
  EXPECT_EQ(json["status"], "solved");
  EXPECT_TRUE(json["infeasible_at"].is_null());
  EXPECT_EQ(json["backend"], "cpu");
  EXPECT_EQ(json["steps"], 20);
  EXPECT_EQ(json["threads"], 1);
  EXPECT_EQ(json["parameters"]["Q"], 7);
  EXPECT_FALSE(json["parameters"].contains("dx"));  // Q was used, not dx
  EXPECT_TRUE(json["residual"].is_number());
}

TEST_F(Cli, ToleranceChoosesTheStepsAndReportsTheError) {
  const Outcome result = run("solve signorini --set Q=7 --tol 1e-3 --json --out y.csv");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const Json json = Json::parse(result.out);
  EXPECT_EQ(json["status"], "solved");
  EXPECT_LE(json["error_estimate"].get<double>(), 1e-3);
  const Json& errors = json["errors"];
  for (const char* key : {"discretisation", "kernel", "iteration", "states", "order", "tolerance", "of", "grids"})
    EXPECT_TRUE(errors.contains(key)) << key;
  EXPECT_EQ(errors["of"], "y");
  EXPECT_TRUE(errors["states"].is_null()) << "none were asked for";
  EXPECT_EQ(errors["grids"].back(), json["steps"]);
  const std::size_t rows = split(read(folder_ / "y.csv"), '\n').size();
  EXPECT_EQ(rows, json["steps"].get<std::size_t>() + 2) << "a heading, and t = 0";
  EXPECT_TRUE(Json::parse(run(small + " --json").out)["errors"].is_null());
}

TEST_F(Cli, ToleranceOutOfReachIsNotMet) {
  const Outcome result = run("solve signorini --set Q=7 --method euler --tol 1e-9");
  EXPECT_EQ(result.exit_code, 3);
  for (const char* word : {"tolerance_not_met", "steps would be needed", "not 1.0e-09"})
    EXPECT_TRUE(contains(result.err, word)) << word << "\n" << result.err;
  EXPECT_TRUE(contains(result.out, "grids 25 50"));
}

TEST_F(Cli, WritesRowsAtTimesAndSwitches) {
  const Outcome result = run(small + " --states 0 --at 0,0.2,0.31 --out y.csv --switches s.csv");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const auto rows = split(read(folder_ / "y.csv"), '\n');
  ASSERT_EQ(rows.size(), 4u);
  EXPECT_EQ(split(rows[3], ',')[0], "0.31");
  EXPECT_EQ(split(rows[3], ',').size(), 9u) << "t, seven y and x0";
  EXPECT_FALSE(contains(rows[3], "nan"));
  ASSERT_EQ(run(small + " --states 0 --out all.csv").exit_code, 0);
  EXPECT_EQ(rows[2], split(read(folder_ / "all.csv"), '\n')[2]) << "0.2 is a time point";
  const auto found = split(read(folder_ / "s.csv"), '\n');
  ASSERT_GE(found.size(), 2u);
  EXPECT_EQ(found[0], "t,component,on,error");
  EXPECT_EQ(split(found[1], ',').size(), 4u);
}

TEST_F(Cli, NamedMethodIsTheOneThatRuns) {
  for (const std::string method : {"multigrid", "contour", "contour-literal", "march", "euler"}) {
    const Outcome result = run(std::string(small).append(" --json --method ").append(method));
    EXPECT_EQ(Json::parse(result.out)["method"], method);
  }
}

TEST_F(Cli, SummaryNamesStatusAndOutput) {
  const Outcome result = run(small + " --out y.csv");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  for (const char* word : {"signorini", "Q = 7", "20 steps", "solved", "y.csv"})
    EXPECT_TRUE(contains(result.out, word)) << word << "\n" << result.out;
}

// E x' = ... with a row of zeros: no method takes it, and there is no residual to speak of.
TEST_F(Cli, SummarySaysWhereNothingWasSolved) {
  const std::string singular = R"toml(
name = "singular"
[dynamics]
E = [[1, 0], [0, 0]]
A = [[-1, 0], [0, -1]]
B = [[1], [1]]
x0 = [1, 0]
[complementarity]
N = [[1, 1]]
M = [[0]]
[time]
T = 1
steps = 8
)toml";
  std::ofstream(folder_ / "singular.toml") << singular;
  const Outcome outcome = run("solve singular.toml");
  EXPECT_EQ(outcome.exit_code, 3) << outcome.out << outcome.err;
  EXPECT_TRUE(contains(outcome.out, "unsupported")) << outcome.out;
  EXPECT_TRUE(contains(outcome.out, "nothing was solved")) << outcome.out;
  EXPECT_FALSE(contains(outcome.out, "nan")) << outcome.out;
  EXPECT_FALSE(contains(run("solve bridge --steps 8").out, "nothing was solved"));
}

TEST_F(Cli, SettingsMayFollowOneAnother) {
  const Json json = Json::parse(run("solve --set Q=5 T=2 signorini --steps=8 --set c=1e-3 --json").out);
  EXPECT_EQ(json["parameters"]["Q"], 5);
  EXPECT_EQ(json["parameters"]["T"], 2);
  EXPECT_EQ(json["parameters"]["c"], 1e-3);
  const Json spacing = Json::parse(run("solve signorini --set dx=0.125 --steps 8 --json").out);
  EXPECT_EQ(spacing["parameters"]["dx"], 0.125);
  EXPECT_FALSE(spacing["parameters"].contains("Q"));
}

TEST_F(Cli, CsvHasOneRowPerTime) {
  ASSERT_EQ(run(small + " --out y.csv").exit_code, 0);
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  ASSERT_EQ(lines.size(), 22u);  // header, t_0 ... t_20
  EXPECT_EQ(lines[0], "t,y0,y1,y2,y3,y4,y5,y6");
  for (std::size_t j = 0; j < 21; ++j) {
    const auto cells = split(lines[j + 1], ',');
    ASSERT_EQ(cells.size(), 8u) << j;
    // t_j = j T/J = j/5, to the rounding of one multiplication and one division.
    EXPECT_NEAR(std::stod(cells[0]), double(j) / 5, 1e-15 * 4) << j;
    for (std::size_t i = 1; i < cells.size(); ++i) EXPECT_GE(std::stod(cells[i]), 0) << j;
  }
}

TEST_F(Cli, RowZeroHoldsTheInitialState) {
  ASSERT_EQ(run(small + " --states 0,8,3 --out y.csv").exit_code, 0);
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  EXPECT_EQ(lines[0], "t,y0,y1,y2,y3,y4,y5,y6,x0,x8,x3");
  const auto cells = split(lines[1], ',');
  ASSERT_EQ(cells.size(), 11u);
  EXPECT_EQ(std::stod(cells[0]), 0);
  // x0 = 2 x1 x2 (1 - x1)(1 - x2) on the grid of spacing 1/8; component 7 a + b sits at x2 = (a+1)/8, x1 = (b+1)/8.
  const auto initial = [](int a, int b) { return 2.0 * (a + 1) * (7 - a) * (b + 1) * (7 - b) / 4096; };
  EXPECT_NEAR(std::stod(cells[8]), initial(0, 0), 1e-15);
  EXPECT_NEAR(std::stod(cells[9]), initial(1, 1), 1e-15);
  EXPECT_NEAR(std::stod(cells[10]), initial(0, 3), 1e-15);
}

TEST_F(Cli, AllStatesAreWrittenInOrder) {
  ASSERT_EQ(run(small + " --states all --out y.csv").exit_code, 0);
  const auto header = split(split(read(folder_ / "y.csv"), '\n')[0], ',');
  ASSERT_EQ(header.size(), 1u + 7 + 49);
  EXPECT_EQ(header[8], "x0");
  EXPECT_EQ(header.back(), "x48");
}

TEST_F(Cli, CsvNumbersAreShortestAndExact) {
  ASSERT_EQ(run(small + " --out y.csv").exit_code, 0);
  // Every number must be at most 17 significant digits; t = 0.2 shows that no digits are padded.
  EXPECT_TRUE(split(read(folder_ / "y.csv"), '\n')[2].starts_with("0.2,"));
}

TEST_F(Cli, ExistingFileSurvivesARefusedRun) {
  std::ofstream(folder_ / "y.csv") << "precious";
  refused("solve signorini --steps 0 --out y.csv");
  refused("solve signorini --set T=-1 --out y.csv");
  refused("solve signorini --method goal --out y.csv");
  EXPECT_EQ(read(folder_ / "y.csv"), "precious");
  EXPECT_EQ(files(), 1u);
}

TEST_F(Cli, WritesWholeFilesAndLeavesNothingBeside) {
  std::ofstream(folder_ / "y.csv") << "old";
  fs::permissions(folder_ / "y.csv", fs::perms::owner_read | fs::perms::owner_write);
  fs::create_symlink("y.csv", folder_ / "link.csv");
  ASSERT_EQ(run(small + " --out link.csv").exit_code, 0);
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.csv"));
  EXPECT_TRUE(read(folder_ / "y.csv").starts_with("t,y0,"));
  EXPECT_EQ(fs::status(folder_ / "y.csv").permissions(), fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_EQ(files(), 2u);
}

TEST_F(Cli, InterruptWritesTheValidPart) {
  // Hundreds of iterations of tens of milliseconds: far from done after three seconds on any machine. With
  // --foreground, timeout signals only the command; otherwise the group gets a second signal, which kills.
  const Outcome result = run("solve signorini --set Q=511 --steps 4096 --method contour --threads 1 --json --out y.csv",
                             "timeout --foreground --preserve-status -s INT 3");
  if (result.exit_code == 0) GTEST_SKIP() << "solved before the signal came";
  EXPECT_EQ(result.exit_code, 3) << result.err;
  EXPECT_EQ(Json::parse(result.out)["status"], "interrupted");
  EXPECT_TRUE(contains(result.err, "interrupted")) << result.err;
  EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1);
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  ASSERT_GE(lines.size(), 3u);
  ASSERT_LE(lines.size(), 4099u);
  for (std::size_t i = 1; i + 1 < lines.size(); ++i) EXPECT_EQ(lines[i].find("nan"), std::string::npos) << lines[i];
  EXPECT_TRUE(lines.back().starts_with("# ended at t = ")) << lines.back();
  EXPECT_TRUE(lines.back().ends_with(": interrupted, stopped on request")) << lines.back();
}

}  // namespace
}  // namespace bromwich
