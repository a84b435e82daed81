// Method goal and energies through the command.

#include "files/scene_file.hpp"
#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

using Json = nlohmann::json;
using CliGoal = Cli;

TEST_F(CliGoal, WritesGridStatesEnergiesAndHistory) {
  const Outcome result =
      run("solve ph-toy --method goal --steps 60 --adjoint doubling --states 0,2 --energies --out x.csv --json");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const Json json = Json::parse(result.out);
  EXPECT_EQ(json["status"], "solved");
  EXPECT_EQ(json["method"], "goal");
  EXPECT_EQ(json["steps"], 60);
  EXPECT_EQ(json["class"], "no constraints");
  const Json& goal = json["goal"];
  EXPECT_EQ(goal["quantity"], "loc");
  EXPECT_EQ(goal["scheme"], "euler");
  EXPECT_EQ(goal["exact"], 0);
  EXPECT_EQ(goal["history"].size(), json["cycles"].get<std::size_t>() + 1);
  for (const Json& cycle : goal["history"]) {
    EXPECT_GE(cycle["estimate_absolute"], std::abs(cycle["estimate"].get<double>()) * (1 - 1e-12));
    EXPECT_NEAR(cycle["effectivity"], cycle["estimate"].get<double>() / cycle["quantity"].get<double>(), 1e-12);
  }
  const auto lines = split(read(folder_ / "x.csv"), '\n');
  ASSERT_EQ(lines.size(), 62u);
  EXPECT_EQ(lines[0], "t,x0,x2,energy,supplied_power,dissipated_power,supplied,dissipated,violation");
  EXPECT_EQ(lines[1], "0,1,1,3,0,9,0,0,0");
  double sum = 0, energy = 0;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto words = split(lines[i], ',');
    sum += std::stod(words[7]) - std::stod(words[6]) - std::stod(words[8]);
    energy = std::stod(words[3]);
  }
  EXPECT_NEAR(energy, 3 - sum, 1e-9);  // the balance with its violation, as it was printed
  EXPECT_TRUE(contains(run("solve ph-toy --method goal --steps 60").out, "quantity    loc"));
}

TEST_F(CliGoal, TakesEveryQuantityAndScheme) {
  for (const char* arguments :
       {"--quantity glob --scheme midpoint", "--quantity loc+10 --scheme exponential --cycles 3",
        "--quantity loc --adjoint jacobi:2 --weights interpolated --marking 0.3",
        "--quantity loc --weights global --tol 1e-2"}) {
    const Outcome result = run(std::string("solve ph-toy --method goal --json ") + arguments);
    EXPECT_EQ(result.exit_code, 0) << arguments << result.err;
    EXPECT_EQ(Json::parse(result.out)["status"], "solved");
  }
}

// x' = -x, x(0) = 1: the integral of x^2 over [0, 1] is (1 - e^-2)/2, of t x 1 - 2/e; x(1) = 1/e.
TEST_F(CliGoal, SolvesForTheQuantityOfAFile) {
  if (!scene_files_available()) GTEST_SKIP() << "this build reads no scene files";
  const std::string scene = "[port]\nJ = [[0]]\nR = [[1]]\nx0 = [1]\n[time]\nT = 1\nsteps = 50\n[quantity]\n";
  const auto tried = [&](const std::string& quantity, const std::string& arguments) {
    std::ofstream(folder_ / "q.toml") << scene + quantity;
    const Outcome result = run("solve q.toml --method goal --json " + arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return Json::parse(result.out)["goal"];
  };
  Json goal = tried("name = \"square\"\nW = [[1]]\nexact = \"(1-exp(-2))/2\"\n", "--tol 1e-4 --scheme midpoint");
  EXPECT_EQ(goal["quantity"], "square");
  EXPECT_NEAR(goal["history"].back()["quantity"], (1 - std::exp(-2)) / 2, 1e-4);
  EXPECT_NEAR(goal["history"].back()["effectivity"], 1, 0.1);
  goal = tried("W = [[1e6]]\nexact = \"1e6*(1-exp(-2))/2\"\n", "--tol 100 --scheme midpoint");  // absolute
  EXPECT_NEAR(goal["history"].back()["quantity"], 1e6 * (1 - std::exp(-2)) / 2, 100);
  goal = tried("c = [\"t\"]\nend_c = [2]\nend_W = [[3]]\n", "--tol 1e-5 --scheme exponential");
  EXPECT_NEAR(goal["history"].back()["quantity"], 1 - 2 * std::exp(-1) + 2 * std::exp(-1) + 3 * std::exp(-2), 1e-5);
  EXPECT_EQ(goal["exact"], nullptr);
  goal = tried("end_c = [1]\n", "--quantity loc");
  EXPECT_EQ(goal["quantity"], "loc");
  for (const auto& [quantity, mention] :
       {std::pair("W = [[1, 0], [0, 1]]\n", "q.toml:9: quantity.W: is 2 x 2; give 1 x 1"),
        std::pair("end_c = [1, 2]\n", "q.toml:9: quantity.end_c: has 2 entries"),
        std::pair("c = [\"t\", \"t\"]\n", "q.toml:9: quantity.c: has 2 entries; give 1"),
        std::pair("end_x = [1]\n", "q.toml:9: quantity.end_x: is no known key"),
        std::pair("exact = 1\n", "q.toml:8: quantity.W: has neither an integral nor an end value")}) {
    std::ofstream(folder_ / "q.toml") << scene + quantity;
    EXPECT_TRUE(contains(refused("solve q.toml --method goal").err, mention)) << refused("solve q.toml").err;
  }
  EXPECT_TRUE(contains(refused("solve ph-toy --method goal --quantity file").err, "states no quantity"));
}

TEST_F(CliGoal, SaysWhatIsWrongWithAPort) {
  if (!scene_files_available()) GTEST_SKIP() << "this build reads no scene files";
  // Messages name the file like a member of a scene; no location appears twice.
  const auto said = [&](const std::string& port, const std::string& more = "") {
    std::ofstream(folder_ / "f.toml") << "[port]\n" + port + "[time]\nT = 1\n" + more;
    return refused("solve f.toml --method goal --steps 30").err;
  };
  const std::string structure = "J = [[0, 1], [-1, 0]]\nR = [[1, 0], [0, 0]]\n", start = "x0 = [1, 2]\n";
  EXPECT_EQ(said(structure), "bromwich: f.toml:1: port.x0: is missing; add x0 = ... to [port]\n");
  EXPECT_TRUE(contains(said(structure + start + "u = [\"t\"]\n"), "port.B: is missing beside u"));
  EXPECT_TRUE(contains(said("J = [[0, 1]]\nR = [[1]]\n" + start), "f.toml:2: port.J: is 1 x 2; give a square matrix"));
  EXPECT_TRUE(contains(said("E = [[1, 0], [0, 0]]\nJ = [[0, 0], [0, 0]]\nR = [[1, 0], [0, 0]]\n" + start),
                       "f.toml:2: port.E: is singular, of rank 1 of 2, and det(s E - (J - R) Q) = 0 for all s"));
}

TEST_F(CliGoal, EndsWithAStatusWhereStepsCannotBeSolved) {
  if (!scene_files_available()) GTEST_SKIP() << "this build reads no scene files";
  std::ofstream(folder_ / "f.toml")
      << "[port]\nJ = [[0, 1], [-1, 0]]\nR = [[1, 0], [0, 0]]\nx0 = [1, 2]\n[time]\nT = 1\n"
         "[dynamics]\nB = [[-1], [0]]\n[complementarity]\nN = [[-1, 0]]\nM = [[1]]\n"
         "g = [\"sqrt(0.5-t)\"]\n";
  const Outcome ended = run("solve f.toml --method goal --steps 30 --energies --out e.csv --json");
  EXPECT_EQ(ended.exit_code, 3);
  EXPECT_TRUE(contains(ended.err, "nonfinite: the problem of the step to t = 0.55 is not finite on 20 cells"));
  EXPECT_EQ(Json::parse(ended.out)["goal"]["energy"], nullptr);
  EXPECT_TRUE(run("solve f.toml --method goal --steps 30").exit_code == 3);
  const auto lines = split(read(folder_ / "e.csv"), '\n');
  EXPECT_EQ(lines[0], "t,y0");  // no energies of a grid that was not finished
  EXPECT_TRUE(lines.back().starts_with("# ended ")) << lines.back();
}

TEST_F(CliGoal, EnergiesOfOtherMethods) {
  const Outcome result = run("solve ph-toy --method march --steps 100 --states all --energies --out x.csv");
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_TRUE(read(folder_ / "x.csv")
                  .starts_with("t,x0,x1,x2,energy,supplied_power,dissipated_power,supplied,dissipated,violation\n"
                               "0,1,2,1,3,0,9,0,0,0\n"));
  for (const std::string& line : split(read(folder_ / "x.csv"), '\n')) {  // u (x0 + x1) and (x0 + x1)^2, variant 1
    if (line.empty() || line[0] == 't') continue;
    const auto words = split(line, ',');
    const double t = std::stod(words[0]), sum = std::stod(words[1]) + std::stod(words[2]);
    EXPECT_NEAR(std::stod(words[5]), t > 5 ? 10 * sum : 0, 1e-12 * (1 + std::abs(sum)));
    EXPECT_NEAR(std::stod(words[6]), sum * sum, 1e-12 * (1 + sum * sum));
  }
}

TEST_F(CliGoal, RefusesBadInput) {
  for (const auto& [arguments, mentions] :
       std::vector<BadInput>{{"solve ph-toy --cycles 3", {"--cycles", "with method auto", "--method goal"}},
                             {"solve ph-toy --method goal --cycles 0", {"--cycles", "'0'"}},
                             {"solve ph-toy --method goal --quantity energy", {"--quantity", "'energy'", "loc+RHO"}},
                             {"solve ph-toy --method goal --quantity loc+-1", {"--quantity", "'loc+-1'"}},
                             {"solve ph-toy --method goal --adjoint jacobi:0", {"--adjoint", "'jacobi:0'", "doubling"}},
                             {"solve ph-toy --method goal --scheme rk4", {"--scheme", "'rk4'", "midpoint"}},
                             {"solve ph-toy --method goal --marking 2", {"--marking", "'2'", "0.5"}},
                             {"solve ph-toy --method goal --weights all", {"--weights", "'all'", "global"}},
                             {"solve signorini --method goal", {"method", "port-Hamiltonian", "signorini"}},
                             {"solve ph-toy --method goal --out x.csv --at 1", {"--at", "method goal"}},
                             {"solve ph-toy --method march --energies --out x.csv", {"--energies", "--states all"}},
                             {"solve bridge --energies --out x.csv", {"--energies", "not port-Hamiltonian"}},
                             {"solve ph-toy --energies", {"--energies", "--out"}},
                             {"solve ph-toy --set variant=4", {"variant", "1, 2 or 3"}},
                             {"solve ladder --set n=0", {"n", "integer from 1"}}}) {
    const std::string line = refused(arguments).err;
    for (const std::string& word : mentions) EXPECT_TRUE(contains(line, word)) << arguments << "\n" << line;
  }
}

}  // namespace
}  // namespace bromwich
