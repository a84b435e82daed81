// What is refused before it runs.

#include "core/cost.hpp"

#include "core/error.hpp"
#include "core/scenes/catalogue.hpp"
#include "run.hpp"

#include <gtest/gtest.h>

namespace bromwich {
namespace {

std::string refusal(const Scene& scene, Method method, Index steps, double limit) {
  Options options = options_for(method, steps);
  options.memory_limit = limit;
  try {
    run(scene, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(Cost, AScenePredictsWhatItHolds) {
  for (const double Q : {39., 127.})
    for (const Method method : {Method::march, Method::contour, Method::euler}) {
      const Scene scene = make_scene("signorini", {{"Q", Q}});
      const double predicted = predicted_cost(scene, method, 400, 0).bytes,
                   held = double(run(scene, method, 400).bytes);
      EXPECT_GE(predicted, 0.5 * held) << Q << " " << to_string(method);
      EXPECT_LE(predicted, 6 * held) << Q << " " << to_string(method);
    }
}

TEST(Cost, WhatDoesNotFitIsRefusedWithNumbers) {
  const std::string text = refusal(make_scene("signorini"), Method::march, 1 << 20, 1e9);
  EXPECT_NE(text.find("GB"), std::string::npos) << text;
  EXPECT_NE(text.find("1048576 steps"), std::string::npos) << text;
  EXPECT_EQ(refusal(make_scene("bridge"), Method::march, 1000, 1e9), "");
}

// A Kronecker sum with 10^4 constraints: marching wants n x n matrices, the iteration does not.
TEST(Cost, AutoIsRefusedOnlyWhereNothingFits) {
  const Index n = 10000;
  Scene scene = make_scene("signorini");
  scene.dynamics = KroneckerDynamics{{n, 1e-4, 1}, {n, 1e-4, 1}, Vector::Unit(n, 0), Vector::Unit(n, 0)};
  scene.M = Tridiagonal{-Vector::Ones(n), Vector::Constant(n, 4), -Vector::Ones(n)};
  scene.f = scene.g = {};
  scene.x0 = Vector::Zero(n * n);
  const double march = predicted_cost(scene, Method::march, 4, 0).bytes;
  const double contour = predicted_cost(scene, Method::contour, 4, 0).bytes;
  EXPECT_GT(march, 2 * contour);
  Options options = options_for(Method::automatic, 4);
  options.memory_limit = contour / 2;
  EXPECT_THROW(refuse_what_does_not_fit(scene, options, 4, 0), Error);
  options.memory_limit = 0.5 * (contour + march);
  EXPECT_NO_THROW(refuse_what_does_not_fit(scene, options, 4, 0));
  options.method = Method::march;
  EXPECT_THROW(refuse_what_does_not_fit(scene, options, 4, 0), Error);
}

TEST(Cost, WeeksOfWorkAreRefused) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(3000, 3000), Matrix::Zero(3000, 1), Matrix::Zero(1, 3000)};
  scene.M = Matrix{{1}};
  scene.x0 = Vector::Zero(3000);
  const Cost cost = predicted_cost(scene, Method::contour_literal, 1 << 20, 0);
  EXPECT_GT(cost.operations, 1e16);
  EXPECT_NE(refusal(scene, Method::contour_literal, 1 << 20, 0).find("multiplications"), std::string::npos);
}

}  // namespace
}  // namespace bromwich
