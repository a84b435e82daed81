#pragma once
// Contacts that cycles in w solve.

#include "catalogue/catalogue.hpp"
#include "tests/support/reference.hpp"
#include "tests/support/run.hpp"

#include <cmath>

namespace bromwich {

// w to the iteration tolerance of 1e-12, V to 1e-13 of V_0, which is below 1e2 on these grids.
inline constexpr double same_y = 2e-10;

inline Options euler_options(Index steps) {
  Options options = options_for(Method::dual, steps);
  options.tuning.dual_by_euler = true;
  return options;
}
inline Result run_by_euler(const Scene& scene, Index steps) { return run(scene, euler_options(steps)); }

inline Scene compliant(double Q, double eps, double c = 0.05) {
  return make_scene("contact", {{"Q", Q}, {"eps", eps}, {"c", c}});
}

// Dense dynamics with y through N^T.
inline Scene random_contact(std::uint32_t seed, Index m, Index n, double compliance) {
  reference::Random random(seed);
  const Matrix A = random.matrix(m, m) - 2.0 * Matrix::Identity(m, m), B = random.matrix(m, n);
  Scene scene;
  scene.name = "random";
  scene.dynamics = DenseDynamics{A, B, B.transpose()};
  scene.M = Matrix(compliance * Matrix::Identity(n, n));
  scene.f = [m](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::cos(t + double(i));
  };
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::cos(5 * t + 0.3 * double(i)) - 0.5;
  };
  scene.x0 = Vector::Zero(m);
  return scene;
}

// The ratio of successive changes of w, mean of the cycles before rounding.
inline double contraction_of(const Result& r) {
  double product = 1;
  int count = 0;
  for (std::size_t i = 1; i < r.history.size() && r.history[i] > 1e-11; ++i, ++count)
    product *= r.history[i] / r.history[i - 1];
  return count > 0 ? std::pow(product, 1. / count) : 0;
}

// A line of cells with conductivities that differ, one constraint for each row of cells at its left end.
inline Scene varying(Index rows, Index columns, double compliance) {
  const Index m = rows * columns;
  std::vector<Eigen::Triplet<double>> A, B, N;
  const auto cell = [columns](Index i, Index k) { return i * columns + k; };
  const auto conductivity = [](Index a, Index b) { return 0.05 * (1 + 0.5 * std::sin(double(a + 2 * b))); };
  const double cells = double(columns + 1);
  const auto join = [&](Index a, Index b) {
    const double c = conductivity(a, b) * cells * cells;
    A.emplace_back(a, b, c);
    A.emplace_back(b, a, c);
    A.emplace_back(a, a, -c);
    A.emplace_back(b, b, -c);
  };
  for (Index i = 0; i < rows; ++i) {
    for (Index k = 0; k < columns; ++k) {
      if (k + 1 < columns) join(cell(i, k), cell(i, k + 1));
      if (i + 1 < rows) join(cell(i, k), cell(i + 1, k));
    }
    A.emplace_back(cell(i, columns - 1), cell(i, columns - 1), -0.1 * cells * cells);
    B.emplace_back(cell(i, 0), i, cells);
    N.emplace_back(i, cell(i, 0), 1);
  }
  SparseDynamics d;
  d.A.resize(m, m);
  d.B.resize(m, rows);
  d.N.resize(rows, m);
  d.A.setFromTriplets(A.begin(), A.end());
  d.B.setFromTriplets(B.begin(), B.end());
  d.N.setFromTriplets(N.begin(), N.end());
  Scene scene;
  scene.name = "varying";
  scene.dynamics = d;
  scene.M = Matrix(compliance * Matrix::Identity(rows, rows));
  scene.x0 = Vector::Zero(m);
  scene.T = 4;
  scene.g = [rows](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < rows; ++i) g[i] = 0.5 * std::sin(3 * t) * (1 - std::exp(-5 * t)) * std::sin(0.4 + double(i));
  };
  return scene;
}

}  // namespace bromwich
