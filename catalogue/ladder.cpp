// A ladder of n RLC cells driven by a current, the second example of Bartel and Schaller, Goal-oriented time adaptivity
// for port-Hamiltonian systems (section 6), and the same with a diode that clamps its input.
//
// symbol  here                 meaning
// x       (e0, e1, j1, e2,     node voltages (V) and inductor currents (A), m = 3n + 1
//          e3, j2, ..., e2n)
// E       diag(C, E0, ..)      E0 = diag(CR, L, C)
// J       diag(0, J0, ..)      J0 = [[0, -1, 0], [1, 0, -1], [0, 1, 0]]
// R       diag(R0, .., 1/RL)   R0 = [[1/R1 + 1/Rd, -1/Rd, 0], [-1/Rd, 1/Rd, 0], [0, 0, 0]]
// B, u    e_1, sin(5e6 pi t)   current into the first node (A)
//
// The diode: 0 <= y ⊥ clamp - e0 + r y >= 0, its current y leaves the first node.

#include "catalogue/recipes.hpp"
#include "core/scene/port_hamiltonian.hpp"

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

constexpr double most_ladder_cells = 100000;

namespace circuit {
constexpr double C = 5e-7, CR = 5e-9, L = 1e-6, Rd = 5, R1 = 200, RL = 10;
}

PortHamiltonian ladder(Index n) {
  using namespace circuit;
  using Entries = std::vector<Eigen::Triplet<double>>;
  const Index m = 3 * n + 1;
  Entries E{{0, 0, C}}, J, R{{int(m - 1), int(m - 1), 1 / RL}};
  for (Index c = 0; c < n; ++c) {
    const int k = int(3 * c);  // e_2c, e_2c+1, j_c+1, and e_2c+2 at k + 3
    E.emplace_back(k + 1, k + 1, CR);
    E.emplace_back(k + 2, k + 2, L);
    E.emplace_back(k + 3, k + 3, C);
    J.emplace_back(k + 1, k + 2, -1);
    J.emplace_back(k + 2, k + 1, 1);
    J.emplace_back(k + 2, k + 3, -1);
    J.emplace_back(k + 3, k + 2, 1);
    R.emplace_back(k, k, 1 / R1 + 1 / Rd);
    R.emplace_back(k, k + 1, -1 / Rd);
    R.emplace_back(k + 1, k, -1 / Rd);
    R.emplace_back(k + 1, k + 1, 1 / Rd);
  }
  const auto matrix = [](Index rows, Index cols, const Entries& entries) {
    SparseMatrix X(rows, cols);
    X.setFromTriplets(entries.begin(), entries.end());
    return X;
  };
  PortHamiltonian port;
  port.E = matrix(m, m, E);
  port.J = matrix(m, m, J);
  port.R = matrix(m, m, R);
  port.B = matrix(m, 1, {{0, 0, 1}});
  port.u = [](double t, Eigen::Ref<Vector> u) { u[0] = std::sin(5e6 * std::numbers::pi * t); };
  return port;
}

Scene build_ladder(const ParameterValues& values) {
  const double n = values.at("n");
  if (!(n >= 1 && n <= most_ladder_cells) || n != std::floor(n))
    throw Error("n", "found " + number_text(n), "give an integer from 1 to 100000");
  PortHamiltonian port = ladder(Index(n));
  const Vector x0 = Vector::Constant(port.states(), 1e-7);
  Scene scene = make_scene(std::move(port), x0, positive_parameter(values, "T"));
  scene.default_steps = 1000;
  return scene;
}

Scene build_ladder_diodes(const ParameterValues& values) {
  Scene scene = build_ladder(values);
  const Index m = scene.states();
  const double clamp = values.at("clamp"), r = values.at("r");
  if (!(r >= 0)) throw Error("r", "found " + number_text(r), "give a number from 0 on");
  SparseMatrix B(m, 1), N(1, m);
  B.insert(0, 0) = -1 / circuit::C;
  N.insert(0, 0) = -1;
  scene.dynamics = Dynamics(scene.dynamics->with_inputs_and_outputs(B, N));
  scene.M = Matrix(Matrix::Constant(1, 1, r));
  scene.lcp_class = LcpClass::automatic;
  scene.g = [clamp](double, Eigen::Ref<Vector> g) { g[0] = clamp; };
  scene.default_steps = 2000;
  return scene;
}

}  // namespace

SceneRecipe ladder_recipe() {
  return {"ladder",
          "port-Hamiltonian ladder of n RLC cells driven by a current, 3n + 1 states",
          {{"n", 5, "cells"}, {"T", 5e-6, "final time"}},
          build_ladder};
}

SceneRecipe ladder_diodes_recipe() {
  return {"ladder-diodes",
          "the ladder with a diode that clamps its input",
          {{"n", 5, "cells"},
           {"clamp", 0.1, "voltage at which the diode conducts"},
           {"r", 1, "resistance of the diode"},
           {"T", 5e-6, "final time"}},
          build_ladder_diodes};
}

}  // namespace bromwich
