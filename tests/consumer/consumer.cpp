// Solves a small scene through the installed package, by the CPU backend and by one of its own. It is compiled without
// the library's -march, so it also shows that arrays made by the library can be freed here, and the other way round.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>
#include <bromwich/kernels/cuda_backend.hpp>

#include "../support/reference_backend.hpp"

#include <cstdio>

int main() {
  bromwich::Scene scene = bromwich::make_scene("bridge");
  scene.x0 = bromwich::Vector(scene.x0);
  const auto backend = bromwich::make_cpu_backend(1);

  bromwich::Options options;
  options.steps = 200;
  options.method = bromwich::Method::march;
  const bromwich::Result result = bromwich::solve(scene, *backend, options);

  const auto own = bromwich::make_reference_backend();
  const double apart = (bromwich::solve(scene, *own, options).y - result.y).cwiseAbs().maxCoeff();

  std::printf("%s: %s, %td rows; %zu CUDA devices\n", scene.name.c_str(), bromwich::to_string(result.status),
              result.y.rows(), bromwich::cuda_devices().size());
  return result.status == bromwich::Status::solved && result.y.rows() == 201 && result.y.allFinite() && apart < 1e-10
             ? 0
             : 1;
}
