// The parabolic Signorini problem by the functional iteration and by marching: the same discrete solution, two ways.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <cstdio>

int main() {
  using namespace bromwich;
  const Scene scene = make_scene("signorini", {{"Q", 39}});
  const auto backend = make_cpu_backend();

  const Result all_at_once = solve(scene, *backend, {.method = Method::contour});
  const Result step_by_step = solve(scene, *backend, {.method = Method::march});

  for (const Result* r : {&all_at_once, &step_by_step})
    std::printf("%-8s %s, %3ld sweeps, residual %.1e, %.2f ms; %s\n", to_string(r->method), to_string(r->status),
                long(r->iterations), r->residual, 1e3 * r->seconds.total, r->kernel.c_str());
  std::printf("largest difference of y: %.1e\n", (all_at_once.y - step_by_step.y).cwiseAbs().maxCoeff());

  // The state is computed on request: here the temperature at the end, in the whole square, from a few contours.
  const Matrix end = states_at(scene, *backend, all_at_once, {all_at_once.steps});
  std::printf("V at the centre of the square at t = %g: %.6f\n", scene.T, end(19 * 39 + 19, 0));
  return all_at_once.status == Status::solved ? 0 : 1;
}
