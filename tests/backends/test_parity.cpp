// The CUDA backend against the CPU backend: operations, batches and whole solves.
//
// same_everywhere: the backends compute the same sums in another order, with other exponentials and other fast
// transforms. One operation differs by a few hundred roundings of its largest sum, 1e-13 relative. A solve adds up to
// 600 lags of such weights and stops at a change of 1e-12, one sweep earlier or later, which leaves 1e-12/(1 - rate)
// with rates below 0.8. Where a scene amplifies perturbations further, Result::magnification multiplies the tolerance.

#include "catalogue/catalogue.hpp"
#include "derivatives/space_time_derivative.hpp"
#include "tests/derivatives/drawn_changes.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/oracle.hpp"
#include "tests/support/random_scenes.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

using reference::Random;

constexpr double same_everywhere = 1e-11;

bool identical(const RowMatrix& a, const RowMatrix& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * std::size_t(a.size())) == 0;
}

class BackendParity : public BothBackends {
 protected:
  /// `operation(backend)` returns a matrix; it runs twice on the CUDA backend.
  template <class Operation>
  void expect_same(const std::string& name, const Operation& operation) {
    const RowMatrix expected = operation(*cpu), found = operation(*cuda);
    EXPECT_TRUE(identical(found, operation(*cuda))) << name << ": two runs differ";
    const double size = std::max(1.0, expected.cwiseAbs().maxCoeff());
    EXPECT_LE(distance(found, expected), same_everywhere * size) << name;
  }

  void expect_same_solve(const Scene& scene, Options options, const std::string& name) {
    options.trace = true;
    const Result expected = solve(scene, *cpu, options), found = solve(scene, *cuda, options),
                 again = solve(scene, *cuda, options);
    EXPECT_EQ(found.backend, "cuda");
    EXPECT_TRUE(identical(found.y, again.y)) << name << ": two runs differ in y";
    EXPECT_TRUE(identical(found.trace, again.trace)) << name << ": two runs differ in N x";
    EXPECT_EQ(found.history, again.history) << name;
    EXPECT_EQ(found.status, expected.status) << name << ": " << expected.reason << " / " << found.reason;
    solved += expected.status == Status::solved;
    if (expected.status != Status::solved || found.status != Status::solved) return;
    const double growth = std::isnan(expected.magnification) ? 1 : std::max(1.0, expected.magnification);
    const auto tolerance = [&](const RowMatrix& of) {
      return same_everywhere * growth * std::max(1.0, of.cwiseAbs().maxCoeff());
    };
    EXPECT_LE(distance(found.y, expected.y), tolerance(expected.y)) << name;
    EXPECT_LE(distance(found.trace, expected.trace), tolerance(expected.trace)) << name;
  }

  Index solved = 0;
};

std::unique_ptr<Array> uploaded(Backend& backend, const RowMatrix& values) {
  auto array = backend.array(values.rows(), values.cols());
  backend.upload(values, *array);
  return array;
}

RowMatrix downloaded(Backend& backend, const Array& array) {
  RowMatrix values;
  backend.download(array, values);
  return values;
}

// ---- operations ----

TEST_F(BackendParity, SineTransforms) {
  for (const Index n : {1, 2, 39, 129, 1025})
    for (const Index first : {0, 5}) {
      const RowMatrix in = Random(1).matrix(40, n), add = Random(2).matrix(40, n);
      expect_same("n = " + std::to_string(n), [&](Backend& backend) {
        const auto x = uploaded(backend, in), r = uploaded(backend, add), out = uploaded(backend, add);
        backend.sine_transform(n, 40)->apply(*x, r.get(), *out, first);
        return downloaded(backend, *out);
      });
    }
}

// K * y, and again after the rows from 100 on have changed.
RowMatrix convolved_twice(Backend& backend, Convolution& convolution, RowMatrix y) {
  const auto in = uploaded(backend, y), out = backend.array(y.rows(), y.cols());
  convolution.apply(*in, *out, 0);
  y.bottomRows(y.rows() - 100) *= -0.5;
  backend.upload(y, *in);
  convolution.apply(*in, *out, 100);
  return downloaded(backend, *out);
}

TEST_F(BackendParity, Convolutions) {
  const Index rows = 601;
  for (const Index Q : {1, 39, 129}) {
    const KroneckerDynamics d = reference::signorini_dynamics(Q, 39);
    const Recurrence modal = modal_recurrence(d, Rule::exponential, 0.01, RowMatrix());
    const LagTable table = lag_table(modal, rows - 1);
    const RowMatrix y = Random(3).matrix(rows, Q);
    const std::string name = "Q = " + std::to_string(Q);
    expect_same(name + ", scan",
                [&](Backend& backend) { return convolved_twice(backend, *backend.convolution(modal, rows), y); });
    expect_same(name + ", FFT",
                [&](Backend& backend) { return convolved_twice(backend, *backend.convolution(table, rows), y); });
  }
  for (const Index n : {1, 8, 33}) {
    const Scene scene = oracle::random_scene(7, 10, n, oracle::SpectrumKind::sector, oracle::MatrixKind::dominant);
    const Recurrence stepped = dense_recurrence(get<DenseDynamics>(scene.dynamics), Rule::exponential, 0.01);
    const RowMatrix y = Random(4).matrix(rows, n);
    expect_same("10 states, n = " + std::to_string(n),
                [&](Backend& backend) { return convolved_twice(backend, *backend.convolution(stepped, rows), y); });
  }
}

// ---- batches ----

// 0 <= y ⊥ M y + q >= 0 for random q: from zero, from the solution of nearby problems, and from row 9 on.
RowMatrix solved_batches(Backend& backend, const LcpMatrix& M, LcpClass lcp_class, Index rows) {
  Random random(5);
  const Index n = size(M);
  RowMatrix q = 3 * random.matrix(rows, n);
  const auto lcp = backend.lcp(M, lcp_class, rows);
  const auto v = backend.array(rows, n), y = backend.array(rows, n);
  RowMatrix all(3 * rows, n);
  for (const Index round : {0, 1, 2}) {
    const LcpReport report = lcp->solve(*uploaded(backend, q), *v, *y, round == 2 ? 9 : 0, 1e-14);
    EXPECT_EQ(report.count.unsolved, 0) << backend.name() << ", n = " << n;
    all.middleRows(round * rows, rows) = downloaded(backend, *y);
    q += 0.3 * random.matrix(rows, n);
  }
  return all;
}

TEST_F(BackendParity, TridiagonalBatches) {
  std::vector<Index> sizes{129, 256, 511, 513, 1025};
  for (Index n = 1; n <= 70; ++n) sizes.push_back(n);
  for (const Index n : sizes) {
    Random random{std::uint32_t(n)};
    // Diagonally dominant with a margin of 1/2: inverses below 2, whatever n.
    const Vector lower = random.vector(n), upper = random.vector(n);
    const Vector diagonal = Vector::Constant(n, 0.5) + lower.cwiseAbs() + upper.cwiseAbs();
    const Tridiagonal any{lower, diagonal, upper}, z{-lower.cwiseAbs(), diagonal, -upper.cwiseAbs()};
    for (const auto& [M, lcp_class] : {std::pair(any, LcpClass::P), std::pair(z, LcpClass::Z)})
      expect_same("tridiagonal, n = " + std::to_string(n), [&, &M = M, lcp_class = lcp_class](Backend& backend) {
        return solved_batches(backend, M, lcp_class, 37);
      });
  }
}

// A device has different kernels for few and many problems, and for matrices with constant diagonals. The diagonal
// determines how far rows are coupled; inverses are below 1 / 0.05.
TEST_F(BackendParity, FewTridiagonalProblemsAndMany) {
  for (const Index n : {129, 257, 511, 600})
    for (const double diagonal : {2.05, 2.5, 6.0})
      for (const Index rows : {20, 1100}) {
        if (diagonal != 2.5 && rows > 20 && n != 511) continue;
        const Tridiagonal M{Vector::Constant(n, -1), Vector::Constant(n, diagonal), Vector::Constant(n, -1)};
        expect_same("n = " + std::to_string(n) + ", rows = " + std::to_string(rows),
                    [&](Backend& backend) { return solved_batches(backend, M, LcpClass::P, rows); });
      }
}

TEST_F(BackendParity, DenseBatches) {
  for (const Index n : {1, 2, 5, 8, 9, 16, 17, 33, 64, 65, 150, 210}) {
    Random random{std::uint32_t(n)};
    const Matrix any = random.dominant(n) + 0.5 * Matrix::Identity(n, n), G = random.matrix(n, n);
    Matrix z = -any.cwiseAbs();
    z.diagonal() = any.diagonal();
    // Positive definite by 1/2: inverses below 2. It takes more active sets than a dominant one.
    const Matrix skew = G * G.transpose() / double(n) + (G - G.transpose()) / 2 + 0.5 * Matrix::Identity(n, n);
    for (const auto& [M, lcp_class] :
         {std::pair(any, LcpClass::P), std::pair(z, LcpClass::Z), std::pair(skew, LcpClass::P)})
      expect_same("dense, n = " + std::to_string(n), [&, &M = M, lcp_class = lcp_class](Backend& backend) {
        return solved_batches(backend, M, lcp_class, 37);
      });
  }
}

// ---- solves ----

TEST_F(BackendParity, Signorini) {
  for (const auto& [Q, J] : {std::pair<Index, Index>{1, 1}, {1, 60}, {2, 60}, {38, 1}, {39, 400}, {129, 100}})
    for (const Method method : {Method::contour, Method::march}) {
      const Scene scene = make_scene("signorini", {{"Q", double(Q)}});
      expect_same_solve(scene, options_for(method, J),
                        "Q = " + std::to_string(Q) + ", J = " + std::to_string(J) + ", " + to_string(method));
    }
  EXPECT_EQ(solved, 12);
}

// With a contour of its own for every time point: modes, and dense dynamics whose contours are around eigenvalues.
TEST_F(BackendParity, ContoursOfEveryTimePoint) {
  for (const Index P : {8, 25, 100}) {
    Options options = options_for(Method::contour_literal, 100);
    options.tuning.literal_nodes = P;
    const std::string name = "P = " + std::to_string(P) + ", ";
    expect_same_solve(make_scene("signorini", {{"Q", 39}}), options, name + "signorini");
    expect_same_solve(make_scene("dlcp-small"), options, name + "dlcp-small");
    Scene swinging;
    swinging.dynamics = DenseDynamics{Matrix{{0, 1}, {-4, -0.5}}, Matrix{{0}, {1}}, Matrix{{1, 0}}};
    swinging.M = Matrix{{2}};
    swinging.x0 = Vector{{1, 0}};
    swinging.T = 3;
    expect_same_solve(swinging, options, name + "two states");
  }
  EXPECT_GE(solved, 6);
}

// Sizes whose coarse grids a device sweeps in modes, and one other size.
TEST_F(BackendParity, SignoriniByMultigrid) {
  for (const double Q : {40., 63., 127., 255., 511.})
    expect_same_solve(make_scene("signorini", {{"Q", Q}}), options_for(Method::multigrid, 256),
                      "Q = " + std::to_string(Q));
  EXPECT_EQ(solved, 5);
}

TEST_F(BackendParity, SignoriniByFft) {
  Options options = options_for(Method::contour, 200);
  options.tuning.convolution = ConvolutionChoice::fft;
  expect_same_solve(make_scene("signorini", {{"Q", 39}}), options, "FFT");
  EXPECT_EQ(solved, 1);
}

TEST_F(BackendParity, DenseScenes) {
  using oracle::MatrixKind, oracle::SpectrumKind;
  for (const Index n : {1, 5, 8, 9, 33, 64})
    for (const MatrixKind kind : {MatrixKind::dominant, MatrixKind::m_matrix})
      for (const Method method : {Method::contour, Method::march}) {
        const SpectrumKind spectrum = n % 2 == 0 ? SpectrumKind::real_negative : SpectrumKind::sector;
        const Scene scene = oracle::random_scene(std::uint32_t(n), 7, n, spectrum, kind);
        expect_same_solve(scene, options_for(method, 150), "n = " + std::to_string(n) + ", " + to_string(method));
      }
  EXPECT_EQ(solved, 24);
}

// Linear problems on the active sets of one solution, which both backends are given.
TEST_F(BackendParity, Derivatives) {
  using namespace derivative_test;
  const Index J = 96;
  for (const char* name : {"signorini", "signorini3d"})
    for (const Method method : {Method::march, Method::contour, Method::multigrid}) {
      const Scene scene = warmed(name, std::string(name) == "signorini" ? 39 : 5);
      const Result result = solve(scene, *cpu, options_for(method, J));
      ASSERT_EQ(result.status, Status::solved) << result.reason;
      const DataChange change = drawn(scene, J, 3);
      const Index n = scene.constraints();
      SolutionChange of;
      of.y = Random(4).matrix(J + 1, n);
      of.w = Random(5).matrix(J + 1, n);
      const std::string where = std::string(name) + ", " + to_string(method);
      expect_same("jvp " + where, [&](Backend& backend) {
        SpaceTimeDerivative derivative(scene, result, backend);
        EXPECT_EQ(derivative.method(), method);
        return derivative.jvp(change).y;
      });
      expect_same("vjp " + where,
                  [&](Backend& backend) { return RowMatrix(SpaceTimeDerivative(scene, result, backend).vjp(of).g); });
    }
}

TEST_F(BackendParity, BoundaryProblems) {
  for (const char* name : {"periodic-rectifier", "nash-game", "lq-control"})
    for (const Index J : {16, 400, 1030})
      expect_same_solve(make_scene(name), options_for(Method::galerkin, J), name + (", " + std::to_string(J)));
  EXPECT_EQ(solved, 9);
}

TEST_F(BackendParity, RandomScenes) {
  const std::uint32_t count = 4 * std::uint32_t(oracle::families);
  for (std::uint32_t seed = 0; seed < count; ++seed)
    for (const Method method : {Method::contour, Method::march}) {
      const oracle::RandomScene random = oracle::any_scene(seed);
      expect_same_solve(random.scene, options_for(method, random.steps),
                        "seed " + std::to_string(seed) + ", " + to_string(method));
    }
  EXPECT_GT(solved, Index(count)) << "half of the runs, so that y is compared";
}

}  // namespace
}  // namespace bromwich
