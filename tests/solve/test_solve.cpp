// The solver against the dense oracle, against converged reference values and against exact solutions.

#include "catalogue/catalogue.hpp"
#include "core/base/timer.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <string>
#include <vector>

namespace bromwich {
namespace {

/// Slope of log(error) against log(h) by least squares, h = 1/J.
double observed_order(const std::vector<Index>& steps, const std::vector<double>& errors) {
  const Index k = Index(steps.size());
  Matrix line(k, 2);
  Vector logarithm(k);
  for (Index i = 0; i < k; ++i) {
    line.row(i) << 1, -std::log(double(steps[std::size_t(i)]));
    logarithm[i] = std::log(errors[std::size_t(i)]);
  }
  return Vector(line.colPivHouseholderQr().solve(logarithm))[1];
}

/// Errors of y against the exact solution, maximum over all times.
std::vector<double> errors_of_y(const Scene& scene, Method method, const std::vector<Index>& steps) {
  std::vector<double> errors;
  for (const Index J : steps) {
    RowMatrix y(J + 1, scene.constraints());
    Vector x(scene.states()), row(scene.constraints());
    for (Index j = 0; j <= J; ++j) {
      scene.exact(scene.T * double(j) / double(J), x, row);
      y.row(j) = row;
    }
    errors.push_back(distance(solved_y(scene, method, J), y));
  }
  return errors;
}

// ---- the oracle ----

class RandomScenes : public testing::TestWithParam<int> {
 protected:
  RandomScenes()
      : scene(oracle::random_scene(std::uint32_t(GetParam()), 1 + GetParam() / 2 % 6, 1 + GetParam() / 5 % 4,
                                   oracle::SpectrumKind(GetParam() % 3), oracle::MatrixKind(GetParam() / 3 % 3))),
        dense(oracle::write_out(scene)) {}

  static constexpr Index J = 64;
  const Scene scene;
  const oracle::DenseScene dense;
};

TEST_P(RandomScenes, IterationConvergesByItsCriterion) {
  const Matrix W0 = oracle::weights(dense, 1.0 / double(J), 0).W[0];
  EXPECT_LT(oracle::lipschitz(dense.M) * W0.cwiseAbs().rowwise().sum().maxCoeff(), 0.5);
}

TEST_P(RandomScenes, MarchEqualsOracle) {
  EXPECT_LE(distance(solved_y(scene, Method::march, J), oracle::march(dense, J).y), same_problem);
}

TEST_P(RandomScenes, ContourEqualsOracle) {
  EXPECT_LE(distance(solved_y(scene, Method::contour, J), oracle::march(dense, J).y), same_problem);
}

TEST_P(RandomScenes, EulerEqualsOracle) {
  EXPECT_LE(distance(solved_y(scene, Method::euler, J), oracle::euler(dense, J).y), same_problem);
}

TEST_P(RandomScenes, ResidualIsTheOneItClaims) {
  for (const Method method : {Method::march, Method::contour}) {
    const Result result = run(scene, method, J);
    ASSERT_EQ(result.status, Status::solved) << result.reason;
    const double residual = oracle::complementarity_residual(dense, result.y, oracle::states_of(dense, result.y));
    EXPECT_LE(residual, same_problem) << to_string(method);
    EXPECT_LE(result.residual, same_problem) << to_string(method);
  }
}

INSTANTIATE_TEST_SUITE_P(Small, RandomScenes, testing::Range(0, 40));

TEST(Solve, SignoriniEqualsOracle) {
  const Scene scene = make_scene("signorini", {{"Q", 7}});
  const oracle::DenseScene dense = oracle::write_out(scene);
  const RowMatrix marched = oracle::march(dense, 40).y, euler = oracle::euler(dense, 40).y;
  EXPECT_LE(distance(solved_y(scene, Method::march, 40), marched), same_problem);
  EXPECT_LE(distance(solved_y(scene, Method::contour, 40), marched), same_problem);
  EXPECT_LE(distance(solved_y(scene, Method::euler, 40), euler), same_problem);
}

TEST(Solve, ZScenesEqualOracle) {  // M is no P-matrix: the least element has to be chosen
  const Scene scene = make_scene("dlcp-small");
  const oracle::DenseScene dense = oracle::write_out(scene);
  EXPECT_LE(distance(solved_y(scene, Method::march, 100), oracle::march(dense, 100).y), same_problem);
  EXPECT_LE(distance(solved_y(scene, Method::euler, 100), oracle::euler(dense, 100).y), same_problem);
}

// ---- converged reference values ----

struct Probe {
  Index Q, J;
  Method method;
  double Y;  ///< y at t = T in the middle of the side, to ten digits, from programs that share no code with this one
};

class SignoriniProbe : public testing::TestWithParam<Probe> {};

TEST_P(SignoriniProbe, AgreesToTheDigitsGiven) {
  const auto [Q, J, method, Y] = GetParam();
  const RowMatrix y = solved_y(make_scene("signorini", {{"Q", double(Q)}}), method, J);
  // Half a unit of the last digit is 5e-11; the kernel's error of 1e-13 and rounding are far below.
  EXPECT_NEAR(y(J, Q / 2), Y, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(
    Signorini, SignoriniProbe,
    testing::Values(Probe{39, 400, Method::march, 0.4643500027}, Probe{39, 400, Method::contour, 0.4643500027},
                    Probe{39, 400, Method::euler, 0.4630299969}, Probe{39, 4096, Method::march, 0.4643275556},
                    Probe{39, 4096, Method::contour, 0.4643275556}, Probe{39, 4096, Method::euler, 0.4641993730},
                    Probe{127, 400, Method::march, 0.5389600038}, Probe{127, 400, Method::contour, 0.5389600038},
                    Probe{127, 400, Method::euler, 0.5380450172}, Probe{511, 4096, Method::march, 0.5652547659},
                    Probe{511, 4096, Method::euler, 0.5652243010}),
    [](const auto& probe) {
      return "Q" + std::to_string(probe.param.Q) + "_J" + std::to_string(probe.param.J) + "_" +
             to_string(probe.param.method);
    });

TEST(Solve, ContourEqualsMarch) {
  const Scene scene = make_scene("signorini");
  EXPECT_LE(distance(solved_y(scene, Method::contour, 400), solved_y(scene, Method::march, 400)), same_problem);
}

// ---- order ----

TEST(Order, SignoriniWithoutTheInitialLayer) {
  const Scene scene = make_scene("signorini");
  const Index reference_steps = 16384;
  const RowMatrix reference = solved_y(scene, Method::march, reference_steps);
  const std::vector<Index> steps{128, 256, 512, 1024};
  const auto errors = [&](Method method) {
    std::vector<double> out;
    for (const Index J : steps) {
      const auto late = Eigen::seq(J / 16, J);  // t >= T/16
      const RowMatrix same_times = reference(Eigen::seq(0, reference_steps, reference_steps / J), Eigen::all);
      out.push_back(distance(solved_y(scene, method, J)(late, Eigen::all), same_times(late, Eigen::all)));
    }
    return out;
  };
  // Second order up to the effect of switches between grid points (observed slopes are 2.0 to 2.1); first order.
  EXPECT_GE(observed_order(steps, errors(Method::march)), 1.9);
  const double euler = observed_order(steps, errors(Method::euler));
  EXPECT_GE(euler, 0.9);
  EXPECT_LE(euler, 1.1);
}

TEST(Order, DlcpSmallAgainstItsExactSolution) {
  const Scene scene = make_scene("dlcp-small");
  const std::vector<Index> steps{128, 256, 512, 1024};
  const std::vector<double> march = errors_of_y(scene, Method::march, steps);
  EXPECT_GE(observed_order(steps, march), 1.9);
  // B y + f = x' - A x is interpolated to h^2/12 max|(x' - A x)''| = 1e-6; ||M_SS^{-1} N|| <= 16.5 takes that to y.
  EXPECT_LE(march.back(), 1.7e-5);
  const std::vector<double> euler = errors_of_y(scene, Method::euler, steps);
  EXPECT_GE(observed_order(steps, euler), 0.85);  // h ||B y'|| is not yet small: 0.93 to 0.98 between these steps
  EXPECT_LE(observed_order(steps, euler), 1.1);
}

TEST(Order, BridgeAgainstItsExactSolution) {
  const Scene scene = make_scene("bridge");
  const std::vector<Index> steps{128, 256, 512, 1024};
  const std::vector<double> march = errors_of_y(scene, Method::march, steps);
  EXPECT_GE(observed_order(steps, march), 1.9);
  EXPECT_LE(march.back(), 1e-3);  // h^2/12 max|f''| T: interpolation error of f, integrated without cancellation
}

TEST(Seconds, ContainTheTimeInSources) {
  const Scene plain = make_scene("dlcp-small");
  double inside = 0;
  const auto timed = [&inside](const TimeFunction& source) {
    return [&inside, source](double t, Eigen::Ref<Vector> value) {
      Timer timer;
      source(t, value);
      inside += timer.lap();
    };
  };
  Scene scene = plain;
  scene.f = timed(plain.f);
  scene.g = timed(plain.g);
  const auto backend = make_cpu_backend(1);
  for (const double tolerance : {0.0, 1e-4})
    for (const Method method : {Method::automatic, Method::march, Method::euler}) {
      Options options;
      options.method = method;
      options.tolerance = tolerance;
      inside = 0;
      const Result r = solve(scene, *backend, options);
      EXPECT_GE(r.seconds.total, inside) << to_string(method) << " " << tolerance;
      EXPECT_GE(r.seconds.total * (1 + 1e-12), r.seconds.setup + r.seconds.solve) << to_string(method);
    }
}

}  // namespace
}  // namespace bromwich
