#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"

#include "core/scene/component_names.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

using reference::pi;

/// A built-in scene's exact solution at one time.
struct Exact {
  Vector x, y;
};

Exact exact(const Scene& scene, double t) {
  Exact at{Vector(scene.states()), Vector(scene.constraints())};
  scene.exact(t, at.x, at.y);
  return at;
}

/// Checks x' = A x + B y + f by central differences away from kinks, and complementarity everywhere.
void expect_exact(const Scene& scene, const std::vector<double>& kinks) {
  const oracle::DenseScene s = oracle::write_out(scene);
  if (const auto& ends = scene.boundary) {
    // Two products of entries up to 2 with |x| up to 12, in each row.
    EXPECT_LE((ends->E0 * exact(scene, 0).x + ends->ET * exact(scene, s.T).x - ends->b).cwiseAbs().maxCoeff(),
              100 * epsilon);
  } else {
    EXPECT_LE((exact(scene, 0).x - s.x0).cwiseAbs().maxCoeff(), 4 * epsilon);
  }
  const int samples = 997;
  const double d = 1e-4;
  for (int i = 0; i <= samples; ++i) {
    const double t = s.T * i / samples;
    const auto [x, y] = exact(scene, t);
    const Vector w = s.N * x + s.M * y + oracle::value(s.g, t, y.size());
    // |x|, |y|, |g| stay below 10 and N, M below 3: some 20 roundings of numbers up to 30.
    EXPECT_GE(y.minCoeff(), 0) << "t = " << t;
    EXPECT_GE(w.minCoeff(), -100 * epsilon) << "t = " << t;
    EXPECT_LE(y.cwiseMin(w).cwiseAbs().maxCoeff(), 100 * epsilon) << "t = " << t;
    const auto near = [&](double kink) { return std::abs(t - kink) <= 2 * d; };
    if (t < 2 * d || std::any_of(kinks.begin(), kinks.end(), near)) continue;
    // Fourth-order differences: error d^4 |x^(5)|/30 + 2 epsilon |x|/d, with |x^(5)| < 500 and |x| < 3.
    const Vector slope = (8 * (exact(scene, t + d).x - exact(scene, t - d).x) -
                          (exact(scene, t + 2 * d).x - exact(scene, t - 2 * d).x)) /
                         (12 * d);
    const Vector rate = s.A * x + s.B * y + oracle::value(s.f, t, x.size());
    EXPECT_LE((slope - rate).cwiseAbs().maxCoeff(), 5e-11) << "t = " << t;
  }
}

TEST(DlcpSmall, ExactSolutionSolvesTheProblem) {
  const Scene scene = make_scene("dlcp-small", {{"T", 2}});
  EXPECT_EQ(scene.lcp_class, LcpClass::Z);
  expect_exact(scene, {});  // x is smooth
}

TEST(DlcpSmall, ExactSolutionIsTheLeastElement) {
  const Scene scene = make_scene("dlcp-small");
  const oracle::DenseScene s = oracle::write_out(scene);
  for (int i = 0; i <= 200; ++i) {
    const double t = i / 200.;
    const auto [x, y] = exact(scene, t);
    const auto least = oracle::solve_lcp(s.M, s.N * x + oracle::value(s.g, t, 4), LcpClass::Z);
    ASSERT_TRUE(least) << "t = " << t;
    // The inverse of M on the active sets {}, {2}, {4} is at most 3; q has rounding errors of size 10 eps.
    EXPECT_LE((*least - y).cwiseAbs().maxCoeff(), 100 * epsilon) << "t = " << t;
  }
}

TEST(Bridge, ExactSolutionSolvesTheProblem) {
  for (const double nu : {0., 0.3, 1., 2.}) {
    const Scene scene = make_scene("bridge", {{"nu", nu}, {"T", 5 * pi}});
    EXPECT_EQ(scene.lcp_class, LcpClass::P);
    std::vector<double> kinks;  // x'' is continuous but x''' is not where x = 0
    for (int k = 0; k < 4; ++k) kinks.insert(kinks.end(), {1.5 * pi * k, 1.5 * pi * k + pi / 2});
    expect_exact(scene, kinks);
  }
  // Two swings: x(3 pi) = (0, nu + 4/15).
  const auto [x, y] = exact(make_scene("bridge", {{"nu", 0.3}}), 3 * pi);
  EXPECT_NEAR(x[0], 0, 1e-14);
  EXPECT_NEAR(x[1], 0.3 + 4. / 15, 1e-14);
  EXPECT_FALSE(make_scene("bridge", {{"nu", -1}}).exact);
}

TEST(NashGame, ExactSolutionSolvesTheProblem) {
  const Scene scene = make_scene("nash-game");
  expect_exact(scene, {});  // f has kinks, not x
  EXPECT_EQ(scene.free_rows.size(), 0u) << "the shared constraint is an inequality";
  const Scene game = make_scene("nash-game", {{"game", 1}});
  EXPECT_FALSE(game.exact);
  EXPECT_EQ(to_dense(game.M), to_dense(scene.M));
  EXPECT_EQ(oracle::value(game.f, 0.25, 4), (Vector{{-2, 0, -0.5, 0}}));
}

TEST(LqControl, ExactSolutionSolvesTheProblem) {
  for (const double bound : {4.5, 5., 8.}) {
    const Scene scene = make_scene("lq-control", {{"bound", bound}});
    const double k = bound < 6 ? bound / std::sqrt(3 - 12 / bound) : 6, a = bound < k ? (1 - bound / k) / 2 : 0;
    expect_exact(scene, {a, 1 - a});
    // The integrand is quadratic between the switches: Simpson's rule on each of the three pieces is exact.
    double cost = 0;
    for (const auto& [from, to] : {std::pair(0., a), std::pair(a, 1 - a), std::pair(1 - a, 1.)})
      for (const auto& [place, weight] : {std::pair(from, 1.), std::pair((from + to) / 2, 4.), std::pair(to, 1.)}) {
        const auto [x, y] = exact(scene, place);
        cost += (to - from) / 6 * weight * std::pow(-x[3] - y[0] + y[1], 2) / 2;
      }
    if (bound == 5) {
      EXPECT_NEAR(cost, 6.045027756, 1e-8);
    }  // to the printed digits
    if (bound == 8) {
      EXPECT_NEAR(cost, 6, 1e-14);
    }
  }
}

TEST(PeriodicRectifier, ByHand) {
  const Scene scene = make_scene("periodic-rectifier");
  const auto& d = get<DenseDynamics>(scene.dynamics);
  EXPECT_DOUBLE_EQ(d.A(0, 0), -10);
  EXPECT_DOUBLE_EQ(d.B(0, 0), 1000);
  EXPECT_DOUBLE_EQ(scene.T, 0.02);
  EXPECT_DOUBLE_EQ(oracle::value(scene.g, 0.005, 1)[0], -10);
  EXPECT_EQ(scene.boundary->E0, -scene.boundary->ET);
}

TEST(Signorini, OnePointByHand) {
  const Scene scene = make_scene("signorini", {{"Q", 1}});
  const oracle::DenseScene s = oracle::write_out(scene);
  const double c = 2e-3;
  EXPECT_DOUBLE_EQ(s.A(0, 0), -16 * c);  // dx = 1/2, -2 c/dx^2 in either direction
  EXPECT_DOUBLE_EQ(s.B(0, 0), 4 * c);
  EXPECT_DOUBLE_EQ(s.N(0, 0), -2);
  EXPECT_DOUBLE_EQ(s.M(0, 0), 4);
  EXPECT_DOUBLE_EQ(s.x0[0], 0.125);
  EXPECT_DOUBLE_EQ(s.T, 4);
  EXPECT_EQ(scene.default_steps, 400);
  EXPECT_EQ(scene.lcp_class, LcpClass::P);
  for (const double t : {0., 0.3, 4.}) {
    const double psi = std::sin(2 * pi * t);  // x2 = 1/2
    EXPECT_DOUBLE_EQ(oracle::value(s.f, t, 1)[0], 4 * c * psi);
    EXPECT_DOUBLE_EQ(oracle::value(s.g, t, 1)[0], 4 * psi);
  }
}

TEST(Signorini, ThreePointsByHand) {
  const Scene scene = make_scene("signorini", {{"dx", 0.25}, {"c", 0.5}, {"T", 1}});
  const oracle::DenseScene s = oracle::write_out(scene);
  ASSERT_EQ(s.A.rows(), 9);
  EXPECT_DOUBLE_EQ(s.T, 1);
  EXPECT_EQ(s.M, (Matrix{{4, -1, 0}, {-1, 4, -1}, {0, -1, 4}}));
  for (Index line = 0; line < 3; ++line)
    for (Index i = 0; i < 9; ++i) {
      EXPECT_DOUBLE_EQ(s.B(i, line), i == 3 * line ? 8 : 0);
      EXPECT_DOUBLE_EQ(s.N(line, i), i == 3 * line ? -2 : 0);
    }
  EXPECT_DOUBLE_EQ(s.A(4, 4), -32);
  EXPECT_DOUBLE_EQ(s.A(4, 3), 8);
  EXPECT_DOUBLE_EQ(s.A(4, 1), 8);
  const double side = 3. / 16, middle = 1. / 4;  // x (1-x)
  const double expected[9] = {side * side,   side * middle, side * side,   side * middle, middle * middle,
                              side * middle, side * side,   side * middle, side * side};
  for (Index i = 0; i < 9; ++i) EXPECT_DOUBLE_EQ(s.x0[i], 2 * expected[i]);
  // x2 = 1/4 and 3/4 belong to the outer part.
  const double t = 0.3, a = 4 / 1.3, b = std::sin(0.6 * pi);
  const Vector phi = oracle::value(scene.f, t, 3), g = oracle::value(scene.g, t, 3);
  EXPECT_EQ(scene.f_entry, SourceEntry::through_B);
  const double psi[3] = {a, b, a}, M_psi[3] = {4 * a - b, 4 * b - 2 * a, 4 * a - b};
  for (Index i = 0; i < 3; ++i) {
    EXPECT_DOUBLE_EQ(phi[i], psi[i]);
    EXPECT_NEAR(g[i], M_psi[i], 32 * epsilon);  // sums of three terms up to 13
  }
}

TEST(Signorini, ObstacleJumpsAtTheQuarters) {
  for (const Index Q : {3, 7, 39, 127, 511}) {
    const Scene scene = make_scene("signorini", {{"Q", double(Q)}});
    const Vector psi = oracle::value(scene.f, 0, Q);  // 4 outside, 0 inside
    const Index quarter = (Q + 1) / 4;
    for (Index i = 1; i <= Q; ++i) EXPECT_EQ(psi[i - 1], i <= quarter || i >= 3 * quarter ? 4 : 0) << Q << " " << i;
  }
}

TEST(Signorini, SpacingInsteadOfPoints) {
  EXPECT_EQ(make_scene("signorini").constraints(), 39);
  EXPECT_EQ(make_scene("signorini", {{"dx", 0.0078125}}).constraints(), 127);
  EXPECT_EQ(make_scene("signorini", {{"dx", 0.0666666667}}).constraints(), 14);
}

/// The line of the Error that make_scene throws, or "" where it does not throw.
std::string refusal_of(const std::string& name, const ParameterValues& values) {
  try {
    make_scene(name, values);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Catalogue, ListsItsScenes) {
  std::vector<std::string> names;
  for (const SceneRecipe& recipe : scene_catalogue()) {
    names.push_back(recipe.name);
    EXPECT_FALSE(recipe.summary.empty());
    EXPECT_EQ(make_scene(recipe.name).name, recipe.name);  // the defaults are valid
    for (const SceneParameter& parameter : recipe.parameters) EXPECT_FALSE(parameter.meaning.empty());
  }
  EXPECT_EQ(names, (std::vector<std::string>{"signorini", "signorini3d", "contact", "dlcp-small", "bridge", "nash-game",
                                             "lq-control", "periodic-rectifier", "ph-toy", "ladder", "ladder-diodes",
                                             "put", "put-on-two"}));
}

// A applied to cash is -r; the payoff and its jumps at the dates.
TEST(Put, IsTheSceneOfItsText) {
  const double r = 0.05;
  const Scene scene = make_scene("put", {{"q", 0.03}, {"points", 400}, {"dividend", 0.02}, {"dividends", 2}});
  const SparseMatrix& A = scene.dynamics->matrices()->A;
  const Index n = scene.states(), spot = find_state(scene, "spot");
  const Vector cash = A * Vector::Ones(n);
  EXPECT_NEAR(cash[spot], -r, 1e-9);
  // The payoff jumps down in t at both dates, to K - S there.
  Vector g(n), later(n);
  scene.g(0.2, g);
  scene.g(0.9, later);
  EXPECT_EQ(scene.breakpoints, (std::vector<double>{0.25, 0.75}));
  EXPECT_NEAR(g[spot], -(100 - 100 * 0.98 * 0.98), 1e-9);
  EXPECT_NEAR(later[spot], 0, 1e-9);
  EXPECT_THROW(make_scene("put", {{"dividend", 1}}), Error);
  EXPECT_THROW(make_scene("put", {{"points", 3}}), Error);
  EXPECT_THROW(make_scene("put-on-two", {{"rho", 1}}), Error);
  EXPECT_THROW(make_scene("put-on-two", {{"basket", 2}}), Error);
}

// g, A, B, N and M as the text of the scene says, at one point.
TEST(Contact, IsTheSceneOfItsText) {
  const Index Q = 5;
  const Scene scene = make_scene("contact", {{"Q", double(Q)}, {"c", 0.3}, {"eps", 0.25}});
  const oracle::DenseScene s = oracle::write_out(scene);
  const double dx = 1. / 6, t = 0.7, x = 2 * dx, rise = 1 - std::exp(-5 * t);
  const double expected = 0.5 * std::sin(3 * t) * rise * std::sin(pi * x) * (1 + 0.5 * std::cos(5 * x)) +
                          0.05 * rise * std::sin(7 * pi * x);
  EXPECT_NEAR(oracle::value(s.g, t, Q)[1], expected, 8 * epsilon);
  EXPECT_NEAR(s.A(Q, Q), -4 * 0.3 / (dx * dx), 1e-13);
  EXPECT_NEAR(s.A(Q, 2 * Q), 0.3 / (dx * dx), 1e-14);  // across the lines
  EXPECT_NEAR(s.B(Q, 1), 1 / dx, 1e-14);
  EXPECT_EQ(s.B.cwiseAbs().sum(), double(Q) * s.B(Q, 1));
  EXPECT_EQ(s.N(1, Q), 1);
  EXPECT_EQ(s.N.sum(), double(Q));
  EXPECT_EQ((s.M - 0.25 * Matrix::Identity(Q, Q)).norm(), 0);
  EXPECT_EQ(scene.x0.norm(), 0);
  EXPECT_THROW(make_scene("contact", {{"eps", -1e-9}}), Error);
  EXPECT_THROW(make_scene("contact", {{"c", 0}}), Error);
  EXPECT_THROW(make_scene("contact", {{"Q", 2.5}}), Error);
}

TEST(Catalogue, RefusesUnknownNamesAndListsTheKnown) {
  const std::string scene = refusal_of("signorino", {});
  for (const char* part : {"scene:", "signorino", "signorini", "dlcp-small", "bridge"})
    EXPECT_NE(scene.find(part), std::string::npos) << scene;
  const std::string key = refusal_of("bridge", {{"mu", 1}});
  for (const char* part : {"mu:", "bridge", "nu", "T"}) EXPECT_NE(key.find(part), std::string::npos) << key;
}

TEST(Catalogue, RefusesValuesOutOfRange) {
  const double nan = std::nan("");
  const std::vector<std::pair<std::string, ParameterValues>> bad{
      {"signorini", {{"Q", 0}}},     {"signorini", {{"Q", -3}}},     {"signorini", {{"Q", 4096}}},
      {"signorini", {{"Q", 2.5}}},   {"signorini", {{"Q", nan}}},    {"signorini", {{"dx", 0}}},
      {"signorini", {{"dx", -0.1}}}, {"signorini", {{"dx", 0.3}}},   {"signorini", {{"dx", 1}}},
      {"signorini", {{"dx", 1e-4}}}, {"signorini", {{"dx", nan}}},   {"signorini", {{"dx", 0.025}, {"Q", 39}}},
      {"signorini", {{"c", 0}}},     {"signorini", {{"c", -1}}},     {"signorini", {{"T", 0}}},
      {"dlcp-small", {{"T", -1}}},   {"bridge", {{"T", 0}}},         {"bridge", {{"nu", nan}}},
      {"nash-game", {{"game", 2}}},  {"lq-control", {{"bound", 4}}}, {"periodic-rectifier", {{"C", 0}}}};
  for (const auto& [name, values] : bad) {
    const std::string &key = values.begin()->first, line = refusal_of(name, values);
    const std::string start = values.size() == 2 ? "dx:" : key + ":";
    EXPECT_EQ(line.rfind(start, 0), 0u) << name << " " << key << " = " << values.begin()->second << " gave: " << line;
  }
}

}  // namespace
}  // namespace bromwich
