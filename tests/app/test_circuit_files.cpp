// The command with netlists.

#include "tests/app/cli.hpp"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <cmath>

namespace bromwich {
namespace {

class CliCircuit : public Cli {
 protected:
  void write(const std::string& name, const std::string& text) const { std::ofstream(folder_ / name) << text; }
  std::string file(const std::string& name) const { return read(folder_ / name); }
};

TEST_F(CliCircuit, CheckPrintsTheReducedSystem) {
  write("c.cir",
        "loops\nV1 a 0 PWL(0 0 1m 10)\nC1 a b 1u\nC2 b 0 3u\nD1 b 0 DJ\n.model DJ D(Is=1p N=2)\n.save V(a)\n"
        ".tran 1m uic\n");
  const Outcome found = run("check c.cir");
  EXPECT_EQ(found.exit_code, 0) << found.err;
  for (const char* line :
       {"class       P", "netlist     4 elements, 2 nodes: 1 states, 1 pairs, 1 sources\n", "states      V(C1)\n",
        "pairs       D1\n", "open        D1\n", "loop        V(C2) = -V(C1) + V1\n",
        "warning     model dj: a junction, taken as a straight line of 1.429 V and 0 ohm\n",
        "warning     skipped: .save\n"})
    EXPECT_NE(found.out.find(line), std::string::npos) << line << "\n" << found.out;
  const auto json = nlohmann::json::parse(run("check c.cir --json").out);
  EXPECT_EQ(json["reduction"]["loops"][0], "V(C2) = -V(C1) + V1");
  EXPECT_EQ(json["reduction"]["states"][0], "V(C1)");
}

TEST_F(CliCircuit, MistakesEndWithOneLine) {
  write("c.cir", "t\nV1 a 0 1\nV2 a 0 2\n.tran 1m\n");
  for (const char* command : {"check c.cir", "solve c.cir"}) {
    const Outcome found = run(command);
    EXPECT_EQ(found.exit_code, 2);
    EXPECT_EQ(found.err,
              "bromwich: c.cir: line 3: V2 closes a loop of voltage sources; put a resistance into the loop\n");
  }
}

// An RC low pass behind a square wave: the mean is the duty, the heat of R1 what the source supplies.
const char* const low_pass =
    "low pass\nV1 a 0 PULSE(0 1 0 0 0 0.25m 1m)\nR1 a b 1k\nC1 b 0 1u\n.tran 10u 5m uic\n"
    ".meas tran late FIND V(b) AT=0.25m\n.meas never WHEN V(b)=2\n";

TEST_F(CliCircuit, ColumnsAreOutputsAndExpressions) {
  write("c.cir", low_pass);
  ASSERT_EQ(
      run("solve c.cir --tol-x 1e-8 --columns 'V(b),V(a,b),P(R1),V(a)*I(R1)' --at 0.25e-3,1e-3 --out c.csv").exit_code,
      0);
  const std::vector<std::string> lines = split(file("c.csv"), '\n');
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0], "t,V(b),V(a)-V(b),P(R1),V(a)*I(R1)");
  const std::vector<std::string> last = split(lines[2], ',');
  const double b = (1 - std::exp(-0.25)) * std::exp(-0.75);  // at 1 ms the source is 1 V again
  EXPECT_NEAR(std::stod(last[1]), b, 1e-7);
  EXPECT_NEAR(std::stod(last[2]), 1 - b, 1e-7);
  EXPECT_NEAR(std::stod(last[3]), (1 - b) * (1 - b) / 1e3, 1e-9);
  EXPECT_NEAR(std::stod(last[4]), (1 - b) / 1e3, 1e-9);
  const Outcome unknown = run("solve c.cir --columns 'V(c)' --out c.csv");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("'V(c)' has no node 'c'"), std::string::npos) << unknown.err;
}

// An RC low pass about its operating point: 1/(1 + s RC), and R beside C as the impedance.
TEST_F(CliCircuit, ResponsesAsTableAndPage) {
  write("c.cir", "low pass\nV1 a 0 0 AC 1\nR1 a b 1k\nC1 b 0 1u\n.ac dec 1 10 1k\n");
  const Outcome found = run("response c.cir --columns 'V(b),impedance(b),impedance(a,b)' --out c.csv --report c.html");
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const std::vector<std::string> lines = split(file("c.csv"), '\n');
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[0],
            "frequency,abs(V(b)),phase(V(b)),abs(impedance(b)),phase(impedance(b)),"
            "\"abs(impedance(a,b))\",\"phase(impedance(a,b))\"");
  for (std::size_t k = 1; k < lines.size(); ++k) {
    const std::vector<std::string> cells = split(lines[k], ',');
    const double wt = 2 * 3.14159265358979324 * std::stod(cells[0]) * 1e-3;
    constexpr double rounding = 1e-7;  // central differences with steps of 1e-5
    EXPECT_NEAR(std::stod(cells[1]), 1 / std::hypot(1, wt), rounding);
    EXPECT_NEAR(std::stod(cells[2]), -std::atan(wt) * 180 / 3.14159265358979324, 100 * rounding);
    EXPECT_NEAR(std::stod(cells[3]), 1e3 / std::hypot(1, wt), 1e3 * rounding);
  }
  EXPECT_NE(file("c.html").find("size [dB]"), std::string::npos);
  ASSERT_EQ(run("plot c.csv --out d.html").exit_code, 0);
  EXPECT_NE(file("d.html").find("impedance(a,b)"), std::string::npos);
  const auto json = nlohmann::json::parse(run("response c.cir --source V1 --frequencies 100 --json").out);
  EXPECT_EQ(json["responses"]["V(b)"]["abs"].size(), 1u);
  refused("response c.cir --columns 'V(z)'");
  refused("response c.cir --frequencies 'dec 0 1 2'");
  refused("response c.cir --out c.cir");
  refused("response signorini");
}

// V(a,b) = e^{-t/RC} and I(R1) = e^{-t/RC}/R, whose row has R of its own.
TEST_F(CliCircuit, FitsParametersToOutputs) {
  write("c.cir", "t\n.param R=2.1k Cl=0.6u\nV1 a 0 1\nR1 a b {R}\nC1 b 0 {Cl}\n.tran 10u 5m uic\n");
  std::string data = "t,V(a,b),I(R1)\n";
  for (int k = 0; k < 30; ++k) {
    const double t = 1e-4 * (k + 0.37), v = std::exp(-t / 1e-3);
    data += fmt::format("{},{},{}\n", t, v, k % 3 == 0 ? "" : fmt::format("{}", v / 1e3));
  }
  write("d.csv", data);
  const Outcome found = run("fit c.cir --data d.csv --free r=100:10k,Cl=0: --plot f.svg --out f.csv --json");
  ASSERT_EQ(found.exit_code, 0) << found.err;
  const auto json = nlohmann::json::parse(found.out);
  EXPECT_NEAR(json["parameters"]["r"]["value"].get<double>(), 1e3, 1e-3);
  EXPECT_NEAR(json["parameters"]["cl"]["value"].get<double>(), 1e-6, 1e-12);
  EXPECT_EQ(json["derivatives"].get<std::string>().find("central differences of solves"), std::string::npos);
  EXPECT_EQ(split(file("f.csv"), '\n')[0], "t,V(a,b),V(a,b)_measured,I(R1),I(R1)_measured");
  const Outcome unknown = run("fit c.cir --data d.csv --free L");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("'l' is no parameter"), std::string::npos) << unknown.err;
  write("e.csv", "t,V(c)\n0,1\n");
  EXPECT_NE(run("fit c.cir --data e.csv --free R").err.find("'V(c)' has no node 'c'"), std::string::npos);
}

// The periodic state behind a square wave: from `low` to `high` while it is 1.
TEST_F(CliCircuit, FitsPeriodicStates) {
  write("c.cir", "t\n.param Cl=2u\nV1 a 0 PULSE(0 1 0 0 0 0.25m 1m)\nR1 a b 1k\nC1 b 0 {Cl}\n.tran 10u 5m\n");
  const double tau = 0.7e-3, q = std::exp(-0.25e-3 / tau), p = std::exp(-0.75e-3 / tau), high = (1 - q) / (1 - p * q);
  std::string data = "t,V(b)\n";
  for (int k = 0; k < 20; ++k) {
    const double t = 5e-5 * (k + 0.41);
    data += fmt::format("{},{}\n", t,
                        t < 0.25e-3 ? 1 - (1 - high * p) * std::exp(-t / tau) : high * std::exp(-(t - 0.25e-3) / tau));
  }
  write("d.csv", data);
  const Outcome found = run("fit c.cir --data d.csv --free Cl --periodic auto --json");
  ASSERT_EQ(found.exit_code, 0) << found.err;
  EXPECT_NEAR(nlohmann::json::parse(found.out)["parameters"]["cl"]["value"].get<double>(), tau / 1e3, 1e-12);
}

// Numbers as in netlists, whose names ignore case: V(b) = 1 - e^{-t/RC} on the first pulse.
TEST_F(CliCircuit, SettingsAreWrittenAsInTheFile) {
  write("c.cir",
        "low pass\n.param Cl=1u\nV1 a 0 PULSE(0 1 0 0 0 0.25m 1m)\nR1 a b 1k\nC1 b 0 {Cl}\n.tran 10u 0.25m uic\n");
  const auto last = [&](const std::string& command) {
    const Outcome found = run(command);
    EXPECT_EQ(found.exit_code, 0) << found.err;
    const std::vector<std::string> lines = split(file("c.csv"), '\n');
    return lines.empty() ? std::vector<std::string>{} : split(lines.back(), ',');
  };
  EXPECT_EQ(run("solve c.cir --set Cl=1u*2").exit_code, 2);  // an expression takes no suffixes
  for (const char* value : {"2u", "2e-6", "2uF", "2000n"}) {
    const auto row =
        last(std::string("solve c.cir --tol-x 1e-8 --columns 'V(b)' --at 0.2e-3 --out c.csv --set Cl=") + value);
    ASSERT_EQ(row.size(), 2u) << value;
    EXPECT_NEAR(std::stod(row[1]), -std::expm1(-0.1), 1e-7) << value;
  }
  const auto row = last("derivative c.cir --by Cl --columns 'V(C1)' --at 0.2e-3 --out c.csv");
  ASSERT_GE(row.size(), 3u);
  EXPECT_NEAR(std::stod(row.back()), -0.2e6 * std::exp(-0.2), 1);
}

TEST_F(CliCircuit, MeasureCardsArePrinted) {
  write("c.cir", low_pass);
  const Outcome found = run("solve c.cir --tol-x 1e-8");
  EXPECT_NE(found.out.find("measure     late = 0.2211992"), std::string::npos) << found.out;  // 1 - e^{-1/4}
  EXPECT_NE(found.out.find("measure     never: V(b) = 2 is passed 0 times"), std::string::npos) << found.out;
  const auto json = nlohmann::json::parse(run("solve c.cir --tol-x 1e-8 --json").out);
  EXPECT_NEAR(json["measures"]["late"]["value"].get<double>(), -std::expm1(-0.25), 1e-8);
  EXPECT_TRUE(json["measures"]["never"]["value"].is_null());
}

TEST_F(CliCircuit, PeriodicStateWithBalance) {
  write("c.cir", low_pass);
  for (const char* period : {"auto", "1m", "2e-3"}) {
    const Outcome found = run(std::string("solve c.cir --json --periodic ") + period);
    ASSERT_EQ(found.exit_code, 0) << found.err;
    const auto json = nlohmann::json::parse(found.out);
    EXPECT_NEAR(json["outputs"]["V(b)"]["mean"].get<double>(), 0.25, 1e-9);
    const double q = std::exp(-0.25), p = std::exp(-0.75), high = (1 - q) / (1 - p * q);
    EXPECT_NEAR(json["outputs"]["V(b)"]["max"].get<double>(), high, 1e-7);
    EXPECT_LT(json["balance"]["error"].get<double>(), 1e-9);
    EXPECT_NEAR(json["balance"]["elements"]["V1"]["power"].get<double>(),
                -json["balance"]["elements"]["R1"]["power"].get<double>(), 1e-12);
  }
  EXPECT_NE(run("solve c.cir --periodic auto").out.find("energy      supplied"), std::string::npos);
  const Outcome bad = run("solve c.cir --periodic 1.5m");
  EXPECT_EQ(bad.exit_code, 2);
  EXPECT_NE(bad.err.find("is no multiple of 0.001 s"), std::string::npos) << bad.err;
  EXPECT_NE(run("solve signorini --periodic auto").err.find("--periodic: is given with signorini"), std::string::npos);
}

}  // namespace
}  // namespace bromwich
