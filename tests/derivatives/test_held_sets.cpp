// Problems on given sets against the matrix of all time points, on every backend and by every method.

#include "derivatives/held_sets.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/transposed_operator.hpp"
#include "derivatives/lcp_terms.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/dense_kernel.hpp"
#include "tests/support/refusal.hpp"

#include <Eigen/LU>

#include <cmath>
#include <string>

namespace bromwich::held_sets_test {
namespace {

using reference::Random;

// Sets of no solution: any will do.
RowMatrix drawn_sets(Index rows, Index n) {
  Random random(2);
  return (random.matrix(rows, n).array() > -0.2).cast<double>();
}

// M + K on the sets, the identity elsewhere.
RowMatrix by_elimination(Matrix whole, const RowMatrix& active, const RowMatrix& r) {
  Vector right = -stacked(r);
  for (Index k = 0; k < whole.rows(); ++k)
    if (!(active.data()[k] > 0)) {
      whole.row(k).setZero();
      whole(k, k) = 1;
      right[k] = 0;
    }
  const Vector y = whole.partialPivLu().solve(right);
  return Eigen::Map<const RowMatrix>(y.data(), active.rows(), active.cols());
}

Matrix with_M(Matrix K, const LcpMatrix& M) {
  const Index n = size(M);
  for (Index j = 0; j < K.rows(); j += n) K.block(j, j, n, n) += to_dense(M);
  return K;
}

Scene oscillator() {
  Random random(11);
  Scene scene;
  const Index m = 6, n = 3;
  scene.dynamics =
      DenseDynamics{random.matrix(m, m) - 2.5 * Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
  scene.M = Matrix(4 * Matrix::Identity(n, n) + random.matrix(n, n));
  scene.x0 = Vector::Zero(m);
  scene.T = 2;
  return scene;
}

class HeldSetsOnBackends : public BackendTest {};

TEST_P(HeldSetsOnBackends, AreSolvedByEveryMethod) {
  const Index J = 32;
  Scene line = make_scene("signorini", {{"Q", 9}}), lines = make_scene("signorini3d", {{"Q", 4}}), sparse = line;
  sparse.dynamics = to_sparse(get<KroneckerDynamics>(line.dynamics));
  for (const auto& [name, scene, exact] : {std::tuple<std::string, Scene, double>{"dense", oscillator(), 1e-11},
                                           {"line", line, 1e-10},
                                           {"face", lines, 1e-10},
                                           {"sparse", sparse, 1e-8}})
    for (const Method method : {Method::march, Method::contour, Method::multigrid})
      for (const bool backwards : {false, true}) {
        const Index n = scene.constraints();
        RowMatrix active = drawn_sets(J + 1, n), r = 1e3 * Random(3).matrix(J + 1, n);
        if (backwards) active.row(0).setZero();
        GridFamily family;
        HeldSets forward(scene, *backend, active, method, family, make_time_operator);
        Scene adjoint = scene;
        adjoint.M = transposed(scene.M);
        std::unique_ptr<HeldSets> other;
        if (backwards)
          other = std::make_unique<HeldSets>(adjoint, *backend, active, method, family, [&](const DiscreteProblem& p) {
            return make_transposed_operator(p, forward.time_operator());
          });
        HeldSets& held = backwards ? *other : forward;
        Matrix K = dense_kernel(scene, J);
        if (backwards) {  // rows 1 to J in reversed order, row 0 without weights
          const Matrix toeplitz = K.bottomRightCorner(J * n, J * n);
          K.setZero();
          for (Index i = 1; i <= J; ++i)
            for (Index k = 1; k <= i; ++k)
              K.block(i * n, k * n, n, n) = toeplitz.block((J - k) * n, (J - i) * n, n, n).transpose();
        }
        const Matrix whole = with_M(K, backwards ? adjoint.M : scene.M);
        for (int twice = 0; twice < 2; ++twice, r *= 1e-9) {
          const RowMatrix expected = by_elimination(whole, active, r);
          const HeldSets::Found found = held.solve(r);
          const std::string where = name + " " + to_string(method) + (backwards ? " backwards" : "");
          // Weights of two ways to them differ by `exact`; sweeps end at 1e-12 of y + 1.
          EXPECT_LE((found.y - expected).cwiseAbs().maxCoeff(), exact * expected.cwiseAbs().maxCoeff()) << where;
          const RowMatrix w =
              Eigen::Map<const RowMatrix>(Vector(whole * stacked(expected) + stacked(r)).data(), J + 1, n);
          EXPECT_LE((found.w - w).cwiseAbs().maxCoeff(), exact * w.cwiseAbs().maxCoeff()) << where;
          EXPECT_EQ(found.w.cwiseProduct(active).cwiseAbs().maxCoeff(), 0) << where;
          if (found.driven.size() == 0) continue;
          EXPECT_EQ(method, Method::march);
          const Vector driven = K * stacked(expected);
          EXPECT_LE((stacked(found.driven) - driven).cwiseAbs().maxCoeff(), exact * driven.cwiseAbs().maxCoeff())
              << where;
        }
        EXPECT_EQ(held.solve(RowMatrix::Zero(J + 1, n)).y.cwiseAbs().maxCoeff(), 0);
        RowMatrix bad = r;
        bad(1, 0) = NAN;
        EXPECT_NE(refusal([&] { held.solve(bad); }).find("not finite"), std::string::npos);
      }
}

// Factors of the forward problem serve its transpose.
TEST_P(HeldSetsOnBackends, ShareFactorsWithTheTransposedProblem) {
  const Index J = 40;
  const Scene line = make_scene("signorini", {{"Q", 20}});  // more constraints than are inverted as a whole
  for (const Scene& scene : {oscillator(), line}) {
    const Index n = scene.constraints();
    const RowMatrix active = drawn_sets(J + 1, n), r = Random(5).matrix(J + 1, n);
    RowMatrix reversed = RowMatrix::Zero(J + 1, n);
    reversed.bottomRows(J) = active.bottomRows(J).colwise().reverse();
    GridFamily family;
    HeldSets forward(scene, *backend, active, Method::march, family, make_time_operator);
    Scene adjoint = scene;
    adjoint.M = transposed(scene.M);
    const auto make = [&](const DiscreteProblem& p) { return make_transposed_operator(p, forward.time_operator()); };
    HeldSets own(adjoint, *backend, reversed, Method::march, family, make);
    HeldSets shared(adjoint, *backend, reversed, Method::march, family, make, &forward);
    const HeldSets::Found a = own.solve(r), b = shared.solve(r);
    EXPECT_LE((a.y - b.y).norm(), 1e-12 * a.y.norm());
    EXPECT_LE((a.w - b.w).norm(), 1e-12 * a.w.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Backends, HeldSetsOnBackends, testing::ValuesIn(backend_cases()), backend_case_name);

}  // namespace
}  // namespace bromwich::held_sets_test
