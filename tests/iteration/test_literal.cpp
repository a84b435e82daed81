// (2.17) taken literally, as a method.

#include "core/catalogue/catalogue.hpp"
#include "core/iteration/literal.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bromwich {
namespace {

double rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

Result literal(const Scene& scene, Index steps, Index P) {
  Options options = options_for(Method::contour_literal, steps);
  options.tuning.literal_nodes = P;
  return run(scene, options);
}

TEST(Literal, ApproachesTheSharedContoursAtThePrintedRate) {
  struct Case {
    const char* name;
    double size;  // ||N|| ||B|| T (max |y| + max |f|) L, the factor in front of the rate in (2.8) and (2.12)
  };
  // signorini, Q = 7: |n b| T = 2 * 0.128 * 4, |y + psi| <= 5, L <= 1/2. dlcp-small: |N| |B| < 40, |f| < 40, L about 3.
  for (const auto& [name, size] : {Case{"signorini", 3}, Case{"dlcp-small", 5000}}) {
    const Scene scene =
        make_scene(name, std::string(name) == "signorini" ? ParameterValues{{"Q", 7}} : ParameterValues{});
    const Result shared = run(scene, options_for(Method::contour, 64));
    ASSERT_EQ(shared.status, Status::solved) << name << ": " << shared.reason;
    for (const Index P : {16, 36, 64}) {
      const Result r = literal(scene, 64, P);
      ASSERT_EQ(r.status, Status::solved) << name << ", P = " << P << ": " << r.reason;
      EXPECT_LE(distance(r.y, shared.y), 4 * size * rate(P)) << name << ", P = " << P;
      // The literal kernel was used: the error is there, although the residual is small.
      EXPECT_GT(distance(r.y, shared.y), 1e-3 * rate(P)) << name << ", P = " << P;
    }
  }
}

// f = F phi with one source for two states, given as a state vector and as the source itself.
TEST(Literal, TakesSourcesThroughTheirMatrix) {
  Scene scene;
  scene.dynamics = DenseDynamics{Matrix{{-1, 0.3}, {0.3, -2}}, Matrix{{1}, {0}}, Matrix{{-1, 0.5}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{1, 0}};
  scene.T = 4;
  scene.f = [](double t, Eigen::Ref<Vector> f) { f << std::sin(3 * t), 2 * std::sin(3 * t); };
  const Result by_state = literal(scene, 64, 64);
  scene.F = Matrix{{1}, {2}}.sparseView();
  scene.f_entry = SourceEntry::through_F;
  scene.f = [](double t, Eigen::Ref<Vector> phi) { phi[0] = std::sin(3 * t); };
  const Result by_source = literal(scene, 64, 64);
  ASSERT_EQ(by_state.status, Status::solved) << by_state.reason;
  ASSERT_EQ(by_source.status, Status::solved) << by_source.reason;
  // The same sums in another order.
  EXPECT_LE(distance(by_source.y, by_state.y), 1e-12);
  EXPECT_LE(distance(by_source.y, run(scene, options_for(Method::march, 64)).y), 100 * rate(64));
}

TEST(Literal, RefusesSpectraOutsideItsSector) {
  const Result r = literal(make_scene("bridge"), 60, 25);
  EXPECT_EQ(r.status, Status::unsupported);
  EXPECT_NE(r.reason.find("44.5 degrees"), std::string::npos) << r.reason;
  EXPECT_EQ(r.y.rows(), 61);
}

TEST(Literal, RefusesSystemsFarFromNormal) {
  // All eigenvalues are -1, but the resolvent is not bounded accordingly: (2.1b) does not hold.
  Scene scene = make_scene("dlcp-small");
  Matrix A = -Matrix::Identity(8, 8);
  A.diagonal(1).setConstant(-4);
  scene.dynamics = DenseDynamics{A, Matrix::Ones(8, 1), Matrix::Ones(1, 8)};
  scene.M = Matrix{{1}};
  scene.lcp_class = LcpClass::P;
  scene.f = scene.g = nullptr;
  scene.x0 = Vector::Ones(8);
  scene.exact = nullptr;
  scene.T = 4;
  const Result r = literal(scene, 100, 25);
  EXPECT_EQ(r.status, Status::unsupported);
  EXPECT_NE(r.reason.find("normal"), std::string::npos) << r.reason;
}

}  // namespace
}  // namespace bromwich
