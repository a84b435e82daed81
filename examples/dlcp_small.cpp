// A Z-matrix scene with a known solution: second-order convergence of y, where implicit Euler has first order.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <cmath>
#include <cstdio>

int main() {
  using namespace bromwich;
  const Scene scene = make_scene("dlcp-small");
  const auto backend = make_cpu_backend();
  const auto error = [&](const Result& r) {
    Vector x(scene.states()), y(scene.constraints());
    double worst = 0;
    for (Index j = 0; j <= r.steps; ++j) {
      scene.exact(r.t[j], x, y);
      worst = std::fmax(worst, (r.y.row(j).transpose() - y).cwiseAbs().maxCoeff());
    }
    return worst;
  };
  std::printf("%8s %12s %12s\n", "steps", "march", "euler");
  for (Index steps = 128; steps <= 2048; steps *= 2) {
    const Result march = solve(scene, *backend, {.method = Method::march, .steps = steps});
    const Result euler = solve(scene, *backend, {.method = Method::euler, .steps = steps});
    std::printf("%8ld %12.2e %12.2e\n", long(steps), error(march), error(euler));
  }
}
