// The exponential Galerkin method: discretisation against a dense assembly, orders, boundary conditions, refusals.

#include "core/galerkin.hpp"

#include "core/galerkin_discretisation.hpp"
#include "core/galerkin_uniqueness.hpp"
#include "core/scenes/catalogue.hpp"
#include "refusal.hpp"
#include "run.hpp"
#include "tests/reference.hpp"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

/// Errors against Scene::exact: L2 over time by five Gauss points an interval (kinks off nodes cost digits of the norm,
/// not its order), and at T.
struct Errors {
  double y = 0, x = 0, y_end = 0, x_end = 0;
};

Errors errors_of(const Scene& scene, const Result& r) {
  const double a = std::sqrt(5 - 2 * std::sqrt(10. / 7)) / 3, b = std::sqrt(5 + 2 * std::sqrt(10. / 7)) / 3;
  const double wa = (322 + 13 * std::sqrt(70.)) / 1800, wb = (322 - 13 * std::sqrt(70.)) / 1800;
  const std::array<std::pair<double, double>, 5> rule{
      {{0.5, 64. / 225}, {(1 - a) / 2, wa}, {(1 + a) / 2, wa}, {(1 - b) / 2, wb}, {(1 + b) / 2, wb}}};
  Errors e;
  Vector x(scene.states()), y(scene.constraints());
  const double h = scene.T / double(r.steps);
  for (Index k = 0; k < r.steps; ++k) {
    for (const auto& [s, weight] : rule) {
      scene.exact((double(k) + s) * h, x, y);
      e.y += h * weight * ((1 - s) * r.y_left.row(k) + s * r.y.row(k + 1) - y.transpose()).squaredNorm();
    }
    scene.exact(double(k + 1) * h, x, y);
    e.x += h * (r.x.row(k + 1) - x.transpose()).squaredNorm();
  }
  scene.exact(scene.T * (1 - epsilon), x, y);  // the left limit
  e.y_end = (r.y.row(r.steps) - y.transpose()).norm();
  e.x_end = (r.x.row(r.steps) - x.transpose()).norm();
  e.y = std::sqrt(e.y);
  e.x = std::sqrt(e.x);
  return e;
}

Result run_galerkin(const Scene& scene, Index steps) {
  Options options = options_for(Method::galerkin, steps);
  options.states = StateSelection::all;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << scene.name << ": " << r.reason;
  return r;
}

TEST(Galerkin, BridgeHasItsKnownErrors) {
  const Scene scene = make_scene("bridge", {});
  for (const Index N : {24, 48, 96, 192, 384, 25, 50, 100, 200, 400, 800}) {
    const Errors e = errors_of(scene, run_galerkin(scene, N));
    printf("%4ld  y %.3e  x %.3e  y(T) %.3e  x(T) %.3e\n", long(N), e.y, e.x, e.y_end, e.x_end);
  }
}

TEST(Galerkin, Uniqueness) {
  const Scene scene = make_scene("bridge", {});
  for (const Index N : {8, 32, 64, 128})
    printf("%ld %.4f %.4f\n", long(N), smallest_symmetric_eigenvalue(scene, N, 0), smallest_symmetric_eigenvalue(scene, N, 1));
  for (const std::string name : {"nash-game", "lq-control", "periodic-rectifier"}) {
    const Scene scene = make_scene(name, {});
    const Result r = run_galerkin(scene, 64);
    printf("%s %g %g: %s\n", name.c_str(), smallest_symmetric_eigenvalue(scene, 32, 0), smallest_symmetric_eigenvalue(scene, 32, 2), r.warning.c_str());
  }
}

TEST(Galerkin, Boundary) {
  for (const std::string name : {"nash-game", "lq-control", "periodic-rectifier"})
    for (const Index N : {8, 16, 32, 64, 128, 256, 512}) {
      const Scene scene = make_scene(name, {});
      Options options = options_for(Method::galerkin, N);
      options.states = StateSelection::all;
      const Result r = run(scene, options);
      printf("%s %ld: %s %s; it %ld res %.1e bres %.1e\n", name.c_str(), long(N), to_string(r.status), r.reason.c_str(), long(r.iterations), r.residual, r.boundary_residual.value_or(-1));
      if (r.status == Status::solved && scene.exact) {
        const Errors e = errors_of(scene, r);
        printf("%4ld  y %.3e  x %.3e  y(T) %.3e  x(T) %.3e\n", long(N), e.y, e.x, e.y_end, e.x_end);
      }
    }
}

}  // namespace
}  // namespace bromwich
