// Bad input of the command: one line that says what was found and what to do, and exit code 2.

#include "kernels/cuda_backend.hpp"
#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich::cli_refusals {
namespace {

/// Small enough that every solve of these tests takes milliseconds.
const std::string small = "solve signorini --set Q=7 --steps 20 --threads 1";

TEST_F(Cli, RefusesBadInputInOneLine) {
  const std::vector<BadInput> cases{
      {"", {"command", "solve"}},
      {"sovle", {"sovle", "solve"}},
      {"--bogus", {"--bogus"}},
      {"help", {"did you mean '--help'"}},
      {"sweep mine.toml", {"did you mean 'solve'"}},
      {"solve signorini --tolerance 1e-3", {"--tolerance", "did you mean '--tol'"}},
      {"solve signorini --gpu", {"--gpu", "did you mean '--backend'"}},
      {"scenes extra", {"extra"}},
      {"info --json", {"--json"}},
      {"solve", {"SCENE", "bromwich scenes"}},
      {"solve signorni", {"SCENE", "signorni", "did you mean 'signorini'", "bridge"}},
      {"solve ./mine.toml", {"mine.toml"}},
      {"solve signorini --steps", {"--steps: found no value; give one; see 'bromwich solve --help'"}},
      {"solve mine.TOML", {"mine.TOML"}},
      {"bench baselines mine.toml", {"mine.toml"}},
      {"solve --template signorini", {"--template", "alone"}},
      {"solve signorini bridge", {"SCENE", "bridge"}},
      {"solve ''", {"SCENE"}},
      {"solve \"$(printf 'two\\nlines')\"", {"SCENE", "two lines"}},
      {"solve signorini --bogus", {"--bogus", "--help"}},
      {"solve signorini --step 5", {"--step", "--steps"}},
      {"solve signorini --json=perhaps", {"--json", "perhaps"}},
      {"solve signorini --set", {"--set"}},
      {"solve signorini --set Q", {"--set", "'Q'", "key=value"}},
      {"solve signorini --set =3", {"--set", "=3", "key=value"}},
      {"solve signorini --set Q=", {"--set", "Q", "number"}},
      {"solve signorini --set Q=nan", {"--set", "nan", "finite"}},
      {"solve signorini --set 'Q = '", {"--set", "value of Q", "number"}},
      {"solve signorini --set 'q = 9'", {"--set", "'q'", "did you mean 'Q'"}},
      {"solve signorini --set T=inf", {"--set", "inf", "finite"}},
      {"solve signorini --set T=1e999", {"--set", "1e999"}},
      {"solve signorini --set Q=3x", {"--set", "3x"}},
      {"solve signorini --set Q=2*k", {"--set", "2*k", "'k'", "not defined", "settings before it"}},
      {"solve signorini --set T=1/0", {"--set", "1/0", "infinite"}},
      {"solve signorini --method automatic", {"--method", "automatic", "did you mean 'auto'"}},
      {"solve signorini --method radau", {"--method", "did you mean 'march'"}},
      {"solve signorini --backend gpu", {"--backend", "gpu", "did you mean 'cuda'", "auto, cpu or cuda"}},
      {"solve signorini --steps 1e6.5", {"--steps", "1e6.5", "integer"}},
      {"solve signorini --steps 1.5e0", {"--steps", "1.5e0", "integer"}},
      {"solve signorini --columns y", {"--columns", "without --out"}},
      {"solve signorini --out y.csv --columns z", {"--columns", "'z'", "y, w, trace, x"}},
      {"solve signorini --out y.csv --columns y0,y0", {"--columns", "y0 is given twice"}},
      {"solve signorini --out y.csv --columns y39", {"--columns", "'y39'"}},
      {"solve signorini --schema", {"--schema", "alone"}},
      {"solve --template --schema", {"--template", "--schema"}},
      {"solve signorini --set Q=3 --set Q=5", {"--set", "Q", "twice"}},
      {"solve signorini --set R=1", {"--set", "'R'", "Q", "dx", "c", "T"}},
      {"solve signorini --set q=9", {"--set", "'q'", "did you mean 'Q'"}},
      {"solve signorini Q=9", {"Q=9", "--set Q=9"}},
      {"solve signorini --set Q=0", {"Q", "0"}},
      {"solve signorini --set Q=2.5", {"Q", "2.5"}},
      {"solve signorini --set T=-1", {"T", "-1"}},
      {"solve signorini --set Q=7 dx=0.125", {"dx"}},
  };
  for (const BadInput& bad : cases) {
    const Outcome result = refused(bad.arguments);
    for (const std::string& word : bad.mentions) EXPECT_TRUE(contains(result.err, word)) << word << "\n" << result.err;
  }
}

TEST_F(Cli, SuggestsAFileWithoutItsExtension) {
  ASSERT_EQ(run("solve --template > rc.toml").exit_code, 0);
  EXPECT_TRUE(contains(refused("solve rc").err, "did you mean 'rc.toml'"));
}

TEST_F(Cli, RefusesBadOptionValues) {
  std::vector<BadInput> cases{
      {"--steps 0", {"--steps", "'0'", "integer from 1"}},
      {"--steps -4", {"--steps", "'-4'"}},
      {"--steps 2.5", {"--steps", "'2.5'"}},
      {"--steps nan", {"--steps", "'nan'"}},
      {"--steps 16777217", {"--steps", "16777217", "16777216"}},
      {"--steps 99999999999999999999", {"--steps"}},
      {"--steps ''", {"--steps", "empty"}},
      {"--steps", {"--steps"}},
      {"--steps 3 --steps 4", {"--steps"}},
      {"--threads 0", {"--threads", "'0'"}},
      {"--threads 4097", {"--threads", "4097", "4096"}},
      {"--threads many", {"--threads", "many"}},
      {"--iteration-tol 0", {"--iteration-tol", "'0'"}},
      {"--nodes 25", {"--nodes", "--method contour-literal"}},
      {"--method contour-literal --nodes 1", {"--nodes", "'1'", "2 to 400"}},
      {"--iteration-tol 1", {"--iteration-tol", "'1'"}},
      {"--iteration-tol -1e-3", {"--iteration-tol", "'-1e-3'"}},
      {"--iteration-tol nan", {"--iteration-tol", "nan"}},
      {"--iteration-tol inf", {"--iteration-tol", "inf"}},
      {"--tol 0", {"--tol", "'0'", "between 0 and 1"}},
      {"--tol 1", {"--tol", "'1'"}},
      {"--tol -1e-3", {"--tol", "'-1e-3'"}},
      {"--tol nan", {"--tol", "nan"}},
      {"--tol small", {"--tol", "small", "1e-4"}},
      {"--method goal", {"method", "goal", "port-Hamiltonian"}},
      {"--method marsh", {"--method", "marsh", "did you mean 'march'"}},
      {"--backend gpu", {"--backend", "gpu"}},
      {"--states 1521", {"--states", "1521", "1520"}},
      {"--states -1", {"--states", "'-1'"}},
      {"--states 1,1", {"--states", "twice"}},
      {"--states 1,,2", {"--states", "1,,2"}},
      {"--states 1,", {"--states", "'1,'"}},
      {"--states some", {"--states", "some", "all, none"}},
      {"--report a.txt", {"--report", "a.txt", ".html"}},
      {"--at 1", {"--at", "without --out"}},
      {"--at 1,5 --out y.csv", {"--at", "1,5", "T = 4"}},
      {"--at 1, --out y.csv", {"--at", "'1,'"}},
      {"--at -1 --out y.csv", {"--at", "-1"}},
      {"--switches s.txt", {"--switches", "s.txt", ".csv"}},
      {"--switches a.csv --out a.csv", {"--switches", "a.csv", "--out"}},
      {"--out .h5", {"--out", ".h5", ".csv"}},
      {"--out y.txt", {"--out", "y.txt", ".csv"}},
      {"--out y", {"--out", ".csv"}},
      {"--out --json", {"--out", "--json"}},
      {"--out missing/y.csv", {"--out", "missing"}},
  };
  if (cuda_devices().empty()) cases.push_back({"--backend cuda", {"--backend", "no CUDA", "use --backend cpu"}});
  for (const BadInput& bad : cases) {
    const Outcome result = refused("solve signorini " + bad.arguments);
    for (const std::string& word : bad.mentions) EXPECT_TRUE(contains(result.err, word)) << word << "\n" << result.err;
  }
  EXPECT_EQ(files(), 0u);
}

TEST_F(Cli, RefusesStepsThatCannotFitIntoMemory) {
  // 2^24 steps of 4095 constraints: more than 2 TB for five arrays.
  const Outcome result = refused("solve signorini --set Q=4095 --steps 16777216");
  EXPECT_TRUE(contains(result.err, "--steps"));
}

TEST_F(Cli, RefusesBadBenchInput) {
  EXPECT_TRUE(contains(refused("bench").err, "baselines"));
  EXPECT_TRUE(contains(refused("bench baseline").err, "did you mean 'baselines'"));
  EXPECT_TRUE(contains(refused("bench speed").err, "convolution"));
  EXPECT_TRUE(contains(refused("bench baselines signorni").err, "signorini"));
  EXPECT_TRUE(contains(refused("bench baselines signorini bridge").err, "SCENE"));
  EXPECT_TRUE(contains(refused("bench convolution bridge").err, "signorini"));
  EXPECT_TRUE(contains(refused("bench convolution --steps 9").err, "--steps"));
  EXPECT_TRUE(contains(refused("bench baselines --steps 0").err, "--steps"));
  EXPECT_TRUE(contains(refused("bench baselines --threads 0").err, "--threads"));
  EXPECT_TRUE(contains(refused("bench baselines --out a.csv").err, ".json"));
  EXPECT_TRUE(contains(refused("bench baselines --backend cpu").err, "'baselines'"));
  EXPECT_TRUE(contains(refused("bench dual --backend gpu").err, "did you mean 'cuda'"));
}

TEST_F(Cli, RefusesAnOutputThatIsNoRegularFile) {
  fs::create_directory(folder_ / "folder.csv");
  EXPECT_TRUE(contains(refused(small + " --out folder.csv").err, "regular"));
  if (::geteuid() == 0) GTEST_SKIP() << "the superuser may write everywhere";
  std::ofstream(folder_ / "locked.csv") << "precious";
  fs::permissions(folder_ / "locked.csv", fs::perms::owner_read);
  EXPECT_TRUE(contains(refused(small + " --out locked.csv").err, "write-protected"));
  EXPECT_EQ(read(folder_ / "locked.csv"), "precious");
}

}  // namespace
}  // namespace bromwich::cli_refusals
