// K^T against the transpose of the dense matrix of K, whose weights come from one step of the written-out state, and
// the adjoint identity with the K of the same operator.

#include "core/kernel/transposed_kernel.hpp"

#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/dense_kernel.hpp"
#include "tests/support/refusal.hpp"

#include <string>
#include <vector>

namespace bromwich::transposed_test {
namespace {

using reference::Random;

Scene oscillator() {
  Random random(11);
  Scene scene;
  const Index m = 7, n = 3;
  scene.dynamics =
      DenseDynamics{random.matrix(m, m) - 2.5 * Matrix::Identity(m, m), random.matrix(m, n), random.matrix(n, m)};
  scene.M = Matrix(3 * Matrix::Identity(n, n));
  scene.x0 = Vector::Zero(m);
  scene.T = 2;
  return scene;
}

Scene sparse(const Scene& scene) {
  Scene written = scene;
  written.dynamics = to_sparse(get<KroneckerDynamics>(scene.dynamics));
  return written;
}

struct KernelCase {
  std::string name;
  Scene scene;
  ConvolutionChoice choice;
  double exact;  ///< difference of two ways to the weights
};

std::vector<KernelCase> kernel_cases() {
  const Scene line = make_scene("signorini", {{"Q", 9}}), lines = make_scene("signorini", {{"Q", 18}});
  return {{"dense, scan", oscillator(), ConvolutionChoice::scan, 1e-13},
          {"dense, fft", oscillator(), ConvolutionChoice::fft, 1e-11},
          {"kronecker, scan", line, ConvolutionChoice::scan, 1e-12},
          {"kronecker, fft", line, ConvolutionChoice::fft, 1e-12},
          {"kronecker, fitted", lines, ConvolutionChoice::automatic, 1e-11},
          {"sparse", sparse(line), ConvolutionChoice::automatic, 1e-9}};
}

class TransposedKernels : public BackendTest {};

TEST_P(TransposedKernels, AreTheTransposeOfTheDenseMatrix) {
  Random random(5);
  for (const KernelCase& c : kernel_cases())
    for (const Index J : {1, 2, 17}) {
      const Index n = c.scene.constraints();
      const DiscreteProblem p = discretise(c.scene, *backend, J);
      const auto op = make_time_operator(p);
      ASSERT_EQ(op->missing_weights(), "") << c.name;
      TransposedKernel transposed = op->transposed_kernel(c.choice);
      const KernelPlan plan = op->kernel(c.choice);
      const RowMatrix u = random.matrix(J + 1, n), v = random.matrix(J + 1, n);
      const RowMatrix Ktu = transposed.apply(u);
      const Matrix K = dense_kernel(c.scene, J);
      const double size = K.cwiseAbs().rowwise().sum().maxCoeff();
      EXPECT_LE((stacked(Ktu) - K.transpose() * stacked(u)).cwiseAbs().maxCoeff(), c.exact * size) << c.name << J;

      const auto in = device(v), out = backend->array(J + 1, n), of_u = device(u);
      plan.kernel->apply(*in, *out, 0);
      const RowMatrix Kv = host(*out);
      const double left = Kv.cwiseProduct(u).sum(), right = v.cwiseProduct(Ktu).sum();
      EXPECT_NEAR(left, right, 1e-13 * Kv.norm() * u.norm()) << c.name << J;
      transposed.apply(*of_u, *of_u);  // in place
      EXPECT_EQ((host(*of_u) - Ktu).cwiseAbs().maxCoeff(), 0) << c.name << J;
      EXPECT_GT(transposed.bytes(), 0u);
    }
}

INSTANTIATE_TEST_SUITE_P(Backends, TransposedKernels, testing::ValuesIn(backend_cases()), backend_case_name);

// u_0 has no effect, and K^T looks ahead only.
TEST(TransposedKernel, RunsBackwards) {
  const auto backend = make_cpu_backend(1);
  const Scene scene = oscillator();
  const DiscreteProblem p = discretise(scene, *backend, 12);
  TransposedKernel K = make_time_operator(p)->transposed_kernel(ConvolutionChoice::scan);
  RowMatrix u = RowMatrix::Zero(13, 3);
  u.row(0).setOnes();
  EXPECT_EQ(K.apply(u).cwiseAbs().maxCoeff(), 0);
  u.row(5).setOnes();
  const RowMatrix v = K.apply(u);
  EXPECT_EQ(v.bottomRows(7).cwiseAbs().maxCoeff(), 0);
  for (Index i = 0; i <= 5; ++i) EXPECT_GT(v.row(i).cwiseAbs().maxCoeff(), 0) << i;
  EXPECT_NE(refusal([&] { K.apply(RowMatrix::Zero(12, 3)); }).find("13 x 3"), std::string::npos);
}

// Weights with more outputs than inputs, and implicit Euler, whose y_0 has no effect.
TEST(TransposedKernel, OfARectangularTableAndOfImplicitEuler) {
  const auto backend = make_cpu_backend(1);
  Random random(3);
  LagTable table{3, 2, false, random.matrix(6, 6), random.matrix(6, 6)};
  table.S.row(0).setZero();
  TransposedKernel K(*backend, share_weights(table), 6);
  const RowMatrix u = random.matrix(6, 3), found = K.apply(u);
  for (Index i = 0; i < 6; ++i) {
    Vector sum = Vector::Zero(2);
    for (Index j = std::max<Index>(i, 1); j < 6; ++j) {
      const RowMatrix& weights = i == 0 ? table.S : table.W;
      sum += Eigen::Map<const RowMatrix>(weights.row(j - i).data(), 3, 2).transpose() * u.row(j).transpose();
    }
    EXPECT_LE((found.row(i).transpose() - sum).cwiseAbs().maxCoeff(), 1e-14 * 36) << i;
  }
  const Scene scene = oscillator();
  const DiscreteProblem p = discretise(scene, *backend, 9);
  const MarchData euler = make_time_operator(p)->march_weights(Rule::implicit_euler, RecurrenceChoice::automatic);
  TransposedKernel E(*backend, euler.weights, 10);
  EXPECT_EQ(E.apply(random.matrix(10, 3)).row(0).cwiseAbs().maxCoeff(), 0);
}

}  // namespace
}  // namespace bromwich::transposed_test
