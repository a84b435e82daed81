// The circuits of tests/circuits/set against a program that goes mode by mode and shares no code with the library, and
// the balance of their energy.

#include "circuits/balance.hpp"
#include "tests/circuits/circuits.hpp"
#include "tests/circuits/mode_reference.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace bromwich {
namespace circuit_set_test {

namespace fs = std::filesystem;

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const auto& file : fs::directory_iterator(BROMWICH_CIRCUITS)) all.push_back(file.path().stem().string());
  std::sort(all.begin(), all.end());
  return all;
}

class CircuitSet : public testing::TestWithParam<std::string> {};

TEST_P(CircuitSet, AgreesModeByMode) {
  const fs::path file = fs::path(BROMWICH_CIRCUITS) / (GetParam() + ".cir");
  std::stringstream text;
  text << std::ifstream(file).rdbuf();
  const test::ReferenceValues known = test::mode_by_mode(text.str());
  const Circuit c = read_circuit(file);
  EXPECT_TRUE(c.notes.empty()) << c.notes[0];
  constexpr double tolerance = 1e-6;  // the reference is off by rounding, 1e-9 of a state
  Options options;
  options.tolerance_x = tolerance;
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  const Result r = solve(c.scene, *backend, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::events);
  const CircuitWaveforms waveforms(c, *backend, r, 0, c.scene.T, "test");
  for (const auto& [name, value] : known.end) {
    const std::string element = name.substr(2, name.size() - 3);
    const auto place =
        std::find_if(c.elements.begin(), c.elements.end(), [&](const auto& e) { return e.name == element; });
    ASSERT_NE(place, c.elements.end()) << name;
    EXPECT_NEAR(waveforms.values(Probe(c, name[0], *place), {c.scene.T})[0], value, tolerance * known.largest.at(name))
        << name;
  }
  // Of each piece by itself: what the pieces before it have added to its start does not count.
  EXPECT_LT(balance(c, waveforms).error, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Netlists, CircuitSet, testing::ValuesIn(names()), [](const auto& one) {
  std::string name = one.param;
  std::replace(name.begin(), name.end(), '-', '_');
  return name;
});

}  // namespace circuit_set_test
}  // namespace bromwich
