// Scene files through the command.

#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

using Json = nlohmann::json;

const std::string exact = "[exact]\nx = [\"x0*exp(-t)\"]\ny = [0]\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  text.replace(text.find(from), from.size(), to);
  return text;
}

class CliFiles : public Cli {
 protected:
  void SetUp() override {
    Cli::SetUp();
    save("decay.toml", decay);
  }
  void save(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  Json solved(const std::string& arguments) const {
    const Outcome result = run("solve " + arguments + " --threads 1 --json");
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return Json::parse(result.out);
  }
};

TEST_F(CliFiles, SolvesASceneFile) {
  const Json json = solved("decay.toml --method march --out y.csv");
  EXPECT_EQ(json["scene"], "decay");
  EXPECT_EQ(json["steps"], 8);
  EXPECT_EQ(json["parameters"]["x0"], 2);
  EXPECT_TRUE(json["reference_error"].is_null());
  EXPECT_TRUE(json["reference"].is_null());
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  EXPECT_EQ(lines[0], "t,y0,x0");  // states = "all" in the file
  const auto last = split(lines.back(), ',');
  // One exponential: exact up to 1e-13 of the largest weight of the kernel.
  EXPECT_NEAR(std::stod(last[2]), 2 * std::exp(-1), 1e-12);
}

TEST_F(CliFiles, OptionsOverrideTheFile) {
  const Json json = solved("./decay.toml --set x0=3 --steps 4 --states none --out y.csv");
  EXPECT_EQ(json["parameters"]["x0"], 3);
  EXPECT_EQ(json["steps"], 4);
  EXPECT_EQ(split(read(folder_ / "y.csv"), '\n')[0], "t,y0");
}

TEST_F(CliFiles, FinalTimeAndExpressionsMayBeSet) {
  const Json json = solved("decay.toml --method march --set x0=1+1 --set T=x0/4 --out y.csv");
  EXPECT_EQ(json["parameters"], Json::parse(R"({"x0": 2})"));
  const auto last = split(split(read(folder_ / "y.csv"), '\n').back(), ',');
  EXPECT_EQ(std::stod(last[0]), 0.5);
  EXPECT_NEAR(std::stod(last[2]), 2 * std::exp(-0.5), 1e-12);
  EXPECT_EQ(solved("decay.toml --set T=x0/4")["sizes"]["T"], 0.5) << "x0 is 2 in the file";
  EXPECT_EQ(solved("signorini --set Q=7 --set T=4/Q --steps 8")["sizes"]["T"], 4.0 / 7);
  EXPECT_TRUE(contains(refused("solve decay.toml --set T=x1/4").err, "'x1', which is not defined"));
  EXPECT_TRUE(contains(refused("solve decay.toml --set T=0").err, "--set: is 0; give a positive finite number"));
  EXPECT_TRUE(contains(refused("solve decay.toml --set Tend=2").err, "(did you mean 'T'?)"));
}

TEST_F(CliFiles, NamesAreUsedEverywhere) {
  save("named.toml",
       decay + "[names]\nx = [\"level\"]\ny = [\"inflow\"]\nw = [\"gap\"]\n[units]\nt = \"s\"\nx = \"m\"\n");
  const Json json = solved("named.toml --states level --out y.csv --switches s.csv");
  EXPECT_EQ(split(read(folder_ / "y.csv"), '\n')[0], "t,inflow,level");
  EXPECT_EQ(json["names"]["w"][0], "gap");
  EXPECT_EQ(json["units"]["t"], "s");
  EXPECT_EQ(json["units"]["x"][0], "m");
  solved("named.toml --columns gap,level,y0 --at 0.1,1 --out y.csv");
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  EXPECT_EQ(lines[0], "t,gap,level,inflow");
  EXPECT_NEAR(std::stod(split(lines[1], ',')[2]), 2 * std::exp(-0.1), 1e-12);
  EXPECT_TRUE(contains(refused("solve named.toml --states levle").err, "did you mean 'level'")) << "with its neighbour";
  EXPECT_TRUE(contains(refused("solve named.toml --out z.csv --columns gep").err, "did you mean 'gap'"));
}

TEST_F(CliFiles, TheToleranceOfTheFileIsTheDefault) {
  save("tolerance.toml", replaced(decay, "steps = 8", "tolerance = 1e-4"));
  EXPECT_EQ(solved("tolerance.toml")["errors"]["tolerance"], 1e-4);
  EXPECT_EQ(solved("tolerance.toml --tol 1e-3")["errors"]["tolerance"], 1e-3);
  const Json given = solved("tolerance.toml --steps 16");
  EXPECT_TRUE(given["errors"].is_null()) << "--steps fixes the grid";
  EXPECT_LT(given["certificate"]["error_of_x"], 1e-2);
}

// x' in -Sgn(x - 1/2), x(0) = 1: lambda = -1 until t = 1/2, sliding after it.
TEST_F(CliFiles, RelaysReportTheirSwitches) {
  save("relay.toml",
       "[dynamics]\nA = [[0]]\nB = [[1]]\nx0 = [1]\n[relay]\nC = [[1]]\ne = [-0.5]\n[time]\nT = 1\nsteps = 50\n");
  solved("relay.toml --method march --switches s.csv");
  const auto lines = split(read(folder_ / "s.csv"), '\n');
  ASSERT_EQ(lines.size(), 2u) << read(folder_ / "s.csv");
  EXPECT_EQ(lines[0], "t,relay,from,to,error");
  const auto cells = split(lines[1], ',');
  EXPECT_NEAR(std::stod(cells[0]), 0.5, std::stod(cells[4]) + 1e-9);
  EXPECT_EQ(cells[1] + cells[2] + cells[3], "0-10");
}

const std::string thermostat =
    "[parameters]\nlow = 0.9\n[dynamics]\nA = [[-1]]\nx0 = [1.1]\n[[memory]]\nname = \"heater\"\n"
    "[memory.modes.off]\nleave = [{ to = \"on\", when = \"x0 < low\" }]\n[memory.modes.on]\nf = [2]\n"
    "leave = [{ to = \"off\", when = \"x0 > 1.1\" }]\n[time]\nT = 0.5\n[output]\nstates = \"all\"\n";

TEST_F(CliFiles, ElementsWithMemory) {
  save("room.toml", thermostat);
  const Json json = solved("room.toml --tol-x 1e-6 --at 0.1,0.3 --out y.csv")["memories"][0];
  EXPECT_EQ(json["name"], "heater");
  EXPECT_EQ(json["modes"], Json::parse(R"(["off", "on"])"));
  ASSERT_EQ(json["changes"].size(), 2u);
  EXPECT_NEAR(json["changes"][0]["t"].get<double>(), std::log(1.1 / 0.9), 1e-9);
  EXPECT_EQ(json["changes"][1]["to"], "off");
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  EXPECT_EQ(lines[0], "t,x0,heater");
  EXPECT_EQ(split(lines[1], ',')[2], "0");
  EXPECT_EQ(split(lines[2], ',')[2], "1");
  EXPECT_NE(run("check room.toml").out.find("heater: off (to on), on (to off); begins with off"), std::string::npos);
  EXPECT_NE(run("solve room.toml").out.find("heater 2 changes, off at T"), std::string::npos);
  EXPECT_EQ(split(read(folder_ / "y.csv"), '\n').size(), 3u);
  solved("room.toml --columns heater --at 0.3 --out y.csv");
  EXPECT_EQ(read(folder_ / "y.csv"), "t,heater\n0.3,1\n");
}

TEST_F(CliFiles, ElementsWithMemoryInSweeps) {
  save("rooms.toml", thermostat + "[sweep]\nlow = [0.9, 0.8]\n");
  const Outcome sweep = run("solve rooms.toml --at 0.3 --out y.csv");
  ASSERT_EQ(sweep.exit_code, 0) << sweep.err;
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  ASSERT_EQ(lines.size(), 3u);
  // One heats from ln(1.1/0.9) on, the other not before ln(1.1/0.8) > 0.3. Of the default tolerance 1e-3.
  EXPECT_NEAR(std::stod(split(lines[1], ',')[5]), 2 - 1.1 * std::exp(-(0.3 - std::log(1.1 / 0.9))), 2e-3);
  EXPECT_NEAR(std::stod(split(lines[2], ',')[5]), 1.1 * std::exp(-0.3), 2e-3);
  EXPECT_NE(run("solve rooms.toml --columns heater --out y.csv").err.find("asks for heater with [sweep]"),
            std::string::npos);
}

TEST_F(CliFiles, TimesBetweenTimePointsAreAllowedWhereYJumps) {
  // A mass falls onto a stop at t = 1 and stays: y jumps from 0 to 1.
  save("stop.toml",
       "[dynamics]\nA = [[0, 1], [0, 0]]\nB = [[0], [1]]\nf = [0, -1]\nx0 = [0.5, 0]\n[complementarity]\nN = [[1, "
       "0]]\nM "
       "= [[0]]\n[time]\nT = 2\nsteps = 40\n");
  solved("stop.toml --at 0.333,1.777 --columns x0,w0 --out y.csv");
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  EXPECT_NEAR(std::stod(split(lines[1], ',')[1]), 0.5 - 0.333 * 0.333 / 2, 1e-12);
  EXPECT_NEAR(std::stod(split(lines[2], ',')[1]), 0, 1e-12);
  EXPECT_NEAR(std::stod(split(lines[1], ',')[1]), std::stod(split(lines[1], ',')[2]), 1e-15) << "w = x0";
  EXPECT_TRUE(contains(refused("solve stop.toml --at 0.1,2.5 --out y.csv").err,
                       "--at: found '2.5' in '0.1,2.5'; give times from 0 to T = 2"));
}

TEST_F(CliFiles, PrintsTheSchema) {
  const Outcome printed = run("solve --schema");
  EXPECT_EQ(printed.exit_code, 0);
  EXPECT_EQ(printed.out, read(fs::path(BROMWICH_EXAMPLES).parent_path() / "docs" / "scene.schema.json"));
}

TEST_F(CliFiles, UnknownParametersAreRefused) {
  EXPECT_TRUE(contains(refused("solve decay.toml --set x=3").err, "'x' is no parameter of decay.toml"));
  EXPECT_TRUE(contains(refused("solve decay.toml --set x0=nan").err, "finite"));
}

TEST_F(CliFiles, MistakesNameFileLineAndKey) {
  save("bad.toml", decay + "[boundary]\n");
  EXPECT_TRUE(contains(refused("solve bad.toml").err, "x0: is given with a section [boundary]; give one of the two"));
  EXPECT_TRUE(contains(refused("solve none.toml").err, "SCENE: the file 'none.toml' does not exist"));
  EXPECT_TRUE(contains(refused("solve .").err, "SCENE"));
  EXPECT_TRUE(contains(refused("solve ./").err, "is a folder"));
}

TEST_F(CliFiles, BoundaryValuesAreSolvedByShooting) {
  const Json json = solved("periodic-rectifier --steps 40 --states all --out y.csv");
  EXPECT_EQ(json["method"], "shooting");
  ASSERT_EQ(json["multipliers"].size(), 1u);
  EXPECT_EQ(json["multipliers"][0][1], 0.0);
  EXPECT_LE(json["boundary_residual"], 1e-12);  // |v| < 10, one subtraction
  EXPECT_TRUE(solved("decay.toml")["boundary_residual"].is_null());
  const auto lines = split(read(folder_ / "y.csv"), '\n');
  ASSERT_EQ(lines.size(), 42u);
  EXPECT_EQ(lines[0], "t,y0,x0");
  EXPECT_NEAR(std::stod(split(lines[1], ',')[2]), std::stod(split(lines[41], ',')[2]), 1e-11) << "v(0) = v(T)";
  const Outcome summary = run("solve periodic-rectifier --steps 40");
  EXPECT_TRUE(contains(summary.out, "of the boundary condition")) << summary.out;
  const Outcome march = run("solve periodic-rectifier --method march");
  EXPECT_EQ(march.exit_code, 3);
  EXPECT_TRUE(contains(march.err,
                       "unsupported: it needs initial values and the scene has boundary values; use method "
                       "shooting or galerkin"))
      << march.err;
}

TEST_F(CliFiles, BoundaryConditionsThatDetermineNothingAreRefused) {
  std::string text = decay;
  text.replace(text.find("x0 = [\"x0\"]\n"), 12, "");
  save("twice.toml", text + "[boundary]\nE0 = [[1]]\nET = [[\"-exp(1)\"]]\nb = [0]\n");  // x(0) = e x(1), always
  EXPECT_TRUE(contains(refused("solve twice.toml").err, "boundary: E0 + ET e^{TA} is singular"));
  save("wide.toml", text + "[boundary]\nE0 = [[1, 2]]\nb = [0]\n");
  EXPECT_TRUE(contains(refused("solve wide.toml").err, "boundary.E0: is 1 x 2; give 1 x 1")) << "wide";
  save("open.toml", text + "[boundary]\nE0 = [[0]]\nb = [0]\n");
  EXPECT_TRUE(contains(refused("solve open.toml").err, "boundary: row 0 of E0 and ET is zero"));
  save("nan.toml", text + "[boundary]\nE0 = [[1]]\nb = [\"0/0\"]\n");
  EXPECT_TRUE(contains(refused("solve nan.toml").err, "boundary.b: '0/0' is not a number"));
}

// Two states and two rows; the second row does not depend on the state.
std::string two_rows(const std::string& M, const std::string& g, const std::string& rest) {
  return "[dynamics]\nA = [[-1, 0], [0, -2]]\nB = [[1, 0], [0, 1]]\n[complementarity]\nN = [[1, 0], [0, 0]]\nM = " + M +
         "\ng = " + g + "\n[time]\nT = 1\nsteps = 400\n" + rest;
}

TEST_F(CliFiles, BoundaryProblemsWithoutASolutionSayWhy) {
  const std::string ends = "[boundary]\nE0 = [[1, 0], [0, 0]]\nET = [[0, 0], [0, 1]]\nb = [0, 0]\n";
  save("rows.toml", two_rows("[[1, 0], [0, 1]]", "[0, 0]", "[boundary]\nE0 = [[1, 0], [2, 0]]\nb = [1, 3]\n"));
  EXPECT_TRUE(contains(refused("solve rows.toml").err,
                       "boundary: the rows of [E0 ET] have rank 1 of 2 and b contradicts them; give independent"));
  save("open.toml", two_rows("[[1, 0], [0, 0]]", "[0, 1]", ends + "[free]\nrows = [1]\n"));
  EXPECT_TRUE(contains(refused("solve open.toml").err,
                       "free_rows: the equations of the free rows do not determine the free unknowns of an interval"));
  // g is negative in one interval of 400.
  save("infeasible.toml", two_rows("[[1, 0], [-1, 0]]", "[0, \"(t - 0.4025) * (t - 0.405)\"]", ends));
  const Outcome outcome = run("solve infeasible.toml --states all --at 0.1,0.331 --out y.csv");
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_EQ(outcome.err,
            "bromwich: infeasible: no state and no y satisfy the constraints in the interval that begins at t = "
            "0.4025\n");
  EXPECT_EQ(read(folder_ / "y.csv"),
            "t,y0,y1,x0,x1\n# ended before t = 0: infeasible, no state and no y satisfy the "
            "constraints in the interval that begins at t = 0.4025\n");
}

TEST_F(CliFiles, FreeRowsHaveNoSwitches) {
  const std::string node = std::string(BROMWICH_EXAMPLES) + "/rectifier-node.toml";
  const Json json = solved(node + " --out y.csv --switches s.csv");
  EXPECT_EQ(json["method"], "march");
  EXPECT_TRUE(contains(json["class"], "free rows eliminated")) << json["class"];
  const auto lines = split(read(folder_ / "s.csv"), '\n');
  ASSERT_GT(lines.size(), 4u);
  for (std::size_t i = 1; i < lines.size(); ++i) EXPECT_EQ(split(lines[i], ',')[1], "1") << lines[i];
}

TEST_F(CliFiles, ErrorAgainstTheExactSolution) {
  save("exact.toml", decay + exact);
  const Json march = solved("exact.toml --method march")["reference_error"];
  EXPECT_LT(march["x"], 1e-12);  // as above
  EXPECT_EQ(march["y"], 0);
  // Implicit Euler after 8 steps: 2 ((8/9)^8 - 1/e) = 4.3e-2 at t = 1, where the error is largest.
  const double error = 2 * (std::pow(8. / 9, 8) - std::exp(-1));
  EXPECT_NEAR(solved("exact.toml --method euler")["reference_error"]["x"], error, 1e-12);
  // A small state is compared even if it was not requested.
  EXPECT_NEAR(solved("exact.toml --method euler --states none")["reference_error"]["x"], error, 1e-12);
  EXPECT_TRUE(contains(run("solve exact.toml").out, "\nreference ")) << run("solve exact.toml").out;
}

TEST_F(CliFiles, ErrorAgainstReferenceValues) {
  save("reference.toml", decay + "[reference]\nt = 0.5\nx = [1]\ny = [nan]\ntolerance = 0.5\nsource = \"by hand\"\n");
  for (const std::string states : {"all", "none"}) {  // without states, x is computed only at that time
    const Json json = solved("reference.toml --method march --states " + states);
    EXPECT_NEAR(json["reference_error"]["x"], 2 * std::exp(-0.5) - 1, 1e-12) << states;
    EXPECT_TRUE(json["reference_error"]["y"].is_null());
    EXPECT_EQ(json["reference"]["tolerance"], 0.5);
    EXPECT_EQ(json["reference"]["status"], "solved");
    EXPECT_EQ(json["reference"]["source"], "by hand");
  }
  // Five steps have no point at 0.5: the value is linear between 0.4 and 0.6.
  const double between = std::exp(-0.4) + std::exp(-0.6);
  EXPECT_NEAR(solved("reference.toml --method march --steps 5")["reference_error"]["x"], between - 1, 1e-12);
  // Reference values hold for the parameters of the file only.
  EXPECT_TRUE(solved("reference.toml --set x0=3")["reference_error"].is_null());
}

TEST_F(CliFiles, BuiltInScenesHaveExactSolutionsToo) {
  const Json json = solved("dlcp-small --method march --states all");
  // 400 steps, second order, kinks between time points: of the order h = 2.5e-3 at worst.
  EXPECT_LT(json["reference_error"]["x"], 2.5e-3);
  EXPECT_LT(json["reference_error"]["y"], 2.5e-2);
  EXPECT_TRUE(solved("signorini --set Q=7 --steps 8")["reference_error"].is_null());
}

TEST_F(CliFiles, TemplateIsTheExampleAndCanBeSolved) {
  const Outcome printed = run("solve --template > my.toml");
  EXPECT_EQ(printed.exit_code, 0) << printed.err;
  EXPECT_EQ(read(folder_ / "my.toml"), read(fs::path(BROMWICH_EXAMPLES) / "template.toml"));
  const Json json = solved("my.toml");
  EXPECT_EQ(json["scene"], "rlcd");
  EXPECT_LT(json["reference_error"]["x"], json["reference"]["tolerance"]);
  EXPECT_LT(json["reference_error"]["y"], json["reference"]["tolerance"]);
}

TEST_F(CliFiles, BaselinesTakeSceneFiles) {
  save("exact.toml", decay + exact);
  const Outcome result = run("bench baselines exact.toml --quick --threads 1 --out b.json");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(Json::parse(read(folder_ / "b.json"))["scene"], "exact.toml");
}

}  // namespace
}  // namespace bromwich
