// Three states, one port, constant structure; the first example of Bartel and Schaller, Goal-oriented time adaptivity
// for port-Hamiltonian systems (section 6):
//
//     x' = (J - R) x + B u,   J = [[0, 0, 1], [0, 0, -1], [-1, 1, 0]],   B = (1, 1, 0)^T,   x(0) = (1, 2, 1),
//
// u = 0 for t <= 5 and 10 afterwards. Eigenvalues of J - R: -2, ±1.41i (variant 1: not exponentially stable), -1, -1
// ± 1.41i (variant 2), -10, -10 ± 1.41i (variant 3).

#include "catalogue/recipes.hpp"
#include "core/scene/port_hamiltonian.hpp"

#include <cmath>

namespace bromwich {
namespace {

Matrix toy_dissipation(double variant) {
  if (variant == 1) return Matrix{{1, 1, 0}, {1, 1, 0}, {0, 0, 0}};
  if (variant == 2) return Matrix::Identity(3, 3);
  if (variant == 3) return 10 * Matrix::Identity(3, 3);
  throw Error("variant", "found " + number_text(variant), "give 1, 2 or 3");
}

Scene build_ph_toy(const ParameterValues& values) {
  const double input = values.at("u"), start = 5, scale = values.at("r");
  if (!(scale >= 0)) throw Error("r", "found " + number_text(scale), "give a number from 0 on");
  PortHamiltonian port;
  port.J = Matrix{{0, 0, 1}, {0, 0, -1}, {-1, 1, 0}}.sparseView();
  port.R = (scale * toy_dissipation(values.at("variant"))).sparseView();
  port.B = Matrix{{1}, {1}, {0}}.sparseView();
  if (input != 0) {
    port.u = [input, start](double t, Eigen::Ref<Vector> u) { u[0] = t > start ? input : 0; };
    port.jumps = {start};
  }
  Scene scene = make_scene(std::move(port), Vector{{1, 2, 1}}, positive_parameter(values, "T"));
  scene.default_steps = 200;
  return scene;
}

}  // namespace

SceneRecipe ph_toy_recipe() {
  return {"ph-toy",
          "port-Hamiltonian system of three states, its input jumps at t = 5",
          {{"variant", 1, "dissipation: 1 = R1 (undamped modes), 2 = I, 3 = 10 I"},
           {"u", 10, "input after t = 5"},
           {"r", 1, "factor of the dissipation"},
           {"T", 10, "final time"}},
          build_ph_toy};
}

}  // namespace bromwich
