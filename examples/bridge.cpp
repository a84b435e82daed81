// A suspension bridge whose cables go slack: an undamped oscillator. Its spectrum is imaginary, so no contour exists;
// the solver uses the matrix exponential and reports it.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <cstdio>

int main() {
  using namespace bromwich;
  const Scene scene = make_scene("bridge");
  const auto backend = make_cpu_backend();
  const Result r = solve(scene, *backend, {.method = Method::contour, .steps = 9600, .states = StateSelection::all});
  Vector x(2), y(1);
  scene.exact(scene.T, x, y);
  std::printf("%s, %ld sweeps; kernel: %s\n", to_string(r.status), long(r.iterations), r.kernel.c_str());
  std::printf("x(3 pi) = (%.7f, %.7f), exact (%.7f, %.7f)\n", r.x(r.steps, 0), r.x(r.steps, 1), x[0], x[1]);
  return r.status == Status::solved ? 0 : 1;
}
