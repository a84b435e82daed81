// A Signorini problem on an L-shaped domain with user-supplied dynamics: bromwich calls a function that solves
// (zI - A) X = R, here by a sparse factorization, and does not need A itself.
//
//     x' = c Δx on [0, 1]^2 without its upper right quarter, x = 0 on the boundary except the bottom side, where
//     0 <= y  ⊥  x + M y - obstacle(t) >= 0 and y is the inflow.

#include <bromwich/bromwich.hpp>
#include <bromwich/cpu/cpu_backend.hpp>

#include <Eigen/SparseLU>

#include <cmath>
#include <cstdio>
#include <map>
#include <memory>
#include <utility>
#include <vector>

using namespace bromwich;

int main() {
  const Index side = 40;  // cells along the side; the notch takes a quarter of them
  const double dx = 1.0 / double(side), c = 0.1;
  std::map<std::pair<Index, Index>, Index> number;  // of the points inside
  for (Index j = 0; j < side; ++j)
    for (Index i = 1; i < side; ++i)
      if (2 * i < side || 2 * j < side) number.emplace(std::pair(i, j), Index(number.size()));
  const Index m = Index(number.size()), n = side - 1;

  std::vector<Eigen::Triplet<Complex>> entries;
  for (const auto& [at, row] : number) {
    const auto [i, j] = at;
    entries.emplace_back(row, row, -4 * c / (dx * dx));
    for (const auto& next : {std::pair(i - 1, j), std::pair(i + 1, j), std::pair(i, j - 1), std::pair(i, j + 1)}) {
      // The only flow through the bottom is y: the point below is the point itself.
      const auto inside = number.find(next.second < 0 ? at : next);
      if (inside != number.end()) entries.emplace_back(row, inside->second, c / (dx * dx));
    }
  }
  Eigen::SparseMatrix<Complex> A(m, m), I(m, m);
  A.setFromTriplets(entries.begin(), entries.end());
  I.setIdentity();

  SuppliedDynamics dynamics;
  dynamics.states = m;
  dynamics.B = SparseMatrix(m, n);
  dynamics.N = SparseMatrix(n, m);
  for (Index i = 1; i < side; ++i) {
    dynamics.B.insert(number.at({i, 0}), i - 1) = 1 / dx;
    dynamics.N.insert(i - 1, number.at({i, 0})) = 1;
  }
  dynamics.shifted = [&](Complex z) -> ShiftedSolve {
    const Eigen::SparseMatrix<Complex> shifted = z * I - A;
    const auto lu = std::make_shared<Eigen::SparseLU<Eigen::SparseMatrix<Complex>>>(shifted);
    return [lu](const ComplexMatrix& R) -> ComplexMatrix { return lu->solve(R); };
  };
  dynamics.bound = SpectralBound{0, 0};  // A is symmetric and negative
  dynamics.thread_safe = true;

  Scene scene;
  scene.name = "signorini-l-shape";
  scene.dynamics = dynamics;
  scene.M = Matrix(0.2 * Matrix::Identity(n, n));
  scene.g = [](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = -0.3 * std::sin(2 * M_PI * t) * std::sin(M_PI * double(i + 1) / double(n + 1));
  };
  scene.x0 = Vector::Zero(m);
  scene.T = 1;

  Options options;
  options.steps = 200;
  const auto backend = make_cpu_backend();
  const Result result = solve(scene, *backend, options);
  std::printf("%s: %s by %s, %td states, %td constraints, residual %.1e, largest y %.6f\n", scene.name.c_str(),
              to_string(result.status), to_string(result.method), m, n, result.residual, result.y.maxCoeff());
  return result.status == Status::solved ? 0 : 1;
}
