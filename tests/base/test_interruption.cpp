// A request to stop takes effect while sources are sampled, before the first step.

#include "catalogue/catalogue.hpp"
#include "core/base/interruption.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace bromwich {
namespace {

Scene counting(long& calls) {
  Scene scene;
  scene.dynamics = DenseDynamics{-Matrix::Identity(1, 1), Matrix::Zero(1, 1), Matrix::Identity(1, 1)};
  scene.M = LcpMatrix(Matrix(Matrix::Identity(1, 1)));
  scene.x0 = Vector::Ones(1);
  scene.f = [&calls](double, Eigen::Ref<Vector> value) {
    ++calls;
    value.setZero();
  };
  return scene;
}

TEST(Interruption, EndsTheSetUp) {
  const auto backend = make_cpu_backend(1);
  for (const Method method : {Method::automatic, Method::march, Method::contour}) {
    long calls = 0;
    Options options;
    options.method = method;
    options.steps = 1'000'000;
    options.interrupted = [&calls] { return calls > 10'000; };
    const Result result = solve(counting(calls), *backend, options);
    EXPECT_EQ(result.status, Status::interrupted) << to_string(method);
    EXPECT_FALSE(result.reason.empty());
    EXPECT_LT(calls, 200'000) << to_string(method);
    EXPECT_EQ(result.t.size(), options.steps + 1);
    EXPECT_EQ(result.y.rows(), options.steps + 1);
    EXPECT_FALSE(result.y.array().isFinite().any());
  }
}

// f is in many pieces, whose responses are computed without further values of it: a request to stop that comes then.
TEST(Interruption, EndsTheResponsesOfPieces) {
  const auto backend = make_cpu_backend(1);
  long calls = 0, before = -1;
  bool stands = false;
  Scene scene = counting(calls);
  scene.f = [&calls](double t, Eigen::Ref<Vector> value) {
    ++calls;
    value.setConstant(std::sin(1e4 * t));
  };
  Options options;
  options.method = Method::march;
  options.steps = 16;  // no method asks before 64 steps
  options.interrupted = [&] {
    stands |= calls == before;
    before = calls;
    return stands;
  };
  const Result result = solve(scene, *backend, options);
  EXPECT_EQ(result.status, Status::interrupted);
}

// 1e8 radians a step: method galerkin halves its intervals to the last.
// Groups of eight nodes: the user is asked before each of them.
TEST(Interruption, EndsTheShiftedSolvesOfSparseDynamics) {
  const Dynamics dynamics = to_sparse(*make_scene("signorini", {{"Q", 7}}).dynamics->modes());
  const ComplexVector nodes = ComplexVector::LinSpaced(64, 1, 64);
  const auto backend = make_cpu_backend(1);
  int asked = 0;
  const std::function<bool()> later = [&asked] { return ++asked == 2; };
  {
    const InterruptedBy user(later);
    EXPECT_THROW(dynamics->shifted_solves(nodes, *backend), Interrupted);
  }
  EXPECT_EQ(asked, 2);
  EXPECT_EQ(dynamics->shifted_solves(nodes, *backend).rows(), 64);
}

TEST(Interruption, EndsTheSplittingOfIntervals) {
  const auto backend = make_cpu_backend(1);
  long calls = 0;
  Scene scene = counting(calls);
  scene.f = [&calls](double t, Eigen::Ref<Vector> value) {
    ++calls;
    value.setConstant(std::sin(1e10 * t));
  };
  Options options;
  options.method = Method::galerkin;
  options.steps = 100;
  options.interrupted = [&calls] { return calls > 20'000; };
  EXPECT_EQ(solve(scene, *backend, options).status, Status::interrupted);
  EXPECT_LT(calls, 40'000);
}

}  // namespace
}  // namespace bromwich
