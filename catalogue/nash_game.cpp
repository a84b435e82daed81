// A differential game of two players with bounded controls and a shared constraint, by the maximum principle (after
// example 5.2 of the paper on exponential Galerkin methods, whose data are not printed in full):
//
//     x = (y1, p1, y2, p2): state and costate of each player,   y = (u1, u2, u3, u4, mu),
//     x' = A x + B u + f,   0 <= u ⊥ Q x + M4 u + mu e + g >= 0,   0 <= mu ⊥ 1 - e^T u >= 0,
//
// y1, y2 given at 0 and p_i(1) - 2 y_i(1) at 1. M = [[M4, e], [-e^T, 0]] is singular, PSD and not P.
//
// The matrices come from those of the players: with B1 = (1, 2), B2 = (2, 1) for the controls, P = [[1, 1], [0, -1]],
// S = [[1, 0, 0, 1], [0, 1, 1, 0]], R = [[1, 1, 1/2, 0], [1, 1, 0, 1/2], [0, 0, -1, 1], [0, 0, 1, -1]].

#include "catalogue/recipes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using Vector4 = Eigen::Vector4d;
using Vector5 = Eigen::Matrix<double, 5, 1>;

struct GameMatrices {
  Eigen::Matrix4d A;
  Eigen::Matrix<double, 4, 5> B;
  Eigen::Matrix<double, 5, 4> N;
  Eigen::Matrix<double, 5, 5> M;
};

GameMatrices game_matrices() {
  GameMatrices m;
  // clang-format off
  m.A << 2, 0, 0, 0,
         -2, -2, -1, 0,
         0, 0, -1, 0,
         1, 0, -2, 1;
  m.B << 1, 2, 0, 0, 0,
         -1, 0, 0, -1, 0,
         0, 0, 2, 1, 0,
         0, 1, 1, 0, 0;
  m.N << 1, 1, 0, 0,
         0, 2, 1, 0,
         0, 0, -1, 2,
         -1, 0, 0, 1,
         0, 0, 0, 0;
  m.M << 2, 2, 0.5, 0, 1,
         2, 2, 0, 0.5, 1,
         -0.5, 0, 2, -2, 1,
         0, -0.5, -2, 2, 1,
         -1, -1, -1, -1, 0;
  // clang-format on
  return m;
}

Vector4 game_state(double t) {
  return {t - 1, 1 + std::sin(std::numbers::pi * t), 2 * std::cos(t), (4 * std::cos(1.) - 1) * std::exp(t - 1)};
}
Vector4 game_derivative(double t) {
  return {1, std::numbers::pi * std::cos(std::numbers::pi * t), -2 * std::sin(t),
          (4 * std::cos(1.) - 1) * std::exp(t - 1)};
}
Vector5 game_controls(double t) {
  Vector5 z;
  z << t / 2, std::max(0.3 - t, 0.), 0.25, t < 0.5 ? t : 0.75 - t / 2, std::max(t - 0.5, 0.);
  return z;
}
Vector5 game_slack(double t) {
  Vector5 w = Vector5::Zero();
  w[1] = std::max(t - 0.3, 0.);
  w[4] = 1 - game_controls(t).head<4>().sum();
  return w;
}

Scene build_nash_game(const ParameterValues& values) {
  const double game = values.at("game");
  if (game != 0 && game != 1) throw Error("game", "found " + number_text(game), "give 0 or 1");
  const GameMatrices m = game_matrices();
  Matrix E0 = Matrix::Zero(4, 4), ET = Matrix::Zero(4, 4);
  E0(0, 0) = E0(1, 2) = 1;
  ET(2, 0) = ET(3, 2) = -2;
  ET(2, 1) = ET(3, 3) = 1;

  Scene scene;
  scene.dynamics = DenseDynamics{m.A, m.B, m.N};
  scene.M = Matrix(m.M);
  scene.lcp_class = LcpClass::PSD;
  scene.boundary = BoundaryCondition{E0, ET, Vector{{-1, 2, 1, -1}}};
  scene.T = 1;
  scene.default_steps = 400;
  if (game == 1) {
    scene.f = [](double t, Eigen::Ref<Vector> f) { f << -2, 0, -2 * t, 0; };
    scene.g = [](double, Eigen::Ref<Vector> g) { g << 0, 0, 0, 0, 1; };
    return scene;
  }
  // x, z and w are prescribed, and f, g follow from them.
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    f = game_derivative(t) - m.A * game_state(t) - m.B * game_controls(t);
  };
  scene.g = [m](double t, Eigen::Ref<Vector> g) { g = game_slack(t) - m.N * game_state(t) - m.M * game_controls(t); };
  scene.exact = [](double t, Eigen::Ref<Vector> x, Eigen::Ref<Vector> y) {
    x = game_state(t);
    y = game_controls(t);
  };
  return scene;
}

}  // namespace

SceneRecipe nash_game_recipe() {
  return {"nash-game",
          "a game of two players over time, conditions at both ends, M singular; the exact solution is known",
          {{"game", 0, "1: the game itself, whose solution is not known"}},
          build_nash_game};
}

}  // namespace bromwich
