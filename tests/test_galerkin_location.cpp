// Event location: nodes at the switches of the active sets.

#include "core/dense_output.hpp"
#include "core/galerkin_location.hpp"
#include "core/galerkin_recovery.hpp"
#include "core/scenes/catalogue.hpp"
#include "core/switching.hpp"
#include "refusal.hpp"
#include "run.hpp"
#include "tests/reference.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

namespace bromwich {
namespace {

using reference::pi;

/// Against Scene::exact: y in L2 over [0, T], by Gauss points on 32 pieces of each interval (kinks lie anywhere), and x
/// at T.
struct LocationErrors {
  double y = 0, x_end = 0;
};

LocationErrors location_errors(const Scene& scene, const Result& r) {
  constexpr int pieces = 32;
  const double offset = 0.5 / std::sqrt(3.);
  LocationErrors e;
  Vector x(scene.states()), y(scene.constraints());
  for (Index k = 0; k < r.steps; ++k) {
    const double h = r.t[k + 1] - r.t[k];
    for (int piece = 0; piece < pieces; ++piece)
      for (const double s : {(piece + 0.5 - offset) / pieces, (piece + 0.5 + offset) / pieces}) {
        scene.exact(r.t[k] + s * h, x, y);
        e.y += h / (2 * pieces) * ((1 - s) * r.y_left.row(k) + s * r.y.row(k + 1) - y.transpose()).squaredNorm();
      }
  }
  scene.exact(scene.T * (1 - epsilon), x, y);
  e.x_end = (r.x.row(r.steps) - x.transpose()).norm();
  e.y = std::sqrt(e.y);
  return e;
}

Result run_located(const Scene& scene, Index steps, bool located) {
  Options options = options_for(Method::galerkin, steps);
  options.states = StateSelection::all;
  options.event_location = located;
  const Result r = run(scene, options);
  EXPECT_EQ(r.status, Status::solved) << scene.name << ": " << r.reason;
  return r;
}

double location_order(double coarse, double fine, Index N, Index M) {
  return std::log(coarse / fine) / std::log(double(M) / double(N));
}

// The kinks at pi/2, 3 pi/2 and 2 pi lie at different places of their intervals: 6 does not divide N.
TEST(GalerkinLocation, BridgeHasOrderTwo) {
  const Scene scene = make_scene("bridge", {});
  std::vector<LocationErrors> errors;
  const std::array<Index, 4> grids{50, 110, 230, 470};
  for (const Index N : grids) {
    const Result r = run_located(scene, N, true);
    EXPECT_NEAR(double(r.steps), double(N), 3);
    EXPECT_EQ(r.warning, "");
    for (const double kink : {pi / 2, 1.5 * pi, 2 * pi})
      EXPECT_LE((r.t.array() - kink).abs().minCoeff(), 2 * std::pow(scene.T / double(N), 2)) << N;
    errors.push_back(location_errors(scene, r));
    std::printf("located N %ld y %.3e x %.3e\n", long(N), errors.back().y, errors.back().x_end);
    const LocationErrors plain = location_errors(scene, run_located(scene, N, false));
    std::printf("plain   N %ld y %.3e x %.3e\n", long(N), plain.y, plain.x_end);
  }
  for (std::size_t i = 1; i < errors.size(); ++i) {
    EXPECT_GE(location_order(errors[i - 1].y, errors[i].y, grids[i - 1], grids[i]), 1.9);
    EXPECT_GE(location_order(errors[i - 1].x_end, errors[i].x_end, grids[i - 1], grids[i]), 1.9);
  }
}

}  // namespace
}  // namespace bromwich
