// `bromwich derivative` against differences of solves by the command itself, its files, and its refusals.

#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

using DerivativeJson = nlohmann::json;

class CliDerivative : public Cli {
 protected:
  // The column of a solve with these settings in its last row.
  double solved(const std::string& arguments) const {
    const Outcome r = run("solve " + arguments + " --out s.csv");
    EXPECT_EQ(r.exit_code, 0) << r.err;
    auto lines = split(read(folder_ / "s.csv"), '\n');
    while (!lines.empty() && lines.back().empty()) lines.pop_back();
    return std::stod(split(lines.back(), ',').back());
  }
  DerivativeJson derivative(const std::string& arguments) const {
    const Outcome r = run("derivative " + arguments + " --json");
    EXPECT_EQ(r.exit_code, 0) << r.err;
    return DerivativeJson::parse(r.out);
  }
};

TEST_F(CliDerivative, AgreesWithDifferencesOfSolves) {
  ASSERT_EQ(run("solve --template > t.toml").exit_code, 0);
  const std::string scene = "t.toml --steps 400 --method march --threads 1 --columns v_C --at 1e-3";
  const DerivativeJson json = derivative(scene + " --by R,C");
  EXPECT_EQ(json["schema"], "bromwich-derivative/1");
  EXPECT_EQ(json["form"], "discrete solution");
  for (const std::string name : {"R", "C"}) {
    const double p = json["parameters"][name];
    const auto at = [&](double by) {
      return solved(scene + " --set " + name + "=" + DerivativeJson(p * (1 + by)).dump());
    };
    const double step = 1e-5, difference = (at(step) - at(-step)) / (2 * step * p);
    EXPECT_NEAR(json["derivatives"][name]["v_C"][0].get<double>(), difference, 1e-6 * std::abs(difference)) << name;
  }
  EXPECT_NEAR(json["values"]["v_C"][0].get<double>(), solved(scene), 1e-12);
}

// A relay: lambda jumps, and switches are located. The solves locate them too.
TEST_F(CliDerivative, FollowsSwitches) {
  const std::string scene = BROMWICH_EXAMPLES "/fit/friction.toml --threads 1 --columns x0 --at 5";
  const DerivativeJson json = derivative(scene + " --by mu,k");
  EXPECT_EQ(json["form"], "located switches");
  EXPECT_TRUE(json["margin"].contains("transversality"));
  for (const std::string name : {"mu", "k"}) {
    const double p = json["parameters"][name];
    const auto at = [&](double by) {
      return solved(scene + " --method events --set " + name + "=" + DerivativeJson(p * (1 + by)).dump());
    };
    const double step = 1e-4, difference = (at(step) - at(-step)) / (2 * step * p);
    EXPECT_NEAR(json["derivatives"][name]["x0"][0].get<double>(), difference, 1e-4 * std::abs(difference)) << name;
  }
}

// Examples that start with y_i = w_i = 0, or where constraints switch together, and boundary-value problems.
// Differences with a relative step of 1e-5 have an error of about its square, and the tolerance of the solves over it.
TEST_F(CliDerivative, AgreesOnExamples) {
  struct Example {
    std::string file, parameter, column, at, method;
  };
  for (const Example& e : {Example{"diode-bridge", "L", "x0", "4.7e-3", "events"},
                           {"diode-bridge", "R", "x1", "3.3e-3", "events"},
                           {"relay-oscillator", "v", "x2", "9.5", "events"},
                           {"relay-sliding", "omega", "x2", "19.3", "events"},
                           {"lq-control", "bound", "y1", "0.9", "shooting"},
                           {"periodic-rectifier", "C", "x0", "0.013", "shooting"}}) {
    const std::string scene =
        BROMWICH_EXAMPLES "/" + e.file + ".toml --threads 1 --columns " + e.column + " --at " + e.at;
    const DerivativeJson json = derivative(scene + " --by " + e.parameter);
    const double p = json["parameters"][e.parameter], step = 1e-5;
    const auto at = [&](double by) {
      return solved(scene + " --method " + e.method + " --set " + e.parameter + "=" +
                    DerivativeJson(p * (1 + by)).dump());
    };
    const double difference = (at(step) - at(-step)) / (2 * step * p);
    EXPECT_NEAR(json["derivatives"][e.parameter][e.column][0].get<double>(), difference, 1e-6 * std::abs(difference))
        << e.file << " by " << e.parameter;
  }
}

TEST_F(CliDerivative, WritesATableAndCurves) {
  std::ofstream(folder_ / "decay.toml") << decay << "[quantity]\nend_c = [1]\n";
  const Outcome r = run("derivative decay.toml --by x0 --columns x --out d.csv --threads 1");
  ASSERT_EQ(r.exit_code, 0) << r.err;
  EXPECT_TRUE(contains(r.out, "derivative of the discrete solution, data of the scene by central differences"))
      << r.out;
  EXPECT_TRUE(contains(r.out, "d/dx0 at 2")) << r.out;
  const auto lines = split(read(folder_ / "d.csv"), '\n');
  EXPECT_EQ(lines[0], "t,x0,dx0/dx0");
  ASSERT_GE(lines.size(), 10u);
  const auto last = split(lines[9], ',');
  EXPECT_NEAR(std::stod(last[1]), 2 * std::exp(-1.0), 1e-12);
  EXPECT_NEAR(std::stod(last[2]), std::exp(-1.0), 1e-10);
  const DerivativeJson json = derivative("decay.toml --by x0 --threads 1");
  EXPECT_NEAR(json["quantity"]["value"].get<double>(), 2 * std::exp(-1.0), 1e-12);
  EXPECT_NEAR(json["quantity"]["derivatives"]["x0"].get<double>(), std::exp(-1.0), 1e-10);
}

TEST_F(CliDerivative, Refuses) {
  std::ofstream(folder_ / "decay.toml") << decay;
  const auto code_and_words = [&](const std::string& arguments) {
    const Outcome r = run("derivative " + arguments + " --threads 1");
    EXPECT_EQ(split(r.err, '\n').size(), 1u) << r.err;
    return std::to_string(r.exit_code) + " " + r.err;
  };
  EXPECT_TRUE(contains(code_and_words("decay.toml --by x1"),
                       "2 bromwich: --by: 'x1' is no parameter of the scene (did you mean 'x0'?)"));
  EXPECT_TRUE(contains(code_and_words("decay.toml"), "2 bromwich: --by: found none"));
  EXPECT_TRUE(contains(code_and_words("decay.toml --by x0,x0"), "given twice"));
  EXPECT_TRUE(contains(code_and_words("decay.toml --by x0 --columns trace0"), "--columns: found trace0"));
  EXPECT_TRUE(contains(code_and_words("signorini --set Q=7 --steps 20 --by Q"),
                       "3 bromwich: derivative: by Q: there is no scene with Q = "));
  std::string kink = decay;
  kink.replace(kink.find("[\"x0\"]"), 6, "[\"abs(x0-2)\"]");
  std::ofstream(folder_ / "kink.toml") << kink;
  EXPECT_TRUE(contains(code_and_words("kink.toml --by x0"),
                       "3 bromwich: derivative: by x0: x0 is not differentiable at x0 = 2"));
}

}  // namespace
}  // namespace bromwich
