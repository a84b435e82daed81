// Where SuiteSparse is faster than the eliminations of bromwich, on the matrices of a field.
//
//     bromwich_field_factors PROBLEM
//
// Values at nodes, N (zI - A)^{-1} B for complex z: our multifrontal elimination, which carries the columns of B and
// the rows of N along, and UMFPACK, which factorizes zI - A and solves for all columns of B. Steps, (1/h - A) x = b:
// Eigen's simplicial L D L^T, in which our sparse Euler steps, and CHOLMOD, simplicial or supernodal as it chooses. One
// thread each. Prints JSON.

#include "bench/peers/field_problem.hpp"
#include "core/base/timer.hpp"
#include "core/dynamics/sparse_solves.hpp"

#include <Eigen/CholmodSupport>
#include <Eigen/SparseCholesky>
#include <Eigen/UmfPackSupport>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <numbers>

namespace {

using namespace bromwich;

constexpr Index nodes_at_once = 8;  ///< lanes of our elimination

struct AtNodes {
  double seconds = 0;  ///< a node
  ComplexMatrix values;
};

// On the imaginary axis from 1/T to 8/h, as the fit has them.
ComplexVector nodes_of(double h, double T) {
  ComplexVector z(nodes_at_once);
  for (Index i = 0; i < z.size(); ++i) z[i] = Complex(0, std::pow(8 * T / h, double(i) / double(z.size() - 1)) / T);
  return z;
}

AtNodes by_elimination(const SparseDynamics& d, const ComplexVector& z) {
  Timer timer;
  AtNodes found;
  found.values = multifrontal::sparse_shifted_solves(d.A, d.E, d.B, d.N, z, HostThreads());
  found.seconds = timer.lap() / double(z.size());
  return found;
}

AtNodes by_umfpack(const SparseDynamics& d, const ComplexVector& z, Index count) {
  using ComplexSparse = Eigen::SparseMatrix<Complex>;
  Timer timer;
  AtNodes found{0, ComplexMatrix(count, d.N.rows() * d.B.cols())};
  ComplexSparse identity(d.A.rows(), d.A.cols());
  identity.setIdentity();
  const Eigen::SparseMatrix<Complex> N = d.N.cast<Complex>();
  Eigen::UmfPackLU<ComplexSparse> lu;
  for (Index p = 0; p < count; ++p) {
    ComplexSparse shifted = z[p] * identity - d.A.cast<Complex>();
    shifted.makeCompressed();
    if (p == 0) lu.analyzePattern(shifted);
    lu.factorize(shifted);
    for (Index c = 0; c < d.B.cols(); ++c) {
      const ComplexVector column = N * ComplexVector(lu.solve(ComplexVector(Vector(d.B.col(c)).cast<Complex>())));
      for (Index i = 0; i < column.size(); ++i) found.values(p, i * d.B.cols() + c) = column[i];
    }
  }
  found.seconds = timer.lap() / double(count);
  return found;
}

struct Stepping {
  double analysed = 0, factorized = 0, solved = 0;
  Vector x;
};

template <class Factors>
Stepping steps_with(const SparseMatrix& matrix, const Vector& b, Index count) {
  Stepping found;
  Factors factors;
  Timer timer;
  factors.analyzePattern(matrix);
  found.analysed = timer.lap();
  factors.factorize(matrix);
  found.factorized = timer.lap();
  for (Index k = 0; k < count; ++k) found.x = factors.solve(b);
  found.solved = timer.lap() / double(count);
  return found;
}

void print(const char* name, const Stepping& s) {
  std::printf(", \"%s\": {\"analysis\": %.4g, \"factorization\": %.4g, \"solve\": %.4g}", name, s.analysed,
              s.factorized, s.solved);
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) {
    std::fprintf(stderr, "usage: bromwich_field_factors PROBLEM\n");
    return 2;
  }
  try {
    const app::FieldProblem problem = app::read_field(arguments[1]);
    const SparseDynamics& d = get<SparseDynamics>(problem.scene.dynamics);
    const double T = problem.scene.T, h = T / double(problem.steps);
    const ComplexVector z = nodes_of(h, T);
    const AtNodes ours = by_elimination(d, z), theirs = by_umfpack(d, z, 2);
    const double apart =
        (ours.values.topRows(2) - theirs.values).cwiseAbs().maxCoeff() / ours.values.cwiseAbs().maxCoeff();
    SparseMatrix matrix(d.A.rows(), d.A.cols());
    matrix.setIdentity();
    matrix = matrix / h - d.A;
    const Vector b = Vector::NullaryExpr(d.A.rows(), [](Index i) { return std::cos(double(i)); });
    const Stepping eigen = steps_with<Eigen::SimplicialLDLT<SparseMatrix>>(matrix, b, 20),
                   cholmod = steps_with<Eigen::CholmodDecomposition<SparseMatrix>>(matrix, b, 20);
    std::printf(
        "{\"states\": %td, \"constraints\": %td, \"node\": {\"elimination\": %.4g, \"umfpack\": %.4g, \"apart\": %.2g}",
        d.A.rows(), d.B.cols(), ours.seconds, theirs.seconds, apart);
    print("eigen", eigen);
    print("cholmod", cholmod);
    std::printf(", \"steps_apart\": %.2g}\n",
                (eigen.x - cholmod.x).cwiseAbs().maxCoeff() / eigen.x.cwiseAbs().maxCoeff());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bromwich_field_factors: %s\n", error.what());
    return 2;
  }
}
