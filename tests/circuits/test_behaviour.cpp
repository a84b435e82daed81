// B sources and the subcircuits of the library, against closed forms.

#include "tests/circuits/circuits.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

namespace bromwich {
namespace behaviour_test {

using test::circuit_of;
using test::message_of;
constexpr double pi = std::numbers::pi;

std::map<std::string, double> values(const Circuit& c, double t) { return test::values_at(c, t, 1e-8); }

/// V(o) of B1 at t, where V(a) = 4 sin(2 pi t / 1 ms), V(b) = 1 and I(Vm) = V(a) / 2.
double value_of(const std::string& expression, double t) {
  return values(circuit_of("Va a 0 SIN(0 4 1k)\nVb b 0 1\nVm a m 0\nRm m 0 2\nB1 o 0 V=" + expression +
                           "\nR1 o 0 1k\nC1 x 0 1u\nR2 x 0 1\n.param p=3\n.func twice(x) {2*x}\n.tran 1u 1m uic\n"),
                t)
      .at("V(o)");
}

TEST(Behaviour, PiecewiseLinearExpressions) {
  const std::function<double(double, double)> forms[] = {
      [](double a, double b) { return 2 * a - 3 * (b - a) + 5 * a / 2 + 1; },
      [](double a, double b) { return std::max(a, 2 * b) - std::min(a, b / 2); },
      [](double a, double) { return std::abs(a + 0.5) * 3; },
      [](double a, double) { return std::clamp(2 * a, -1.0, 3.0); },
      [](double a, double) {
        return a < -1 ? 5 : a < 1 ? 3 - 2 * a : a < 3 ? a : 3;
      },
      [](double a, double b) { return a > b ? 7 : -2; },
      [](double a, double) { return std::max(0.0, std::abs(a) - 1); },
      [](double a, double b) { return a > 1 && b > 0.5 && !(a > 3) ? 1 : 0; },
      [](double a, double) { return (a > 2 ? 1 : -1) + (a < 0 || a > 3 ? 10 : 0); }};
  const char* const texts[] = {"{2*V(a) - 3*V(b,a) + I(Vm)*5 + p/3}",
                               "max(V(a), 2*V(b)) - min(V(a), V(b)/2)",
                               "'abs(V(a)+500m)*p'",
                               "limit(twice(V(a)), 3, -1)",
                               "table(V(a), -1, 5, 1, 1, 3, {p})",
                               "if(V(a) > V(b), 7, -2)",
                               "uramp(abs(V(a)) - 1)",
                               "u(V(a)-1) && V(b) >= 0.5 & !(V(a) > 3)",
                               "sgn(V(a)-2) + 10*(V(a) < 0 || V(a) > 3)"};
  for (std::size_t k = 0; k < std::size(texts); ++k)
    for (const double t : {0.02e-3, 0.1e-3, 0.17e-3, 0.52e-3, 0.7e-3}) {
      const double a = 4 * std::sin(2 * pi * t / 1e-3);
      EXPECT_NEAR(value_of(texts[k], t), forms[k](a, 1), 1e-9 * 40) << texts[k] << " at " << t;
    }
}

// Beside V(a), any function of time.
TEST(Behaviour, FunctionsOfTime) {
  const std::pair<const char*, std::function<double(double, double)>> cases[] = {
      {"2*sin(2*pi*1k*time)-3*V(a)", [](double a, double t) { return 2 * std::sin(2 * pi * 1e3 * t) - 3 * a; }},
      {"{(1+time*2k)^2/(1-time)*exp(-time/p)}",
       [](double, double t) { return std::pow(1 + 2e3 * t, 2) / (1 - t) * std::exp(-t / 3); }},
      {"if(time > 0.3m, 5, 1+1k*time)+V(a)", [](double a, double t) { return (t > 0.3e-3 ? 5 : 1 + 1e3 * t) + a; }},
      {"max(V(a), abs(3*cos(2*pi*2k*time)))",
       [](double a, double t) { return std::max(a, std::abs(3 * std::cos(4 * pi * 1e3 * t))); }},
      {"u(V(a) - log(2+1k*time)) + min(1, 4k*time)",
       [](double a, double t) { return double(a > std::log(2 + 1e3 * t)) + std::min(1.0, 4e3 * t); }}};
  for (const auto& [text, form] : cases)
    for (const double t : {0.02e-3, 0.1e-3, 0.17e-3, 0.52e-3, 0.7e-3})
      EXPECT_NEAR(value_of(text, t), form(4 * std::sin(2 * pi * t / 1e-3), t), 1e-9 * 40) << text << " at " << t;
}

// A capacitor across such a source has the current of the slope, which jumps at a kink that is found.
TEST(Behaviour, FunctionsOfTimeHaveSlopes) {
  const Circuit c = circuit_of("B1 o 0 V={5*abs(sin(2*pi*1k*time))}\nC1 o 0 1u\nR1 o 0 1\n.tran 1u 1m uic\n");
  for (const double t : {0.1e-3, 0.45e-3, 0.55e-3, 0.9e-3}) {
    const double angle = 2 * pi * 1e3 * t;
    EXPECT_NEAR(values(c, t).at("I(C1)"), 1e-6 * 5 * 2 * pi * 1e3 * std::cos(angle) * (std::sin(angle) > 0 ? 1 : -1),
                1e-9);
  }
  ASSERT_EQ(c.kinks.size(), 1u);
  EXPECT_NEAR(c.kinks[0], 0.5e-3, 1e-17);
}

// Sine and triangle, both of time: the edges of the pulses are found beforehand, as those of named sources are.
TEST(Behaviour, SinePulseWidthModulation) {
  const Circuit c = circuit_of(
                    "Vt t 0 PULSE(-1 1 0 50u 50u 0 100u)\nB1 o 0 V={100*sgn(0.8*sin(2*pi*50*time)-V(t))}\n"
                    "R1 o q 10\nL1 q 0 10m\n.tran 1u 20m uic\n"),
                named = circuit_of(
                    "Vt t 0 PULSE(-1 1 0 50u 50u 0 100u)\nVm m 0 SIN(0 0.8 50)\nB1 o 0 V={100*sgn(V(m)-V(t))}\n"
                    "R1 o q 10\nL1 q 0 10m\n.tran 1u 20m uic\n");
  EXPECT_EQ(c.scene.states(), 1);
  for (const double t : {3.1e-3, 11e-3, 19.9e-3})
    EXPECT_NEAR(values(c, t).at("I(L1)"), values(named, t).at("I(L1)"), 1e-9) << t;
}

// A source of current, and currents of a resistor and a coil in an expression.
// The parts of an expression are elements of their own, and nobody asks for them.
TEST(Behaviour, OutputsAreThoseOfTheNetlist) {
  const Circuit c = circuit_of(
      "V1 a 0 SIN(0 1 1k)\nX1 a o clip\nR1 o b 1k\nL1 b 0 1m\n.subckt clip in out\n"
      "Bu out 0 V={max(V(in), 0) + if(V(in) > 0.5, 1, 0) + sin(6283*time)}\n.ends\n.tran 1u 1m uic\n");
  std::vector<std::string> names, elements;
  for (const CircuitOutput& o : c.outputs) names.push_back(o.name);
  for (const CircuitElement& e : c.elements) {
    elements.push_back(e.name);
    EXPECT_EQ(c.outputs[std::size_t(e.current)].name, "I(" + e.name + ")");
  }
  EXPECT_EQ(names, (std::vector<std::string>{"V(a)", "V(b)", "V(o)", "I(V1)", "I(X1.Bu)", "I(R1)", "I(L1)"}));
  EXPECT_EQ(elements, (std::vector<std::string>{"V1", "X1.Bu", "R1", "L1"}));
  ASSERT_EQ(c.stores.size(), 1u);
  EXPECT_EQ(c.stores[0].a, 3);
}

TEST(Behaviour, CurrentsOfElements) {
  const Circuit c = circuit_of("V1 a 0 6\nR1 a b 2\nL1 b 0 1m\nB1 0 o I=I(R1)+2*I(L1)\nR2 o 0 1\n.tran 1u 1m uic\n");
  const double i = 3 * -std::expm1(-2 * 0.4);
  EXPECT_NEAR(values(c, 0.4e-3).at("V(o)"), 3 * i, 1e-7);
}

// Pulses from a triangle and a level, known beforehand: no state is added.
TEST(Behaviour, PulseWidthModulation) {
  const Circuit c = circuit_of(
      "Vt t 0 PULSE(0 1 0 50u 50u 0 100u)\nVr r 0 0.3\nB1 o 0 V=5*u(V(r)-V(t))\nR1 o q 1k\nC1 q 0 1u\n.tran 1u 1m uic\n"
      ".meas m AVG V(o)\n");
  EXPECT_EQ(c.scene.states(), 1);
  EXPECT_TRUE(c.scene.memories.empty());
  EXPECT_NEAR(values(c, 214e-6).at("V(o)"), 5, 1e-12);
  EXPECT_NEAR(values(c, 216e-6).at("V(o)"), 0, 1e-12);
}

// R C from V(o) = 5 schmitt(2 .. 3): both ways take ln(3/2) of the time constant.
TEST(Behaviour, SchmittTriggerOscillates) {
  const Circuit c = circuit_of("B1 o 0 V=5-5*schmitt(V(c), 2, 3)\nR1 o c 1k\nC1 c 0 1u IC=2\n.tran 1u 5m uic\n");
  ASSERT_EQ(c.scene.states(), 1);
  ASSERT_EQ(c.scene.memories.size(), 1u);
  const double way = 1e-3 * std::log(1.5);
  EXPECT_NEAR(values(c, 4.5 * way).at("V(c)"), 5 - 3 * std::exp(-way / 2 / 1e-3), 1e-7);
  EXPECT_NEAR(values(c, 5.5 * way).at("V(c)"), 3 * std::exp(-way / 2 / 1e-3), 1e-7);
}

TEST(Behaviour, MistakesAreNamed) {
  const std::pair<const char*, const char*> mistakes[] = {
      {"B1 o 0 V=V(a)*V(a)", "line 2: B1: has a product or a quotient of signals"},
      {"B1 o 0 V=1/V(a)", "product or a quotient"},
      {"B1 o 0 V=V(a)/0", "divides by 0"},
      {"B1 o 0 V=sin(V(a))", "sin of a signal is not linear in pieces"},
      {"B1 o 0 V=V(a)^2", "power of signals"},
      {"B1 o 0 V=time*V(a)", "product or a quotient of signals"},
      {"B1 o 0 V=sin(V(a)+time)", "sin of a signal is not linear in pieces"},
      {"B1 o 0 V=foo(V(a))", "'foo' is unknown"},
      {"B1 o 0 V=x+1", "'x' is unknown"},
      {"B1 o 0 V=max(V(a))", "max takes 2 arguments, found 1"},
      {"B1 o 0 V=max(V(a) 2)", "')' is missing"},
      {"B1 o 0 V=V(a) 3", "'(3)' is not understood"},
      {"B1 o 0 V=if(V(a)>1, V(a), 0)", "jumps between values that are not constant"},
      {"B1 o 0 V=limit(1, V(a), 2)", "bounds that are not constant"},
      {"B1 o 0 V=table(V(a), 1, 2, 1, 3)", "places that do not increase"},
      {"B1 o 0 V=table(V(a), 1)", "table has no pairs"},
      {"B1 o 0 V=schmitt(V(a), 2, 1)", "schmitt has levels"},
      {"B1 o 0 V=V(a,b,c)", "found 'v(a,b,c)'"},
      {"B1 o 0 V=I(R9)", "B1: there is no element 'r9'"},
      {"B1 o 0 Q=V(a)", "'q' is unknown"},
      {"B1 o 0", "B1 has no expression"},
      {"B1 o 0 V=", "ends too early"},
      {"E1 o 0 FOO={V(a)}", "'foo' is unknown"},
      {"B1 o 0 V=V(nowhere)", "node nowhere is only sensed"}};
  for (const auto& [card, words] : mistakes) {
    const std::string message = message_of(std::string(card) + "\nV1 a 0 1\nR1 a 0 1\nR2 o 0 1\n.tran 1m uic\n");
    EXPECT_NE(message.find(words), std::string::npos) << card << "\nsaid: " << message;
  }
  const std::string closing = message_of("V1 o 0 1\nB1 o 0 V=2\nR1 o 0 1\n.tran 1m uic\n");
  EXPECT_NE(closing.find("line 3: B1 closes a loop of voltage sources"), std::string::npos) << closing;
}

// An inverting amplifier of gain -10 (1 + 11/A) up to its limits.
TEST(Library, OperationalAmplifierSaturates) {
  const Circuit c = circuit_of(
      "V1 in 0 SIN(0 2 1k)\nR1 in n 1k\nR2 n out 10k\nX1 0 n out opamp Vmax=12 Vmin=-8\nC1 x 0 1u\nR3 x 0 1\n.tran 1u "
      "1m uic\n");
  for (const double t : {0.05e-3, 0.25e-3, 0.55e-3, 0.75e-3}) {
    const double ideal = -20 * std::sin(2 * pi * t / 1e-3);
    EXPECT_NEAR(values(c, t).at("V(out)"), std::clamp(ideal / (1 + 11e-5), -8.0, 12.0), 1e-6) << t;
  }
}

// With a pole: a follower settles with 1/(2 pi GBW) after it has risen at the slew rate.
TEST(Library, OperationalAmplifierWithItsBandwidth) {
  const Circuit c = circuit_of("V1 in 0 5\nX1 in out out opampgbw GBW=1meg SR=1meg\nR1 out 0 1k\n.tran 0.1u 20u uic\n");
  EXPECT_NEAR(values(c, 2e-6).at("V(out)"), 2, 1e-3);  // of the current in R = A / gm
  EXPECT_NEAR(values(c, 20e-6).at("V(out)"), 5 / (1 + 1e-5), 1e-6);
}

TEST(Library, Comparator) {
  const Circuit c = circuit_of(
      "V1 in 0 PWL(0 0 1m 2 2m 0)\nX1 in ref out comparator Vhigh=3 Vlow=1 Vh=0.5\nV2 ref 0 1\nR1 out 0 1k\nC1 x 0 1u\n"
      "R2 x 0 1\n.tran 1u 2m uic\n");
  for (const auto& [t, v] : {std::pair(0.74e-3, 1), {0.76e-3, 3}, {1.74e-3, 3}, {1.76e-3, 1}})
    EXPECT_NEAR(values(c, t).at("V(out)"), v, 1e-9) << t;
}

// At rest V = R i + k w and k i = b w + torque.
TEST(Library, MotorAtItsSpeed) {
  const Circuit c = circuit_of("V1 p 0 24\nX1 p 0 w dcmotor R=1 L=1m k=0.1 J=10u b=1m\nI1 w 0 0.2\n.tran 1m 2 uic\n");
  const double speed = (24 - 0.2 / 0.1) / (0.1 + 1e-3 / 0.1);
  const auto v = values(c, 2);
  EXPECT_NEAR(v.at("V(w)"), speed, 1e-6 * speed);
  EXPECT_NEAR(v.at("I(V1)"), -(1e-3 * speed + 0.2) / 0.1, 1e-5);
}

TEST(Library, OwnSubcircuitsGoBefore) {
  const Circuit c = circuit_of(
      ".subckt opamp a b c\nR1 a c 1\nR2 b 0 1\n.ends\nV1 in 0 1\nX1 in 0 out opamp\nR1 out 0 1\n.tran 1m 1m uic\n");
  EXPECT_NEAR(values(c, 1e-3).at("V(out)"), 0.5, 1e-12);
}

TEST(Library, TransistorsAsSwitches) {
  const Circuit c = circuit_of(
      "V1 d 0 10\nR1 d a 9.99\nX1 a g 0 mosfet Ron=10m\nVg g 0 PWL(0 0 1u 0 1u 10)\nR2 d b 9.99\nX2 b g 0 igbt Ron=10m "
      "Vce=1\nC1 x 0 1u\nR3 x 0 1\n.tran 1u 1m uic\n");
  const auto v = values(c, 0.5e-3);
  EXPECT_NEAR(v.at("I(R1)"), 1, 1e-4);  // of 1 megohm
  EXPECT_NEAR(v.at("I(R2)"), 0.9, 1e-4);
}

// Both halves of a wave.
TEST(Library, Triac) {
  const Circuit c = circuit_of(
      "V1 a 0 SIN(0 100 50)\nR1 a b 10\nX1 b 0 g triac\nVg g 0 PULSE(0 5 4m 0 0 0.1m 10m)\nC1 x 0 1u\nR2 x 0 1\n"
      ".tran 1m 20m uic\n");
  for (const double t : {3e-3, 5e-3, 13e-3, 15e-3})
    EXPECT_NEAR(values(c, t).at("I(R1)"), std::fmod(t, 10e-3) > 4e-3 ? 10 * std::sin(100 * pi * t) : 0, 2e-3) << t;
}

}  // namespace behaviour_test
}  // namespace bromwich
