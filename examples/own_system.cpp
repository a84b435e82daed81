// A system of your own: an RLC circuit with a diode.
//
//     C v' = -i - i_D,  L i' = v,  0 <= i_D ⊥ -v + R i_D >= 0,  v(0) = 10, i(0) = 0
//
// State x = (v, i), constraint y = i_D (the current through the diode), w = -v + R y (the voltage it blocks).

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <cstdio>

int main() {
  using namespace bromwich;
  const double L = 1e-2, C = 1e-6, R = 1e3;

  Scene scene;
  scene.name = "rlcd";
  scene.dynamics =
      DenseDynamics{.A = Matrix{{0, -1 / C}, {1 / L, 0}}, .B = Matrix{{-1 / C}, {0}}, .N = Matrix{{-1, 0}}};
  scene.M = Matrix{{R}};
  scene.x0 = Vector{{10, 0}};
  scene.T = 5e-3;

  const auto backend = make_cpu_backend();
  const Result result = solve(scene, *backend, {.steps = 4000, .states = StateSelection::all});

  std::printf("%s by %s, residual %.1e\n", to_string(result.status), to_string(result.method), result.residual);
  const Index J = result.steps;
  std::printf("at t = %g: v = %.6f V, i = %.6f A, diode current %.6f A\n", result.t[J], result.x(J, 0), result.x(J, 1),
              result.y(J, 0));
  return result.status == Status::solved ? 0 : 1;
}
