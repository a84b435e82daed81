// Netlists with random mistakes: every text gives a circuit or an Error of one line. BROMWICH_FUZZ=N sets the number of
// mutations; scripts/fuzz runs many.

#include "core/base/error.hpp"
#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

namespace bromwich {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> words{"0",
                                     "1",
                                     "-1",
                                     "1e308",
                                     "-1e308",
                                     "1e-320",
                                     "nan",
                                     "inf",
                                     "1e999",
                                     "10u",
                                     "4k7",
                                     "1meg",
                                     "1F",
                                     "{",
                                     "}",
                                     "{1/0}",
                                     "{x}",
                                     "'",
                                     "\"",
                                     "(",
                                     ")",
                                     ",",
                                     "=",
                                     "+",
                                     "\n+ ",
                                     "\n*",
                                     ";",
                                     " $ ",
                                     "//",
                                     "V1",
                                     "R1",
                                     "L1",
                                     "K1 L1 L2 1",
                                     "\nK9 L1 L1 1",
                                     "\nV9 a 0 1",
                                     "\nI9 a 0 1",
                                     "\nC9 a 0 1u",
                                     "\nL9 a 0 1m",
                                     "\nE9 a 0 b 0 2",
                                     "\nG9 a 0 b 0 2",
                                     "\nF9 a 0 V1 2",
                                     "\nH9 a 0 V1 2",
                                     "\nS9 a b a 0 SI",
                                     "\nW9 a b V1 SI",
                                     "\nD9 a b DI",
                                     "\nX9 a b sub",
                                     "\n.subckt sub a b",
                                     "\n.ends",
                                     "\n.end",
                                     "\n.control",
                                     "\n.endc",
                                     "\n.param x=1",
                                     "\n.param x={x}",
                                     "\n.func f(a) {f(a)}",
                                     "\n.tran 1 1",
                                     "\n.tran 1u 1 uic",
                                     "\n.ic V(a)=1",
                                     "\n.include none",
                                     "\n.include /dev/null",
                                     "\n.lib .",
                                     "\n.meas tran q AVG V(a)",
                                     "\n.meas q WHEN V(a)=1",
                                     "\n.meas q PARAM='q'",
                                     "PULSE(0 1 0 0 0 1u 2u)",
                                     "PULSE(0 1 0 0 0 1n 1n)",
                                     "SIN(0 1 1k)",
                                     "SIN(0 1 1e12)",
                                     "PWL(0 0 0 1)",
                                     "EXP(0 1 0 1 0 1)",
                                     "SFFM(0 1 1k 1 1)",
                                     "DC",
                                     "AC",
                                     "gnd",
                                     "IC=1",
                                     "Rser=1",
                                     "Rpar=0",
                                     "D(Ron=0)",
                                     "D(Is=1f)",
                                     "SW(Ron=1 Roff=1Meg Vt=1)",
                                     "if(1>0,1,2)",
                                     "\xff",
                                     "\xc2\xb5",
                                     std::string(1, '\0'),
                                     "\t",
                                     "\r\n"};

class Mutator {
 public:
  explicit Mutator(unsigned long long seed) : random_(seed) {}
  std::size_t below(std::size_t count) { return std::uniform_int_distribution<std::size_t>(0, count - 1)(random_); }

  std::string operator()(std::string text, const std::string& other) {
    for (std::size_t count = 1 + below(4); count > 0; --count) once(text, other);
    return text;
  }

 private:
  void once(std::string& text, const std::string& other) {
    const std::size_t place = below(text.size() + 1), length = std::min(below(12), text.size() - place);
    switch (below(7)) {
      case 0:
        text.erase(place, length);
        return;
      case 1:
        text.insert(place, words[below(words.size())]);
        return;
      case 2:
        text.replace(place, length, words[below(words.size())]);
        return;
      case 3:  // a line of another netlist
        text.insert(place, "\n" + line_of(other) + "\n");
        return;
      case 4:  // a line twice, or away
        if (const std::string line = line_of(text); below(2) == 0)
          text += "\n" + line + "\n";
        else if (const auto at = text.find(line); at != std::string::npos)
          text.erase(at, line.size());
        return;
      case 5:  // another word
        replace_word(text, place);
        return;
      default:
        if (place < text.size()) text[place] = char(below(256));
    }
  }
  std::string line_of(const std::string& text) {
    const std::size_t place = below(text.size() + 1), begin = place == 0 ? 0 : text.rfind('\n', place - 1) + 1;
    return text.substr(begin, text.find('\n', begin) - begin);
  }
  void replace_word(std::string& text, std::size_t place) {
    const std::size_t begin = text.find(' ', place);
    if (begin == std::string::npos) return;
    const std::size_t end = text.find_first_of(" \n", begin + 1);
    text.replace(begin + 1, end == std::string::npos ? end : end - begin - 1, words[below(words.size())]);
  }

  std::mt19937_64 random_;
};

std::vector<std::string> seeds() {
  std::vector<std::string> all{
      "t\nV1 a 0 PWL(0 0 1m 10)\nC1 a b 1u IC=1\nC2 b 0 3u\nR2 b 0 1k\nI1 0 c 1\nL1 c d 1m\nL2 d 0 2m IC=3\nK1 L1 L2 "
      "0.5\n"
      "R3 c 0 1\n.ic V(b)=2\n.tran 1u 1m uic\n",
      "t\n.param x=2 y={x*3}\n.func f(a,b) {a*b}\nX1 a 0 sub PARAMS: r={f(x,y)}\nV1 a 0 SIN(0 1 1k)\n"
      ".subckt sub p q PARAMS: r=1\nR1 p m {r}\nX1 m q inner\n.subckt inner u v\nC1 u v 1u\n.ends\n.ends\n"
      ".tran 10u 2m\n.meas tran m AVG V(a) FROM=1m\n.meas k WHEN V(a)=0.5 RISE=1\n",
      "t\nV1 a 0 SIN(0 10 50)\nE1 b 0 a 0 2\nR1 b c 1\nH1 c 0 V1 3\nF1 d 0 V1 2\nG1 d 0 a 0 1m\nR2 d 0 1\nD1 d e DJ\n"
      "R4 e 0 1\nC1 e 0 1u\nW1 e 0 V1 SW1\n.model DJ D(Is=1n N=1 Rs=0.1 BV=50)\n.model SW1 CSW(It=1 Ron=1)\n.tran 1m "
      "20m uic\n"};
  for (const auto& file : fs::directory_iterator(BROMWICH_EXAMPLES "/circuits")) {
    std::ifstream in(file.path());
    all.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  std::sort(all.begin(), all.end());
  return all;
}

TEST(Fuzz, NetlistsGiveACircuitOrAnErrorOfOneLine) {
  const char *wanted = std::getenv("BROMWICH_FUZZ"), *seed = std::getenv("BROMWICH_FUZZ_SEED");
  const long count = wanted ? std::atol(wanted) : 2000;
  Mutator mutate(71 + 1000 * (seed ? std::strtoull(seed, nullptr, 10) : 0));
  const std::vector<std::string> all = seeds();
  long read = 0;
  for (long k = 0; k < count; ++k) {
    const std::string text = mutate(all[mutate.below(all.size())], all[mutate.below(all.size())]);
    const bool periodic = mutate.below(8) == 0;
    try {
      const Circuit c = parse_circuit(text, "fuzz.cir", {}, {}, periodic ? std::optional(0.0) : std::nullopt);
      c.scene.validate();
      ++read;
    } catch (const Error& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what() << "\n" << text;
    } catch (const std::exception& other) {
      FAIL() << other.what() << "\n" << text;
    }
  }
  EXPECT_GT(read, count / 20);  // mutations do not only destroy
}

}  // namespace
}  // namespace bromwich
