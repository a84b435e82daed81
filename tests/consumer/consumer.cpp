// Solves a small scene through the installed package, and calls a function of each of its libraries. It is compiled
// without the library's -march, so it also shows that arrays made by the library can be freed here, and the other way
// round.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>
#include <bromwich/kernels/cuda_backend.hpp>

#include <cmath>
#include <cstdio>

using namespace bromwich;

namespace {

// The gradient of y_J by x0, by differences of two solves and backward.
double gradient_error(const Scene& scene, Backend& backend, const Options& options, const Result& result) {
  const SolutionDerivative derivative(scene, result);
  SolutionChange last{RowMatrix::Zero(result.y.rows(), result.y.cols()), {}, {}, {}};
  last.y(result.steps, 0) = 1;
  const double gradient = derivative.vjp(last).x0[0];
  Scene moved = scene;
  const double d = 1e-6;
  moved.x0[0] += d;
  const double change = bromwich::solve(moved, backend, options).y(result.steps, 0) - result.y(result.steps, 0);
  return std::abs(change / d - gradient);
}

}  // namespace

int main() {
  Scene scene = make_scene("bridge");
  scene.x0 = Vector(scene.x0);
  const auto backend = make_cpu_backend(1);

  Options options;
  options.steps = 200;
  options.method = Method::march;
  const Result result = solve(scene, *backend, options);
  std::printf("%s: %s, %td rows; %zu CUDA devices\n", scene.name.c_str(), to_string(result.status), result.y.rows(),
              cuda_devices().size());
  if (result.status != Status::solved || result.y.rows() != 201 || !result.y.allFinite()) return 1;

  // x' = -x + y, y = max(0, -x - g): smooth where y > 0.
  Scene small;
  small.dynamics = DenseDynamics{.A = Matrix{{-1}}, .B = Matrix{{1}}, .N = Matrix{{1}}};
  get<DenseDynamics>(small.dynamics).A(0, 0) = -2;
  small.M = Matrix{{1}};
  small.x0 = Vector{{-1}};
  small.g = [](double, Eigen::Ref<Vector> g) { g[0] = -1; };
  const Result of_small = solve(small, *backend, options);
  const double gradient = gradient_error(small, *backend, options, of_small);

  const BatchResult batch = solve_batch(batch_of({small, small}), *backend, options);
  NonlinearScene nonlinear;
  nonlinear.linear = small;
  const NonlinearResult of_nonlinear = solve_nonlinear(nonlinear, *backend, {.steps = 200});
  const double apart =
      (batch.of(batch.y, 1) - of_small.y).cwiseAbs().maxCoeff() + (of_nonlinear.y - of_small.y).cwiseAbs().maxCoeff();
  std::printf("gradient off by %.1e, a batch and a nonlinear solve by %.1e\n", gradient, apart);
  return batch.solved() == 2 && of_nonlinear.status == Status::solved && gradient < 1e-8 && apart < 1e-10 ? 0 : 1;
}
