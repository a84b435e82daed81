// [[memory]]: elements with memory in scene files, each beside a closed form or modes followed one by one.

#include "files/memory_section.hpp"

#include "core/solve/dense_output.hpp"
#include "tests/files/scene_texts.hpp"
#include "tests/support/memory_oracle.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

namespace bromwich {
namespace memory_section_test {

constexpr double pi = std::numbers::pi;
/// Of states: the integrations of a solve to 1e-8 differ by less, and located times are exact to rounding.
constexpr double located_error = 1e-8;

Result solved(const std::string& text, const ParameterValues& settings = {}) {
  Options options;
  options.tolerance_x = 1e-8;
  options.states = StateSelection::all;
  const Result r = run(parse_sections(text, settings).scene, options);
  EXPECT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::events);
  return r;
}

Vector at_end(const Result& r) { return r.x.row(r.x.rows() - 1).transpose(); }

std::vector<double> times_of(const Result& r) {
  std::vector<double> times;
  for (const ModeChange& c : r.mode_changes) times.push_back(c.t);
  return times;
}

void expect_near(const std::vector<double>& found, const std::vector<double>& known, double error) {
  ASSERT_EQ(found.size(), known.size());
  for (std::size_t i = 0; i < known.size(); ++i) EXPECT_NEAR(found[i], known[i], error) << i;
}

void expect_oracle(const Result& r, const OracleRun& known, double size = 1) {
  expect_near(times_of(r), known.times, located_error * r.t[r.t.size() - 1]);
  const Vector end = at_end(r);
  for (Index i = 0; i < end.size(); ++i) EXPECT_NEAR(end[i], known.z[i], located_error * size) << i;
  ASSERT_EQ(r.modes.cols(), 1);
  EXPECT_EQ(r.modes(r.modes.rows() - 1, 0), double(known.mode));
}

// x' = -x, and 2 more while it heats: on below 0.9, off above 1.1, ln(1.1 / 0.9) each.
const std::string thermostat = R"toml(
[parameters]
low = 0.9
[dynamics]
A = [[-1]]
x0 = [1.1]
[names]
x = ["temperature"]
[[memory]]
name = "heater"
[memory.modes.off]
leave = [{ to = "on", when = "temperature < low" }]
[memory.modes.on]
f = ["2"]
leave = [{ to = "off", when = "temperature > 1.1" }]
[time]
T = "5.5*log(1.1/0.9)"
)toml";

TEST(MemorySection, AThermostat) {
  const double way = std::log(1.1 / 0.9);
  const Result r = solved(thermostat);
  EXPECT_NEAR(at_end(r)[0], 2 - 1.1 * std::exp(-way / 2), located_error);
  expect_near(times_of(r), {way, 2 * way, 3 * way, 4 * way, 5 * way}, 1e-9);
  EXPECT_EQ(r.y.cols(), 0);
  EXPECT_EQ(r.x.cols(), 1) << "modes are no states of the scene";
  EXPECT_EQ(r.modes(0, 0), 0);
  EXPECT_EQ(r.modes(r.modes.rows() - 1, 0), 1);
  const auto backend = make_cpu_backend(1);
  const Result between = at_times(parse_sections(thermostat).scene, *backend, r, {0.5 * way, 1.5 * way});
  EXPECT_EQ(between.modes(0, 0), 0);
  EXPECT_EQ(between.modes(1, 0), 1);
  EXPECT_NEAR(between.x(1, 0), 2 - 1.1 * std::exp(-way / 2), located_error);
}

TEST(MemorySection, ParametersAreThoseOfTheSolve) {
  const Result r = solved(thermostat, {{"low", 0.8}, {"T", std::log(1.1 / 0.8) + 0.01}});
  expect_near(times_of(r), {std::log(1.1 / 0.8)}, 1e-9);
}

TEST(MemorySection, AModeWhoseConditionHoldsIsLeftAtOnce) {
  const Result r = solved(with_replaced(thermostat, "x0 = [1.1]", "x0 = [0.5]"), {{"T", 0.2}});
  EXPECT_TRUE(r.mode_changes.empty());
  EXPECT_EQ(r.modes(0, 0), 1);
  EXPECT_NEAR(at_end(r)[0], 2 - 1.5 * std::exp(-0.2), located_error);
}

// A second memory follows the first by its name, one that stands before it.
TEST(MemorySection, AMemoryInTheConditionOfAnother) {
  const std::string lamp =
      "[[memory]]\nname = \"lamp\"\n[memory.modes.dark]\nleave = [{ to = \"lit\", when = \"heater > 0.5\" }]\n"
      "[memory.modes.lit]\nleave = [{ to = \"dark\", when = \"heater < 0.5\" }]\n[[memory]]";
  const Result r = solved(with_replaced(thermostat, "[[memory]]", lamp));
  ASSERT_EQ(r.modes.cols(), 2);
  EXPECT_EQ(r.modes.col(0), r.modes.col(1));
  EXPECT_EQ(r.mode_changes.size(), 10u);
}

// An integrator of a switch with hysteresis between 1 and -1, behind RC: x' = u - x, a period of 2 ln 3.
const std::string oscillator = R"toml(
[dynamics]
A = [[-1, 0], [0, 0]]
x0 = [0.5, 0]
[[memory]]
name = "switch"
start = "down"
[memory.modes.up]
f = [1, 1]
leave = [{ to = "down", when = "x0 >= 0.5" }]
[memory.modes.down]
f = [-1, -1]
leave = [{ to = "up", when = "x0 <= -0.5" }]
[time]
T = 7.3
)toml";

TEST(MemorySection, ASwitchWithHysteresis) {
  const double half = std::log(3.0);
  const Result r = solved(oscillator);
  std::vector<double> known;
  for (int k = 1; k * half < 7.3; ++k) known.push_back(k * half);
  ASSERT_EQ(known.size(), 6u);
  expect_near(times_of(r), known, 1e-9);
  // Down again, since 6 of them: x = -1 + 1.5 e^{-s}.
  EXPECT_NEAR(at_end(r)[0], -1 + 1.5 * std::exp(-(7.3 - 6 * half)), located_error);
  EXPECT_NEAR(at_end(r)[1], -(7.3 - 6 * half), located_error);
}

// A Schmitt trigger of a given signal, whose output is integrated: 1 from asin(0.625) on, 0 from pi + that on.
TEST(MemorySection, ASchmittTrigger) {
  const Result r = solved(R"toml(
[parameters]
high = 0.5
[definitions]
signal = "0.8*sin(2*pi*t)"
[dynamics]
A = [[0]]
x0 = [0]
[[memory]]
name = "trigger"
[memory.modes.low]
leave = [{ to = "high", when = "signal > high" }]
[memory.modes.high]
f = 1
leave = [{ to = "low", when = "-signal > high" }]
[time]
T = 2.5
)toml");
  const double first = std::asin(0.625) / (2 * pi);
  expect_near(times_of(r), {first, 0.5 + first, 1 + first, 1.5 + first, 2 + first}, 1e-9);
  EXPECT_NEAR(at_end(r)[0], 1.5 - first, located_error);
}

// A thyristor between a sine and R, L: it conducts from its gate on until its current is 0.
const std::string dimmer = R"toml(
[parameters]
R = 2
L = 0.01
angle = 0.003
[definitions]
v = "325*sin(2*pi*50*t)"
[dynamics]
A = [[0]]
x0 = [0]
[names]
x = ["i"]
[[memory]]
name = "thyristor"
[memory.modes.blocks]
leave = [{ to = "conducts", when = ["v > 0", "pulse(t - angle, 0.02, 0.0005) > 0.5"] }]
[memory.modes.conducts]
A = [["-R/L"]]
f = ["v/L"]
leave = [{ to = "blocks", when = "i < 0", set = { i = 0 } }]
[time]
T = 0.05
)toml";

// R, L and sin at angle phi behind the sine: i(s) = V/Z (sin(w s - phi) - sin(w a - phi) e^{-(s - a) R/L}).
TEST(MemorySection, AThyristor) {
  const double R = 2, L = 0.01, a = 0.003, w = 100 * pi, Z = std::hypot(R, w * L), phi = std::atan2(w * L, R);
  const auto current = [&](double s) {
    return 325 / Z * (std::sin(w * s - phi) - std::sin(w * a - phi) * std::exp(-(s - a) * R / L));
  };
  double low = 0.01, high = 0.0199;  // the current ends behind the zero of the voltage
  for (int k = 0; k < 60; ++k) (current((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
  const Result r = solved(dimmer);
  expect_near(times_of(r), {a, low, 0.02 + a, 0.02 + low, 0.04 + a}, 1e-10);
  EXPECT_NEAR(at_end(r)[0], current(0.01), 100 * located_error);
  const auto backend = make_cpu_backend(1);
  EXPECT_EQ(at_times(parse_sections(dimmer).scene, *backend, r, {0.019}).x(0, 0), 0);
}

// A body that is pushed aside, between thrusters: none within 0.5 of the aim, and until the other side of 0.4 once they
// push.
TEST(MemorySection, ADeadband) {
  const Result r = solved(R"toml(
[dynamics]
A = [[0, 1], [0, 0]]
f = [0, 0.2]
x0 = [0.2, 0.7]
[names]
x = ["angle", "rate"]
[[memory]]
name = "thrusters"
[memory.modes.none]
leave = [{ to = "minus", when = "angle + 0.2*rate > 0.5" }, { to = "plus", when = "angle + 0.2*rate < -0.5" }]
[memory.modes.minus]
f = [0, -1]
leave = [{ to = "none", when = "angle + 0.2*rate < 0.4" }]
[memory.modes.plus]
f = [0, 1]
leave = [{ to = "none", when = "angle + 0.2*rate > -0.4" }]
[time]
T = 12
)toml");
  // z = (angle, rate, 1).
  const auto mode = [](double push, std::vector<OracleMode::Way> ways) {
    Matrix A = Matrix::Zero(3, 3);
    A(0, 1) = 1, A(1, 2) = 0.2 + push;
    return OracleMode{A, std::move(ways)};
  };
  const std::vector<OracleMode> modes{mode(0, {{Vector{{1, 0.2, -0.5}}, 1}, {Vector{{-1, -0.2, -0.5}}, 2}}),
                                      mode(-1, {{Vector{{-1, -0.2, 0.4}}, 0}}), mode(1, {{Vector{{1, 0.2, 0.4}}, 0}})};
  const OracleRun known = run_of_modes(modes, 0, Vector{{0.2, 0.7, 1}}, 12);
  ASSERT_GE(known.times.size(), 4u);
  expect_oracle(r, known);
}

// A block that a spring pulls with speed V: it sticks up to Fs, slides against Fk, and sticks again where it stops.
const std::string stick_slip = R"toml(
[parameters]
k = 3
m = 0.5
V = 0.2
Fs = 1.2
Fk = 0.7
[dynamics]
A = [[0, 1], [0, 0]]
x0 = [0, 0]
[names]
x = ["q", "v"]
[[memory]]
name = "friction"
[memory.modes.sticks]
leave = [{ to = "slides", when = "k*(V*t - q) > Fs" }]
[memory.modes.slides]
A = [[0, 0], ["-k/m", 0]]
f = [0, "(k*V*t - Fk)/m"]
leave = [{ to = "sticks", when = "v < 0", set = { v = 0 } }]
[time]
T = 11
)toml";

TEST(MemorySection, StaticAboveKineticFriction) {
  const double k = 3, m = 0.5, V = 0.2, Fs = 1.2, Fk = 0.7, w = std::sqrt(k / m);
  const double first = Fs / (k * V), slides = 2 / w * (pi - std::atan((Fs - Fk) / (m * w * V))),
               sticks = 2 * (Fs - Fk) / (k * V);
  std::vector<double> known;
  for (double t = first; t < 11;) {
    known.push_back(t);
    if (t + slides < 11) known.push_back(t + slides);
    t += slides + sticks;
  }
  const Result r = solved(stick_slip);
  ASSERT_GE(known.size(), 5u);
  expect_near(times_of(r), known, 1e-8);
  // The force falls from Fs to 2 Fk - Fs while it slides, and then rises by k V.
  const double last = known[known.size() - 1];
  ASSERT_EQ(known.size() % 2, 0u) << "it sticks at T";
  EXPECT_NEAR(k * (V * 11 - at_end(r)[0]), 2 * Fk - Fs + k * V * (11 - last), 10 * located_error);
  EXPECT_EQ(at_end(r)[1], 0);
}

// Two memories add up: each heats, with limits of its own.
TEST(MemorySection, SeveralMemories) {
  const std::string second = R"toml(
[[memory]]
name = "second"
[memory.modes.off]
leave = [{ to = "on", when = "temperature < 0.85" }]
[memory.modes.on]
f = ["0.5"]
leave = [{ to = "off", when = "temperature > 1" }]
)toml";
  const Result r = solved(with_replaced(thermostat, "f = [\"2\"]", "f = [\"0.7\"]") + second, {{"T", 4}});
  // z = (x, 1), modes 2 first + second.
  std::vector<OracleMode> modes;
  for (const auto& [one, two] : {std::pair(0, 0), {0, 1}, {1, 0}, {1, 1}}) {
    OracleMode mode{Matrix{{-1, 0.7 * one + 0.5 * two}, {0, 0}}, {}};
    const auto way = [&](double sign, double limit, int to_one, int to_two) {
      mode.ways.push_back({Vector{{sign, -sign * limit}}, std::size_t(2 * to_one + to_two)});
    };
    one ? way(1, 1.1, 0, two) : way(-1, 0.9, 1, two);
    two ? way(1, 1, one, 0) : way(-1, 0.85, one, 1);
    modes.push_back(std::move(mode));
  }
  const OracleRun known = run_of_modes(modes, 0, Vector{{1.1, 1}}, 4);
  expect_near(times_of(r), known.times, 1e-8);
  ASSERT_GE(known.times.size(), 4u);
  EXPECT_NEAR(at_end(r)[0], known.z[0], located_error);
  EXPECT_EQ(2 * r.modes(r.modes.rows() - 1, 0) + r.modes(r.modes.rows() - 1, 1), double(known.mode));
}

// Of y: a current through a diode beside R = 0.5 or 2, x' = 1 - x - y, y = x / M.
TEST(MemorySection, ConditionsOfYAndChangesOfM) {
  const Result r = solved(R"toml(
[dynamics]
A = [[-1]]
B = [[-1]]
f = [2]
x0 = [0]
[complementarity]
N = [[-1]]
M = [[0.5]]
[names]
y = ["i"]
[[memory]]
name = "fuse"
[memory.modes.closed]
leave = [{ to = "open", when = "i > 1" }]
[memory.modes.open]
M = [[1.5]]
leave = [{ to = "closed", when = "2*i - 0.3*x0 < 0.1" }]
[time]
T = 2
)toml");
  const double first = -std::log(1 - 0.5 / (2.0 / 3)) / 3;  // x = 2/3 (1 - e^{-3t}) comes to 0.5
  expect_near(times_of(r), {first}, 1e-9);
  const double rest = 4.0 / 3;  // of x' = 2 - 1.5 x
  EXPECT_NEAR(at_end(r)[0], rest + (0.5 - rest) * std::exp(-1.5 * (2 - first)), located_error);
  EXPECT_NEAR(r.y(r.y.rows() - 1, 0), at_end(r)[0] / 2, located_error);
  EXPECT_EQ(r.y.cols(), 1);
  EXPECT_LE(r.residual, 1e-12) << "w has M of the mode";
}

// Other units of the state, and the mirror image.
TEST(MemorySection, UnitsAndSignsChangeNothing) {
  const auto of = [](double size) {
    const auto times = [size](double value) { return std::to_string(size) + "*" + std::to_string(value); };
    const std::string greater = size > 0 ? ">" : "<", less = size > 0 ? "<" : ">";
    return solved("[dynamics]\nA = [[-1, 0.2], [-0.3, -0.5]]\nx0 = [0, \"" + times(0.3) +
                  "\"]\n[[memory]]\nname = \"m\"\n[memory.modes.a]\nf = [\"" + times(2) +
                  "*sin(t)^2\", 0]\nleave = [{to "
                  "= \"b\", when = \"x0 - 0.5*x1 " +
                  greater + " " + times(0.8) +
                  "\"}]\n[memory.modes.b]\nA = [[-1, 0], "
                  "[0.5, 0]]\nleave = [{to = \"a\", when = \"x0 " +
                  less + " " + times(0.1) + "\"}]\n[time]\nT = 20\n");
  };
  const Result one = of(1);
  ASSERT_GE(one.mode_changes.size(), 4u);
  for (const double size : {-1.0, 3e6, -2e-6}) {
    const Result other = of(size);
    expect_near(times_of(other), times_of(one), 1e-8);
    EXPECT_LE((at_end(other) / size - at_end(one)).cwiseAbs().maxCoeff(), 10 * located_error) << size;
  }
}

// The period of a scene with modes, by shooting: the heater at a temperature outside that swings.
TEST(MemorySection, PeriodicStates) {
  const std::string text = with_replaced(with_replaced(dimmer, "x0 = [0]\n", ""), "T = 0.05",
                                         "T = 0.02\n[boundary]\nE0 = [[1]]\nET = [[-1]]\nb = [0]");
  Options options;
  options.steps = 64;
  options.states = StateSelection::all;
  const Result r = run(parse_sections(text, {{"angle", 0.008}, {"R", 0.5}}).scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.method, Method::shooting);
  EXPECT_NEAR(r.start[0], 0, 1e-12);
  ASSERT_EQ(r.multipliers.size(), 1u);
  EXPECT_NEAR(std::abs(r.multipliers[0]), 0, 1e-12) << "the current ends in each period";
}

TEST(MemorySection, MistakesAreNamed) {
  const auto message = [](const std::string& old, const std::string& by) {
    return refusal([&] { parse_sections(with_replaced(thermostat, old, by)); });
  };
  const auto expect_part = [](const std::string& found, const std::string& part) {
    EXPECT_NE(found.find(part), std::string::npos) << found;
    EXPECT_EQ(found.find('\n'), std::string::npos) << found;
  };
  expect_part(message("to = \"on\"", "to = \"onn\""),
              "my.toml:12: memory[0].modes.off.leave[0].to: found 'onn' (did you mean 'on'?)");
  expect_part(message("temperature < low", "temperature^2 < low"), "is not affine in x and y");
  expect_part(message("temperature < low", "max(temperature, 1) < low"), "is not affine in x and y");
  expect_part(message("temperature < low", "temperature*sin(t) < low"), "is not affine in x and y");
  expect_part(message("temperature < low", "temperature < low && t > 1"), "write one comparison");
  expect_part(message("temperature < low", "temperature"), "write one comparison");
  expect_part(message("temperature < low", "temprature < low"), "temprature");
  expect_part(message("name = \"heater\"\n", ""), "memory[0].name: is missing");
  expect_part(message("f = [\"2\"]", "f = [\"2\", \"1\"]"), "memory[0].modes.on.f: has 2");
  expect_part(message("f = [\"2\"]", "fs = [\"2\"]"), "memory[0].modes.on.fs: is no known key");
  expect_part(message("f = [\"2\"]", "A = [[1, 2]]"), "memory[0].modes.on.A: is 1 x 2");
  expect_part(message("when = \"temperature > 1.1\"", "when = []"), "when: is empty");
  expect_part(message("to = \"off\", ", ""), "to: is missing");
  expect_part(message("> 1.1\"", "> 1.1\", set = { hot = 1 }"), "set.hot: is no known key");
  const std::string again = "[[memory]]\nname = \"heater\"\n[memory.modes.a]\n";
  expect_part(refusal([&] { parse_sections(thermostat + again); }), "memory[1].name: 'heater' is taken");
  expect_part(refusal([&] { parse_sections(thermostat + "[[memory]]\nname = \"b\"\n"); }), "modes: ");
  expect_part(refusal([&] {
                parse_sections(with_replaced(thermostat, "name = \"heater\"", "name = \"heater\"\nstart = \"warm\""));
              }),
              "memory[0].start: found 'warm'");
}

}  // namespace memory_section_test
}  // namespace bromwich
