// [structure] and [[contact]] beside the structure stated in C++, and their mistakes with file, line and key.

#include "mechanics/mechanism.hpp"
#include "tests/files/scene_texts.hpp"
#include "tests/mechanics/mechanisms.hpp"

#include <gtest/gtest.h>

#include <string>

namespace bromwich {
namespace {

const std::string on_a_belt = R"toml(
[parameters]
mu = 0.4
e = 0.5
[structure]
M = 1
K = [[2, -0.6], [-0.6, 1.5]]
C = [[0.06, -0.006], [-0.006, 0.055]]
f = ["0.3*sin(2.1*t)", "-1 + 1.3*cos(2.1*t)"]
q0 = [0, 0]
[[contact]]
name = "belt"
normal = [0, 1]
tangent = [1, 0]
velocity = 0.4
mu = "mu"
restitution = "e"
[time]
T = 10
)toml";

TEST(StructureSection, IsTheStructureStatedInCpp) {
  const SceneFile file = parse_sections(on_a_belt);
  ASSERT_TRUE(file.mechanism);
  EXPECT_EQ(file.mechanism->contacts[0].mu, 0.4);
  Contact contact = belt(0.5);
  contact.name = "belt";
  const Mechanism same = make_mechanism(block(1.3, 10), {contact});
  EXPECT_EQ(file.scene.names.y, same.scene.names.y);
  EXPECT_TRUE(file.scene.breakpoints_are_all);
  const Result of_file = located(file.scene), of_code = located(same.scene);
  EXPECT_LE((last_state(of_file) - last_state(of_code)).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(StructureSection, ParametersAndNamesOfTheFile) {
  const SceneFile other =
      parse_sections(on_a_belt + "[names]\nx = [\"a\", \"b\", \"c\", \"d\"]\n", {{"e", 0}, {"T", 4}});
  EXPECT_TRUE(other.scene.restitution.isZero(0));
  EXPECT_EQ(other.scene.T, 4);
  EXPECT_EQ(other.scene.names.x, (std::vector<std::string>{"a", "b", "c", "d"}));
  EXPECT_EQ(parse_sections(on_a_belt).scene.names.x, (std::vector<std::string>{"q0", "q1", "v_q0", "v_q1"}));
}

TEST(StructureSection, SwitchesOfItsSourcesAreFound) {
  const std::string moved = with_replaced(on_a_belt, "velocity = 0.4", "velocity = \"if(t < 3, 0.4, 0.2)\"");
  EXPECT_EQ(parse_sections(with_replaced(moved, "\"if(t < 3, 0.4, 0.2)\"", "\"t < 3 ? 0.4 : 0.2\"")).scene.breakpoints,
            std::vector<double>{3});
}

TEST(StructureSection, ConstantsAreLines) {
  EXPECT_TRUE(parse_sections(on_a_belt).scene.g.linear());
  std::string moving = on_a_belt;
  moving.replace(moving.find("velocity = 0.4"), 14, "velocity = \"0.4*cos(t)\"");
  EXPECT_FALSE(parse_sections(moving).scene.g.linear());
}

TEST(StructureSection, APeriodicStateHasNoStart) {
  const std::string periodic =
      "[structure]\nM = [[1]]\nK = 4\nperiodic = true\nf = [\"sin(t)\"]\n[[contact]]\ntangent = [1]\nbound = 0.2\n"
      "[time]\nT = \"2*pi\"\n";
  const Scene scene = parse_sections(periodic).scene;
  ASSERT_TRUE(scene.boundary);
  EXPECT_EQ(scene.boundary->ET, -Matrix::Identity(2, 2));
}

TEST(StructureSection, RelaysBesideContacts) {
  const std::string text =
      "[structure]\nM = [[1, 0], [0, 1]]\nf = [0, -1]\nB = [[1], [0]]\n[[contact]]\nnormal = [0, 1]\ntangent = [1, 0]\n"
      "mu = 0.5\n[relay]\nC = [[0, 0, 1, 0]]\ne = [-1]\n[time]\nT = 4\n";
  const SceneFile file = parse_sections(text);
  EXPECT_EQ(file.scene.relays, 1);
  EXPECT_EQ(file.mechanism->rows[0].normal, 2);
  EXPECT_NEAR(last_state(located(file.scene))[0], 3, 1e-8);  // as Mechanism.RelaysActBesideContacts
}

TEST(StructureSection, MistakesNameTheLine) {
  const auto with = [](const std::string& from, const std::string& to) { return with_replaced(on_a_belt, from, to); };
  expect_refused_sections({
      {with("M = 1", "M = [[1, 2], [2, 1]]"), "my.toml:6: structure.M: is not symmetric and positive definite"},
      {with("M = 1\n", ""), "my.toml:5: structure.M: is missing"},
      {with("q0 = [0, 0]", "q0 = [0, 0]\nv0 = [1]"), "my.toml:11: structure.v0: has 1 entries"},
      {with("q0 = [0, 0]", "periodic = 1"), "my.toml:10: structure.periodic: found 1; give true or false"},
      {with("\"-1 + 1.3*cos(2.1*t)\"]", "\"-1\", 0]"), "my.toml:9: structure.f: has 3 entries"},
      {with("normal = [0, 1]", "normal = [0, 1, 0]"), "my.toml:13: contact[0].normal: has 3 entries"},
      {with("normal = [0, 1]\n", ""), "my.toml:11: contact[0].normal: is missing; give the row Hn"},
      {with("mu = \"mu\"", "mu = -1"), "my.toml:16: contact[0].mu: is -1; give a number >= 0"},
      {with("mu = \"mu\"", "mu = \"mu\"\nkn = 0"), "my.toml:17: contact[0].kn: is 0; give a positive stiffness"},
      {with("restitution = \"e\"", "restitution = 2"), "my.toml:17: contact[0].restitution: is 2; give a number from"},
      {with("restitution = ", "restitutoin = "), "my.toml:17: contact[0].restitutoin: is no known key (did you mean"},
      {with("velocity = 0.4", "velocity = [0, 1]"), "my.toml:15: contact[0].velocity: has 2 entries"},
      {with("[[contact]]", "[contact]"), "my.toml:11: contact: found a table; write a section [[contact]] for each"},
      {with("[time]", "[dynamics]\nA = [[1]]\n[time]"), "my.toml:19: dynamics.A: is given with a section [structure]"},
      {with("q0 = [0, 0]", "B = [[1], [0]]"), "my.toml:10: structure.B: is given without [relay]"},
      {with("[time]", "[relay]\nC = [[1, 0]]\n[time]"), "my.toml:5: structure.B: is missing"},
      {"[[contact]]\nnormal = [1]\n[time]\nT = 1\n", "my.toml:2: contact[0].normal: is given without [structure]"},
  });
}

}  // namespace
}  // namespace bromwich
