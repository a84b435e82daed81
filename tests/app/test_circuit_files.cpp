// The command with netlists.

#include "tests/app/cli.hpp"

#include <nlohmann/json.hpp>

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

}  // namespace
}  // namespace bromwich
