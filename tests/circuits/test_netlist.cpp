// The language of netlists: numbers, cards, parameters, subcircuits, models, and what is refused in which words.

#include "circuits/cards.hpp"
#include "circuits/netlist.hpp"
#include "circuits/values.hpp"
#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

using namespace circuits;
using test::message_of;

Netlist netlist_of(const std::string& cards) { return read_netlist("title\n" + cards, "test.cir", {}, {}); }

TEST(SpiceNumber, SuffixesUnitsAndDecimals) {
  const std::pair<const char*, double> known[] = {
      {"10", 10},     {"-1.5e-3", -1.5e-3}, {"10u", 10e-6}, {"10uF", 10e-6},   {"1kOhm", 1e3},
      {"4k7", 4.7e3},

      {"1Meg", 1e6},  {"2.5MEGohm", 2.5e6}, {"3m", 3e-3},   {"3mil", 76.2e-6}, {"1F", 1e-15},
      {"5p", 5e-12},  {"7n", 7e-9},         {"8g", 8e9},    {"1t", 1e12},      {"+2", 2},
      {".5", 0.5},    {"1\xc2\xb5", 1e-6},  {"12V", 12},    {"1e3k", 1e6},     {"0.1\xce\xbcH", 1e-7}};
  for (const auto& [word, value] : known) {
    const auto read = spice_number(word);
    ASSERT_TRUE(read) << word;
    EXPECT_DOUBLE_EQ(*read, value) << word;
  }
  EXPECT_EQ(*spice_number("10u"), 1e-5);  // exactly: periods are multiples of steps
  for (const char* word : {"", "abc", "k1", "{1}", "+-1", "1 2"}) EXPECT_FALSE(spice_number(word)) << word;
}

TEST(Cards, CommentsContinuationsAndCase) {
  const Deck deck = read_cards(
      "R9 is the title\n* comment\nR1 A B 1k ; end\n\nV1 a 0 PULSE(0 5\n* between\n+ 0 1n 1n) $ more\n.END\nR2 c d 1\n",
      "t.cir", {});
  EXPECT_EQ(deck.title, "R9 is the title");
  ASSERT_EQ(deck.cards.size(), 2u);
  EXPECT_EQ(deck.cards[0].words, (std::vector<std::string>{"r1", "a", "b", "1k"}));
  EXPECT_EQ(deck.cards[1].place.line, 5);
  EXPECT_EQ(split_arguments(deck.cards[1].words.at(3)), (std::vector<std::string>{"pulse", "0", "5", "0", "1n", "1n"}));
}

TEST(Cards, ControlBlocksAreSkipped) {
  EXPECT_EQ(read_cards("t\nR1 a 0 1\n.control\nrun\nplot v(a)\n.endc\nR2 a 0 1\n", "t.cir", {}).cards.size(), 2u);
}

TEST(Parameters, AnyOrderFunctionsAndScopes) {
  const Netlist n = netlist_of(
      ".param a={2*b} b = 3k, c='a+1'\n.func twice(x) {2*x}\nR1 n 0 {twice(a)+c}\nR2 n 0 b\n"
      "X1 n 0 half PARAMS: r=a\n.subckt half p q PARAMS: r=1\nR1 p q {r/2}\n.ends\n.tran 1m\n");
  ASSERT_EQ(n.elements.size(), 3u);
  EXPECT_DOUBLE_EQ(n.elements[0].value, 2 * 6000 + 6001);
  EXPECT_DOUBLE_EQ(n.elements[1].value, 3000);
  EXPECT_EQ(n.elements[2].name, "X1.R1");
  EXPECT_DOUBLE_EQ(n.elements[2].value, 3000);
  EXPECT_EQ(n.elements[2].nodes, (std::vector<std::string>{"n", "0"}));
}

TEST(Models, LinesAndJunctions) {
  const Netlist n = netlist_of(
      "D1 a 0 line\nD2 a 0 junction\n.model line D(Ron=10m Roff=1Meg Vfwd = 0.5)\n.model junction D Is=1e-12 Rs=0.1 "
      "N=2\n"
      "R1 a 0 1\nS1 a 0 a 0 sw1\n.model SW1 SW (Ron=1m Von=3 Voff=1)\n.tran 1m\n");
  EXPECT_DOUBLE_EQ(n.elements[0].diode.forward, 0.5);
  EXPECT_DOUBLE_EQ(n.elements[0].diode.on, 0.01);
  EXPECT_DOUBLE_EQ(n.elements[0].diode.off, 1e6);
  EXPECT_NEAR(n.elements[1].diode.forward, 2 * 25.85e-3 * std::log(1e12 + 1), 1e-12);
  EXPECT_DOUBLE_EQ(n.elements[1].diode.on, 0.1);
  EXPECT_DOUBLE_EQ(n.elements[3].gate.threshold, 2);
  EXPECT_DOUBLE_EQ(n.elements[3].gate.hysteresis, 1);
  ASSERT_EQ(n.notes.size(), 1u);
  EXPECT_NE(n.notes[0].find("junction"), std::string::npos);
}

TEST(Netlist, WhatIsSkippedIsNamedOnce) {
  const Netlist n = netlist_of("R1 a 0 1\n.save V(a)\n.options reltol=1e-3\n.save I(R1)\n.four 1k V(a)\n.tran 1m\n");
  ASSERT_EQ(n.notes.size(), 1u);
  EXPECT_EQ(n.notes[0], "skipped: .four .options .save");
}

TEST(Netlist, WhatIsNotReadIsNamedOnce) {
  const Netlist n = netlist_of(
      "R1 a 0 1 tc=0.1\nD1 a 0 DJ 2 off\n.model DJ D Is=1n cjo=1p tt=1n\nV1 a 0 1 Rser=2\n.nodeset V(a)=1\n"
      ".control\nrun\n.endc\nC1 a 0 1F\n.tran 1m startup\n");
  ASSERT_EQ(n.notes.size(), 4u);
  EXPECT_NE(n.notes[0].find("without cjo tt"), std::string::npos) << n.notes[0];
  EXPECT_NE(n.notes[1].find("test.cir: line 10: C1 = 1f is 1e-15 farad"), std::string::npos) << n.notes[1];
  EXPECT_EQ(n.notes[2], "skipped: .control");
  EXPECT_EQ(n.notes[3], "not read: .nodeset v(a) .tran startup D1 2 D1 off R1 tc");
  ASSERT_EQ(n.elements.size(), 5u);
  EXPECT_EQ(n.elements[2].name, "V1.rser");
}

// Each refusal says the line, the element and what to do.
TEST(NetlistMistakes, AreNamed) {
  const std::string end = "\n.tran 1m\n";
  const std::pair<std::string, const char*> mistakes[] = {
      {"V1 a 0 1\nV2 a 0 2" + end, "test.cir: line 3: V2 closes a loop of voltage sources"},
      {"I1 a 0 1" + end, "test.cir: line 2: I1: nothing but current sources leads to node a"},
      {"R1 a 0 1\nE1 b 0 g 0 2\nR2 b 0 1" + end, "E1: node g is only sensed, nothing drives it"},
      {"L1 a 0 1m\nL2 b 0 1m\nL3 c 0 1m\nR1 a b 1\nR2 b c 1\nK1 L1 L2 0.9\nK2 L2 L3 0.9\nK3 L1 L3 -0.9" + end,
       "the inductance matrix is not positive"},
      {"R1 a 0 0" + end, "R1 = 0"},
      {"R1 a 0 1\nR1 a 0 2" + end, "R1 is there twice"},
      {"D1 a 0 DX\nR1 a 0 1" + end, "D1: there is no model 'dx'"},
      {"R1 a 0 {x}" + end, "x"},
      {"R1 a 0 y" + end, "R1: 'y' is neither a number nor a parameter"},
      {"X1 a 0 sub\nR1 a 0 1" + end, "X1: there is no subcircuit 'sub'"},
      {".subckt sub a\nR1 a 0 1\n.ends\nX1 a b sub" + end, "subcircuit 'sub' has 1 nodes, found 2"},
      {".subckt sub a\nR1 a 0 1" + end, "subcircuit 'sub' has no .ends"},
      {"R1 a 0 1\n", "there is no .tran"},
      {"M1 a b c d nmos" + end, "M1: elements of kind M are not read"},
      {"Q1 a b c npn" + end, "Q1: elements of kind Q are not read"},
      {"R1 a 0" + end, "R1 has no value"},
      {"R1 a" + end, "are too few"},
      {"F1 a 0 V9 2\nR1 a 0 1" + end, "F1: there is no voltage source 'v9'"},
      {"C1 a 0 -1u\nR1 a 0 1" + end, "C1 = "},
      {"R1 a 0 {1" + end, "'{' has no '}'"},
      {"+ R1 a 0 1" + end, "continues no line"},
      {"K1 L1 L2 1\nL1 a 0 1" + end, "there is no inductor 'l2'"},
      {"L1 a 0 1\nL2 a 0 1\nK1 L1 L2 1.5" + end, "K1 = 1.5"},
      {".param p={p}\nR1 a 0 p" + end, "is defined by itself"},
      {".param p={2*1e999}\nR1 a 0 {p}" + end, "has a number that is too large or too small"},
      {"V1 a 0 PWL(0 1 2)\nR1 a 0 1" + end, "PWL has no pairs"},
      {"V1 a 0 1\nL1 a 0 1m" + end, "there is no operating point"},
      {"V1 in 0 1\nR1 in x 1\nE1 x 0 y 0 1\nR2 y 0 1\nE2 y 0 x 0 1" + end,
       "test.cir: line 5: the resistive network is singular; involved: node y"},
      {"V1 in 0 1\nR1 in 0 1\nF1 0 x V1 0\nG1 x 0 in 0 1" + end, "F1: nothing but current sources leads to node x"},
      {"V1 in 0 1\nD1 in a DI\nR1 a 0 1\nE1 b 0 a 0 2\nC1 b 0 1u\n.model DI D(Ron=1)" + end,
       "C1 closes a loop with controlled sources"},
      {"C1 a 0 1u\nE1 b 0 a 0 1\nC2 b c 1u\nF1 0 a V1 1\nV1 c 0 0\nR1 a 0 1" + end,
       "what the capacitors and inductors store is not independent"},
      {"R1 a 0 1\n.ends" + end, ".ends without .subckt"},
      {"R1 a 0 1\n.subckt" + end, ".subckt without a name"},
      {"R1 a 0 1\n.func f" + end, ".func without arguments"},
      {".func f(a) {a}\nR1 a 0 {f(1,2)}" + end, "f takes 1 arguments, found 2"},
      {".func f(a) {f(a)}\nR1 a 0 {f(1)}" + end, "calls itself"},
      {"R1 a 0 {if(1>0)}" + end, "if takes 3 arguments"},
      {"R1 a 0 1\n.tran", ".tran without a time"},
      {"R1 a 0 1\n.tran 1m 0", "the end of .tran is 0"},
      {"R1 a 0 1\n.tran 1u 1m 2m", "the start of .tran is 0.002"},
      {"E1 a 0 POLY(1) a 0 1\nR1 a 0 1" + end, "E1: poly(1) is not read"},
      {"D1 a 0\nR1 a 0 1" + end, "D1 names no model"},
      {"S1 a 0 b 0\nR1 a 0 1" + end, "S1 names no model"},
      {"D1 a 0 SI\nR1 a 0 1\n.model SI SW(Ron=1)" + end, "D1: the model 'si' is of type sw"},
      {"R1 a 0 1\n.model DI" + end, ".model without a name or a type"},
      {"R1 a 0 1\nD1 a 0 DI\n.model DI D(Ron=-1)" + end, "ron = -1"},
      {"R1 a 0 1\nD1 a 0 DI\n.model DI D(Ron=2 Roff=1)" + end, "Roff is not above Ron"},
      {"R1 a 0 1\nD1 a 0 DI\n.model DI D(Ron=1 Vrev=-1)" + end, "Vrev is not positive"},
      {"R1 a 0 1\nD1 a 0 DI\n.model DI D(Is=0)" + end, "Is and N are not positive"},
      {"R1 a 0 1\nK1 L1" + end, "K1 names less than two inductors"},
      {".subckt s a\nX1 a s\n.ends\nX1 a s\nR1 a 0 1" + end, "subcircuits contain each other without end"},
      {"X1\nR1 a 0 1" + end, "X1 names no subcircuit"},
      {"R1 a 0 1\nC1 a 0 1u Lser=1n" + end, "Lser is not read"},
      {"R1 a 0 1\n.foo" + end, ".foo is unknown"},
      {".tran 1m", "there is no element"},
      {"R1 a 0 1\n.include none.inc" + end, "cannot be read"},
      {"R1 a 0 1\n.meas tran x FOO V(a)" + end, "test.cir: line 3: .meas x: 'foo' is unknown"},
      {"R1 a 0 1\n.meas tran x" + end, ".meas ends too early"},
      {"R1 a 0 1\n.meas tran x AVG V(b)" + end, "'V(b)' has no node 'b'"},
      {"R1 a 0 1\n.meas tran x AVG I(R2)" + end, "'I(R2)' has no element 'r2'"},
      {"R1 a 0 1\n.meas tran x AVG V(a) RISE 1" + end, "x: 'rise' is not understood"},
      {"R1 a 0 1\n.meas tran x FIND V(a)" + end, "x: FIND without AT or WHEN"},
      {"R1 a 0 1\n.meas tran x TRIG V(a) VAL=1" + end, "x: TRIG without TARG"},
      {"R1 a 0 1\n.meas tran x WHEN V(a)=1 RISE=0" + end, "counts from 1"},
      {"R1 a 0 1\n.meas ac x AVG V(a)" + end, "ac is not an analysis here"},
      {"V1 a 0 PULSE(0 1 0 -1n)\nR1 a 0 1" + end, "PULSE has a negative time"},
      {"V1 a 0 EXP(0 1 0)\nR1 a 0 1" + end, "EXP needs six numbers"},
      {"V1 a 0 PWL(1 0 0 1)\nR1 a 0 1" + end, "PWL: 0 follows 1"},
      {"V1 a 0 PULSE(0 1 0 0 0 1n 2n)\nR1 a b 1\nC1 b 0 1u\n.tran 1 uic", "PULSE has 5e+08 periods"},
  };
  for (const auto& [cards, words] : mistakes) {
    const std::string message = message_of(cards);
    EXPECT_NE(message.find(words), std::string::npos) << cards << "\nsaid: " << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  }
}

TEST(NetlistMistakes, SettingsThatAreNoParameters) {
  try {
    parse_circuit("t\n.param r=1\nR1 a 0 r\n.tran 1m\n", "test.cir", {}, {{"q", 1}});
    FAIL();
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("'q' is no .param of the netlist"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace bromwich
