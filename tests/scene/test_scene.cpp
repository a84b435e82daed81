#include "core/scene/scene.hpp"

#include "core/base/error.hpp"
#include "tests/support/oracle.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

namespace bromwich {
namespace {

Scene dense_scene() {
  Scene s;
  s.dynamics = DenseDynamics{Matrix::Identity(3, 3), Matrix::Ones(3, 2), Matrix::Ones(2, 3)};
  s.M = Matrix(Matrix::Identity(2, 2));
  s.f = [](double t, Eigen::Ref<Vector> f) { f.setConstant(t); };
  s.g = [](double t, Eigen::Ref<Vector> g) { g.setConstant(t); };
  s.x0 = Vector::Zero(3);
  return s;
}

Scene kronecker_scene() {
  Scene s;
  s.dynamics = KroneckerDynamics{{3, 0.5, 2.0}, {2, 0.25, 1.0}, Vector{{1, 2}}, Vector{{3, -4}}};
  s.M = Tridiagonal{Vector{{NAN, -1, -1}}, Vector{{4, 5, 6}}, Vector{{-2, -2, NAN}}};  // ends are not used
  s.x0 = Vector::Zero(6);
  return s;
}

struct Rejection {
  std::string member;
  std::function<void(Scene&)> spoil;
};

void expect_rejected(const Scene& valid, const std::vector<Rejection>& rejections) {
  EXPECT_NO_THROW(valid.validate());
  for (const auto& [member, spoil] : rejections) {
    Scene scene = valid;
    spoil(scene);
    try {
      scene.validate();
      ADD_FAILURE() << member << " was accepted";
    } catch (const Error& error) {
      const std::string line = error.what();
      EXPECT_EQ(line.rfind(member + ":", 0), 0u) << line;     // names the member first,
      EXPECT_NE(line.find("; "), std::string::npos) << line;  // then what was found and what to do,
      EXPECT_EQ(line.find('\n'), std::string::npos) << line;  // on one line
    }
  }
}

DenseDynamics& dense(Scene& s) { return get<DenseDynamics>(s.dynamics); }
KroneckerDynamics& kronecker(Scene& s) { return get<KroneckerDynamics>(s.dynamics); }
Tridiagonal& tridiagonal(Scene& s) { return std::get<Tridiagonal>(s.M); }

/// Replaces M by zero diagonals of the lengths given.
std::function<void(Scene&)> diagonals(Index lower, Index diagonal, Index upper) {
  return [=](Scene& s) { s.M = Tridiagonal{Vector::Zero(lower), Vector::Zero(diagonal), Vector::Zero(upper)}; };
}

TEST(Scene, RejectsWrongSizes) {
  const std::vector<Rejection> rejections{
      {"A", [](Scene& s) { dense(s).A = Matrix(0, 0); }},
      {"A", [](Scene& s) { dense(s).A = Matrix::Zero(3, 2); }},
      {"B", [](Scene& s) { dense(s).B = Matrix::Zero(2, 2); }},
      {"N", [](Scene& s) { dense(s).B = Matrix(3, 0); }},  // no constraints, but rows of N
      {"N", [](Scene& s) { dense(s).N = Matrix::Zero(3, 2); }},
      {"N", [](Scene& s) { dense(s).N = Matrix::Zero(2, 2); }},
      {"M", [](Scene& s) { s.M = Matrix(Matrix::Zero(2, 3)); }},
      {"M", [](Scene& s) { s.M = Matrix(Matrix::Zero(3, 3)); }},
      {"M.lower", diagonals(1, 2, 2)},
      {"M.diagonal", diagonals(2, 3, 2)},
      {"M.upper", diagonals(2, 2, 3)},
      {"x0", [](Scene& s) { s.x0 = Vector::Zero(2); }},
      {"x0", [](Scene& s) { s.x0 = Vector(); }},
  };
  expect_rejected(dense_scene(), rejections);
}

TEST(Scene, RejectsValuesThatAreNotFinite) {
  const std::vector<Rejection> rejections{
      {"A", [](Scene& s) { dense(s).A(1, 2) = NAN; }},
      {"B", [](Scene& s) { dense(s).B(2, 0) = INFINITY; }},
      {"N", [](Scene& s) { dense(s).N(0, 1) = -INFINITY; }},
      {"M", [](Scene& s) { std::get<Matrix>(s.M)(1, 1) = NAN; }},
      {"x0", [](Scene& s) { s.x0[1] = NAN; }},
      {"f(0)", [](Scene& s) { s.f = [](double t, Eigen::Ref<Vector> f) { f.setConstant(1 / t); }; }},
      {"g(0)", [](Scene& s) { s.g = [](double, Eigen::Ref<Vector> g) { g[0] = 1; }; }},  // g[1] is never written
  };
  expect_rejected(dense_scene(), rejections);
}

TEST(Scene, RejectsTimesAndSteps) {
  const std::vector<Rejection> rejections{
      {"T", [](Scene& s) { s.T = 0; }},
      {"T", [](Scene& s) { s.T = -1; }},
      {"T", [](Scene& s) { s.T = NAN; }},
      {"T", [](Scene& s) { s.T = INFINITY; }},
      {"default_steps", [](Scene& s) { s.default_steps = -1; }},
  };
  expect_rejected(dense_scene(), rejections);
}

TEST(Scene, RejectsKroneckerSums) {
  const std::vector<Rejection> rejections{
      {"along.points", [](Scene& s) { kronecker(s).along.points = 0; }},
      {"across.points", [](Scene& s) { kronecker(s).across.points = -1; }},
      {"along.spacing", [](Scene& s) { kronecker(s).along.spacing = 0; }},
      {"across.spacing", [](Scene& s) { kronecker(s).across.spacing = NAN; }},
      {"along.diffusivity", [](Scene& s) { kronecker(s).along.diffusivity = -1; }},
      {"across.diffusivity", [](Scene& s) { kronecker(s).across.diffusivity = INFINITY; }},
      {"b", [](Scene& s) { kronecker(s).b = Vector::Zero(3); }},
      {"n", [](Scene& s) { kronecker(s).n = Vector::Zero(1); }},
      {"b", [](Scene& s) { kronecker(s).b[1] = NAN; }},
      {"n", [](Scene& s) { kronecker(s).n[0] = INFINITY; }},
      {"M.lower", [](Scene& s) { tridiagonal(s).lower[1] = NAN; }},
      {"M.diagonal", [](Scene& s) { tridiagonal(s).diagonal[2] = NAN; }},
      {"M.upper", [](Scene& s) { tridiagonal(s).upper[0] = NAN; }},
      {"M", [](Scene& s) { s.M = Matrix(Matrix::Identity(6, 6)); }},
      {"x0", [](Scene& s) { s.x0 = Vector::Zero(3); }},
      {"f", [](Scene& s) { s.f = [](double, Eigen::Ref<Vector> f) { f.setZero(); }; }},
  };
  expect_rejected(kronecker_scene(), rejections);
}

TEST(Scene, AsksForAsManySourcesAsTheEntryHas) {
  Index asked = 0;
  const TimeFunction count = [&](double, Eigen::Ref<Vector> f) { f.setZero(), asked = f.size(); };

  Scene scene = dense_scene();
  scene.f = count;
  scene.validate();
  EXPECT_EQ(asked, 3);
  scene.f_entry = SourceEntry::through_B;
  scene.validate();
  EXPECT_EQ(asked, 2);

  scene = kronecker_scene();
  scene.f = count;
  scene.f_entry = SourceEntry::through_B;
  scene.validate();
  EXPECT_EQ(asked, 3);
}

TEST(Scene, CountsStatesAndConstraints) {
  EXPECT_EQ(dense_scene().states(), 3);
  EXPECT_EQ(dense_scene().constraints(), 2);
  EXPECT_EQ(kronecker_scene().states(), 6);
  EXPECT_EQ(kronecker_scene().constraints(), 3);
  EXPECT_EQ(size(dense_scene().M), 2);
  EXPECT_EQ(size(kronecker_scene().M), 3);
}

TEST(Scene, KroneckerSumWrittenOut) {
  const Scene scene = kronecker_scene();
  const DenseDynamics written = to_dense(scene.dynamics);
  const oracle::DenseScene expected = oracle::write_out(scene);
  // Both add at most two numbers per entry, of size up to 32: equal to a rounding error of the sum.
  EXPECT_LE((written.A - expected.A).cwiseAbs().maxCoeff(), 64 * epsilon);
  EXPECT_EQ(written.B, expected.B);
  EXPECT_EQ(written.N, expected.N);
  EXPECT_EQ(to_dense(scene.M), expected.M);

  // By hand: state index = line * 2 + position, neighbours on a line couple with 1/0.25^2, lines with 2/0.5^2.
  EXPECT_DOUBLE_EQ(written.A(0, 0), -2 * 16 - 2 * 8);
  EXPECT_DOUBLE_EQ(written.A(0, 1), 16);
  EXPECT_DOUBLE_EQ(written.A(0, 2), 8);
  EXPECT_DOUBLE_EQ(written.A(1, 2), 0);
  EXPECT_EQ(written.B.col(1), (Vector{{0, 0, 1, 2, 0, 0}}));
  EXPECT_EQ(written.N.row(2).transpose(), (Vector{{0, 0, 0, 0, 3, -4}}));
  EXPECT_EQ(to_dense(scene.M), (Matrix{{4, -2, 0}, {-1, 5, -2}, {0, -1, 6}}));
}

TEST(Scene, RefusesToWriteOutLargeKroneckerSums) {
  const SecondDifference side{65, 1, 1};
  EXPECT_THROW(to_dense(Dynamics{KroneckerDynamics{side, side, Vector::Zero(65), Vector::Zero(65)}}), Error);
}

TEST(Scene, MultipliesByM) {
  const Vector y{{1, -2, 3}};
  EXPECT_EQ(multiply(kronecker_scene().M, y), to_dense(kronecker_scene().M) * y);
  EXPECT_EQ(multiply(dense_scene().M, y.head(2)), y.head(2));
  const LcpMatrix single = Tridiagonal{Vector::Constant(1, NAN), Vector::Constant(1, 3), Vector::Constant(1, NAN)};
  EXPECT_EQ(multiply(single, Vector::Constant(1, 2)), Vector::Constant(1, 6));
  EXPECT_EQ(to_dense(single), Matrix::Constant(1, 1, 3));
}

TEST(SecondDifference, EigenvaluesMatchTheSineVectors) {
  for (const Index points : {1, 2, 7, 16}) {
    const SecondDifference d{points, 0.1, 0.3};
    const Vector lambda = d.eigenvalues();
    ASSERT_EQ(lambda.size(), points);
    const double scale = d.diffusivity / (d.spacing * d.spacing);
    for (Index k = 1; k <= points; ++k) {
      const auto sine = [&](Index i) { return std::sin(std::numbers::pi * double(i * k) / double(points + 1)); };
      for (Index i = 1; i <= points; ++i)  // sines of arguments up to 50 and a sum of three terms of size 2 scale
        EXPECT_NEAR(scale * (sine(i - 1) - 2 * sine(i) + sine(i + 1)), lambda[k - 1] * sine(i), 200 * scale * epsilon);
      if (k > 1) {
        EXPECT_LT(lambda[k - 1], lambda[k - 2]);
      }
    }
  }
}

}  // namespace
}  // namespace bromwich
