// Problems that are refused before they run.

#include "core/solve/cost.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"

#include <cmath>
#include <string>
#include <utility>

namespace bromwich {
namespace {

std::string refused_cost(const Scene& scene, Method method, Index steps, double limit) {
  Options options = options_for(method, steps);
  options.memory_limit = limit;
  try {
    run(scene, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

class CostTest : public BackendTest {
 protected:
  // A prediction includes memory that is freed before the last sweep or step: temporary copies, weights used for
  // checks, matrices for e^{hA}. It may be larger by that much, but not much smaller.
  void expect_predicted(const Scene& scene, Method method, Index J) {
    Options options = options_for(method, J);
    options.max_iterations = 5;  // the arrays are the same
    const Result result = solve(scene, *backend, options);
    const std::string name = scene.name + ", " + std::to_string(scene.constraints()) + " constraints, " +
                             std::to_string(J) + " steps, " + to_string(method);
    const double held = double(result.bytes), predicted = predicted_cost(scene, method, J, 0).bytes;
    // Where the units of a boundary problem are changed, all its states are recorded.
    const Index recorded = scene.boundary ? scene.states() : 0;
    EXPECT_GE(double(result.bytes_predicted), std::floor(predicted)) << name;
    EXPECT_LE(double(result.bytes_predicted), std::floor(predicted_cost(scene, method, J, recorded).bytes)) << name;
    EXPECT_GE(predicted, 0.5 * held) << name;
    EXPECT_LE(predicted, 3 * held) << name;
  }
};

INSTANTIATE_TEST_SUITE_P(Contract, CostTest, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(CostTest, GalerkinPredictsWhatItHolds) {
  for (const char* name : {"bridge", "lq-control", "nash-game", "periodic-rectifier"})
    expect_predicted(make_scene(name), Method::galerkin, 500);
  EXPECT_NE(refused_cost(make_scene("lq-control"), Method::galerkin, 1 << 20, 1e6)
                .find("steps: method galerkin with 1048576 steps needs about"),
            std::string::npos);
}

TEST_P(CostTest, AScenePredictsWhatItHolds) {
  for (const double Q : {39., 127.})
    for (const Index J : {400, 4000})
      for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler}) {
        if (Q == 127 && J == 4000) continue;  // takes long without testing more
        expect_predicted(make_scene("signorini", {{"Q", Q}}), method, J);
      }
  // 100 states and 10 constraints, where one application of the kernel is an FFT over n x n weights.
  for (const auto& [m, n] : {std::pair<Index, Index>{7, 1}, {10, 33}, {100, 10}})
    for (const Method method : {Method::march, Method::contour, Method::multigrid, Method::euler})
      expect_predicted(oracle::random_scene(3, m, n, oracle::SpectrumKind::real_negative, oracle::MatrixKind::dominant),
                       method, 2000);
}

// Factors of I - hA on grids, and what the weights of contours take.
TEST_P(CostTest, ASparseScenePredictsWhatItHolds) {
  for (const double Q : {31., 63.}) {
    Scene scene = make_scene("signorini", {{"Q", Q}});
    scene.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
    expect_predicted(scene, Method::euler, 100);
  }
}

TEST(Cost, WhatDoesNotFitIsRefusedWithNumbers) {
  const std::string text = refused_cost(make_scene("signorini"), Method::march, 1 << 20, 1e9);
  EXPECT_NE(text.find("GB"), std::string::npos) << text;
  EXPECT_NE(text.find("1048576 steps"), std::string::npos) << text;
  EXPECT_EQ(refused_cost(make_scene("bridge"), Method::march, 1000, 1e9), "");
}

// A Kronecker sum with 10^4 constraints: marching needs n x n matrices, the iteration does not.
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

TEST(Cost, ADeviceRefusesWhatDoesNotFitThere) {
  const Scene scene = make_scene("signorini");
  const Options options = options_for(Method::contour);
  const DeviceInfo machine{"cpu", 1, ""}, card{"small card", 1, "", 1e8};
  EXPECT_NO_THROW(refuse_what_does_not_fit(scene, options, 400, 0, card));
  EXPECT_NO_THROW(refuse_what_does_not_fit(scene, options, 1 << 20, 0, machine));
  EXPECT_TRUE(fits_on_device(scene, Method::contour, 1 << 20, 0, machine));
  EXPECT_FALSE(fits_on_device(scene, Method::contour, 1 << 20, 0, card));
  try {
    refuse_what_does_not_fit(scene, options, 1 << 20, 0, card);
    ADD_FAILURE() << "not refused";
  } catch (const Error& error) {
    const std::string text = error.what();
    // Seven arrays of 2^20 x 40 numbers are 2.3 GB.
    for (const char* part :
         {"method contour with 1048576 steps needs about 2.", "GB on the device, most of it for tables",
          "small card has 0.1 GB free; use fewer steps, or the cpu backend"})
      EXPECT_NE(text.find(part), std::string::npos) << text;
  }
}

TEST(Cost, WeeksOfWorkAreRefused) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix::Zero(3000, 3000), Matrix::Zero(3000, 1), Matrix::Zero(1, 3000)};
  scene.M = Matrix{{1}};
  scene.x0 = Vector::Zero(3000);
  const Cost cost = predicted_cost(scene, Method::contour_literal, 1 << 20, 0);
  EXPECT_GT(cost.operations, 1e16);
  EXPECT_NE(refused_cost(scene, Method::contour_literal, 1 << 20, 0).find("multiplications"), std::string::npos);
}

}  // namespace
}  // namespace bromwich
