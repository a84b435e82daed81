#include "core/galerkin/location.hpp"

#include "core/result/switching.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

LocatedGrid locate_switches(const Scene& scene, const Result& result, Index N) {
  constexpr double same_time = 1e-2;  // of an interval: switches closer than that share a node
  constexpr double located = 0.49;    // of a step: the error of what is known no better is 1/2
  const double h = scene.T / double(N);
  LocatedGrid grid;
  double begin = 0;
  const auto add_part = [&](double end) {
    grid.parts.push_back({end, std::max<Index>(1, Index(std::lround((end - begin) / h)))});
    begin = end;
  };
  for (const Switch& s : switches(result)) {
    if (std::binary_search(scene.free_rows.begin(), scene.free_rows.end(), s.component)) continue;
    if (!(s.error < located * h)) {
      ++grid.missed;
      continue;
    }
    ++grid.located;
    if (s.t - begin > same_time * h && scene.T - s.t > same_time * h) add_part(s.t);
  }
  add_part(scene.T);
  return grid;
}

bool same_grid(const std::vector<GridPart>& a, const std::vector<GridPart>& b, double apart) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [apart](const GridPart& i, const GridPart& j) {
    return i.intervals == j.intervals && std::abs(i.end - j.end) <= apart;
  });
}

RowMatrix coefficients_on(const Result& r, const GalerkinProblem& p) {
  const Index n = r.y_left.cols(), N = r.y_left.rows();
  RowMatrix z(p.N, 2 * n);
  Index k = 0;
  for (Index j = 0; j < p.N; ++j) {
    const double t = (p.t[j] + p.t[j + 1]) / 2;
    while (k + 1 < N && r.t[k + 1] < t) ++k;
    const double s = (t - r.t[k]) / (r.t[k + 1] - r.t[k]);
    z.row(j).head(n) = (1 - s) * r.y_left.row(k) + s * r.y.row(k + 1);
    z.row(j).tail(n) = z.row(j).head(n);
  }
  return z;
}

}  // namespace bromwich
