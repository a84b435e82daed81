#include "bench/studies/heat_on_a_square.hpp"

#include <utility>

namespace bromwich::app {

SparseDynamics heat_on_a_square(Index G, const std::vector<Index>& points) {
  const double c = double(G + 1) * double(G + 1);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < G; ++j) {
      const Index r = i * G + j;
      entries.emplace_back(r, r, -4 * c);
      for (const auto& [inside, other] :
           {std::pair{i > 0, r - G}, {i + 1 < G, r + G}, {j > 0, r - 1}, {j + 1 < G, r + 1}})
        if (inside) entries.emplace_back(r, other, c);
    }
  const Index n = Index(points.size());
  SparseDynamics d{SparseMatrix(G * G, G * G), SparseMatrix(G * G, n), SparseMatrix(n, G * G)};
  d.A.setFromTriplets(entries.begin(), entries.end());
  for (Index i = 0; i < n; ++i) {
    d.B.insert(points[std::size_t(i)], i) = c;
    d.N.insert(i, points[std::size_t(i)]) = 1;
  }
  d.B.makeCompressed();
  d.N.makeCompressed();
  return d;
}

}  // namespace bromwich::app
