// (2.17) taken literally, as a method.

#include "catalogue/catalogue.hpp"
#include "core/iteration/literal.hpp"
#include "tests/support/oracle.hpp"
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

// Remarks 2.1 and 2.4: imaginary, zero, unstable and weakly damped eigenvalues, where the printed contour does not
// enclose the spectrum. The same steps by matrix exponentials as the oracle.
TEST(Literal, EnclosesSpectraOutsideThePrintedSector) {
  for (const Matrix& A :
       {Matrix{{0, 1}, {-4, 0}}, Matrix{{0, 1}, {0, 0}}, Matrix{{0, 1}, {1, 0}}, Matrix{{0, 1}, {-4, -0.5}}}) {
    Scene scene;
    scene.dynamics = DenseDynamics{A, Matrix{{0}, {1}}, Matrix{{1, 0}}};
    scene.M = Matrix{{2}};
    scene.x0 = Vector{{1, 0}};
    scene.T = 3;
    scene.f = [](double t, Eigen::Ref<Vector> f) { f << 0, -2 * std::cos(3 * t); };
    const Index J = 60;
    const Result r = literal(scene, J, 64);
    ASSERT_EQ(r.status, Status::solved) << A << ": " << r.reason;
    EXPECT_NE(r.kernel.find("circles"), std::string::npos) << r.kernel;
    const oracle::Trajectory expected = oracle::march(oracle::write_out(scene), J);
    // Twenty times the rate, as for the contours themselves, times ||N|| ||B|| T (max |y| + max |f|) e^T for the
    // growth.
    EXPECT_LE(distance(r.y, expected.y), 20 * rate(64) * 3 * 4 * std::exp(3.0)) << A;
  }
}

// e^{At} x0 by the contour of Remark 2.3, to e^{-2.32 P} and rounding of eps e^{0.353 P}, P = 14: 6e-14 of |x0|.
TEST(Literal, TakesTheSecondContourForTheInitialState) {
  Scene scene;
  const Matrix A{{-3, 1}, {1, -40}};
  scene.dynamics = DenseDynamics{A, Matrix{{1}, {0}}, Matrix{{-1, 2}}};
  scene.M = Matrix{{1}};
  scene.x0 = Vector{{5, -7}};
  scene.g = [](double, Eigen::Ref<Vector> g) { g << 100; };  // y = 0
  scene.T = 2;
  Options options = options_for(Method::contour_literal, 40);
  options.trace = true;
  const Result r = run(scene, options);
  ASSERT_EQ(r.status, Status::solved) << r.reason;
  EXPECT_EQ(r.y.cwiseAbs().maxCoeff(), 0);
  for (Index j = 0; j <= 40; ++j) {
    const double exact = (Matrix{{-1, 2}} * oracle::exponential(r.t[j] * A) * scene.x0)(0);
    EXPECT_NEAR(r.trace(j, 0), exact, 1e-13 * 20 * scene.x0.norm()) << r.t[j];
  }
}

// The resolvents alone: P + 1 complex numbers for each time point and constraint.
TEST(Literal, PredictsTheMemoryOfItsNodes) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  for (const Index P : {25, 200}) {
    const Result r = literal(scene, 16, P);
    ASSERT_EQ(r.status, Status::solved) << r.reason;
    EXPECT_GE(r.bytes_predicted, std::size_t(16 * 16 * (P + 1) * 7)) << P;
  }
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
