// Chains of very many steps against the same steps taken in long double.
//
// The exponential scheme in long double is the oracle: S, R and their products from h and A with a 64-bit mantissa; M
// roundings are M 2^-64 = 5e-15 at most. In double, an increment D has the error |D| eps, the same in all steps,
// together T |A| eps = 1e-14. Each step adds a rounding of x, and M of them add up to sqrt(M) eps = 4e-14. A scan adds
// increments to products of up to 160 steps, a few times T |A| eps. The sum is below 1e-13. With steps stored as P = I
// + D the rounding of P alone could reach M eps = 1e-11.

#include "core/host/step_chain.hpp"
#include "tests/support/backends.hpp"

#include <Eigen/LU>

#include <cmath>

namespace bromwich {
namespace {

using Long = long double;
using ChainMatrix = Eigen::Matrix<Long, Eigen::Dynamic, Eigen::Dynamic>;
using ChainVector = Eigen::Matrix<Long, Eigen::Dynamic, 1>;

struct LongChain {
  Matrix A;
  StepScheme scheme;
  StepSizes steps;
  std::vector<ChainMatrix> P, inverse;

  LongChain(const Matrix& A, StepScheme scheme, const Vector& t) : A(A), scheme(scheme), steps(group_steps(t)) {
    const ChainMatrix I = ChainMatrix::Identity(A.rows(), A.rows());
    for (const double h : steps.sizes) {
      const ChainMatrix hA = Long(h) * A.cast<Long>();
      const bool euler = scheme == StepScheme::euler;
      inverse.push_back(ChainMatrix(I - (euler ? hA : ChainMatrix(hA / 2))).inverse());
      P.push_back(inverse.back() * (euler ? I : ChainMatrix(I + hA / 2)));
    }
  }
  Index M() const { return Index(steps.of.size()); }
  std::size_t kind(Index i) const { return std::size_t(steps.of[std::size_t(i - 1)]); }

  RowMatrix forward(const RowMatrix& d) const {
    RowMatrix x = d;
    ChainVector now = d.row(0).transpose().cast<Long>();
    for (Index i = 1; i <= M(); ++i) {
      now = ChainVector(P[kind(i)] * now) + inverse[kind(i)] * d.row(i).transpose().cast<Long>();
      x.row(i) = now.cast<double>().transpose();
    }
    return x;
  }
  RowMatrix adjoint(const RowMatrix& q) const {
    RowMatrix l = q;
    ChainVector mu = q.row(M()).transpose().cast<Long>();
    for (Index i = M(); i >= 1; --i) {
      l.row(i) = (inverse[kind(i)].transpose() * mu).cast<double>().transpose();
      mu = ChainVector(P[kind(i)].transpose() * mu) + q.row(i - 1).transpose().cast<Long>();
    }
    l.row(0) = mu.cast<double>().transpose();
    return l;
  }
};

double relative_distance(const RowMatrix& a, const RowMatrix& b) {
  return (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

class LongChains : public BackendTest {};

TEST_P(LongChains, AreThoseOfLongDouble) {
  Matrix A(3, 3);  // oscillates, undamped
  A << 0, 3, 0, -3, 0, 1, 0, -1, 0;
  const Index M = 100'000;
  Vector t(M + 1);
  t[0] = 0;
  for (Index i = 1; i <= M; ++i) t[i] = t[i - 1] + std::ldexp(1., i / 5000 % 3 - 14);  // three sizes, in runs
  RowMatrix d(M + 1, 3), q(M + 1, 3);
  for (Index i = 0; i <= M; ++i)
    for (Index k = 0; k < 3; ++k) {
      d(i, k) = 1e-4 * std::cos(0.01 * double(i) + double(k));
      q(i, k) = std::cos(0.37 * double(i) + double(k * k));
    }
  for (const StepScheme scheme : {StepScheme::euler, StepScheme::midpoint}) {
    const LongChain exact(A, scheme, t);
    const RowMatrix x = exact.forward(d), l = exact.adjoint(q);
    const bool sparse = scheme == StepScheme::euler;
    const auto chain = backend->step_chain(
        step_chain_problem(scheme, sparse ? StepMatrix(SparseMatrix(A.sparseView())) : StepMatrix(A), exact.steps));
    EXPECT_LE(relative_distance(chain->solve(d), x), 1e-13) << int(scheme);
    for (const AdjointMethod method : {AdjointMethod::substitution, AdjointMethod::scan, AdjointMethod::doubling}) {
      if (sparse && method == AdjointMethod::doubling) continue;  // uses the same increments as dense maps
      EXPECT_LE(relative_distance(chain->solve_transposed(q, {method, 1}), l), 1e-13)
          << int(scheme) << " " << int(method);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Backends, LongChains, testing::ValuesIn(backend_cases()), backend_case_name);

}  // namespace
}  // namespace bromwich
