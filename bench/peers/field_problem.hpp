#pragma once
// The arrays of a field, as scripts/bench_fields_peers writes them for programs: doubles m, n, J, T, compliance, b,
// entries of A; the n states of the contacts; m + 1 starts, rows and values of the columns of A; g, (J+1) x n by rows.

#include "core/base/error.hpp"
#include "core/scene/scene.hpp"

#include <cmath>
#include <fstream>
#include <memory>
#include <vector>

namespace bromwich::app {

class FieldReader {
 public:
  explicit FieldReader(const char* path) : file_(path, std::ios::binary) {}
  std::vector<double> take(Index count) {
    std::vector<double> values(static_cast<std::size_t>(count));
    file_.read(reinterpret_cast<char*>(values.data()), std::streamsize(values.size() * sizeof(double)));
    if (!file_) throw Error("PROBLEM", "ends early", "write it by scripts/bench_fields_peers");
    return values;
  }
  double number() { return take(1)[0]; }
  Index count() { return Index(number()); }

 private:
  std::ifstream file_;
};

struct FieldProblem {
  Scene scene;
  Index steps = 0;
};

inline FieldProblem read_field(const char* path) {
  FieldReader file(path);
  const Index m = file.count(), n = file.count(), J = file.count();
  FieldProblem problem{{}, J};
  Scene& scene = problem.scene;
  scene.T = file.number();
  const double compliance = file.number(), b = file.number();
  const Index entries = file.count();
  const std::vector<double> contacts = file.take(n), starts = file.take(m + 1), rows = file.take(entries),
                            values = file.take(entries);
  std::vector<Eigen::Triplet<double>> of_A;
  for (Index j = 0; j < m; ++j)
    for (auto e = std::size_t(starts[std::size_t(j)]); e < std::size_t(starts[std::size_t(j) + 1]); ++e)
      of_A.emplace_back(int(rows[e]), int(j), values[e]);
  SparseDynamics d{SparseMatrix(m, m), SparseMatrix(m, n), SparseMatrix(n, m)};
  d.A.setFromTriplets(of_A.begin(), of_A.end());
  std::vector<Eigen::Triplet<double>> of_B, of_N;
  for (Index i = 0; i < n; ++i) {
    const int state = int(contacts[std::size_t(i)]);
    of_B.emplace_back(state, int(i), b);
    of_N.emplace_back(int(i), state, 1);
  }
  d.B.setFromTriplets(of_B.begin(), of_B.end());
  d.N.setFromTriplets(of_N.begin(), of_N.end());
  scene.name = "field";
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.x0 = Vector::Zero(m);
  const auto table = std::make_shared<const std::vector<double>>(file.take((J + 1) * n));
  scene.g = [table, n, J, T = scene.T](double t, Eigen::Ref<Vector> g) {
    const Index j = Index(std::lround(t / T * double(J)));
    g = Eigen::Map<const Vector>(table->data() + j * n, n);
  };
  return problem;
}

}  // namespace bromwich::app
