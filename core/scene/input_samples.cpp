#include "core/scene/input_samples.hpp"

#include "core/scene/port_hamiltonian.hpp"

#include <algorithm>

namespace bromwich {
namespace {

constexpr std::size_t kept_grids = 2;  // one, and the one with its cells halved

/// The row with this time; -1 where there is none. `place` is where the last search ended; times ascend.
Index row_of(double time, const Vector& times, Index& place) {
  while (place < times.size() && times[place] < time) ++place;
  return place < times.size() && times[place] == time ? place : -1;
}

}  // namespace

RowMatrix InputSamples::at(const PortHamiltonian& port, double T, const Vector& t, double s) {
  const Index M = t.size() - 1, k = port.ports();
  s = std::clamp(s, 0., 1.);
  Grid grid;
  if (s == 0)
    grid.times = t.head(M);
  else if (s == 1)
    grid.times = t.tail(M);
  else
    grid.times = (1 - s) * t.head(M) + s * t.tail(M);
  std::vector<Grid>& known = of_fraction_[s];
  for (const Grid& other : known)
    if (other.times.size() == M && other.times == grid.times) return other.u;

  grid.u = RowMatrix::Zero(M, k);
  std::vector<Index> places(known.size(), 0);
  const double away = 4 * epsilon * T;  // from an end into the step
  for (Index i = 0; i < M; ++i) {
    Index row = -1;
    for (std::size_t g = known.size(); g-- > 0 && row < 0;)
      if ((row = row_of(grid.times[i], known[g].times, places[g])) >= 0) grid.u.row(i) = known[g].u.row(row);
    if (row >= 0) continue;
    Eigen::Map<Vector> value(grid.u.data() + i * k, k);
    port.u(s == 0   ? std::min(grid.times[i] + away, T)
           : s == 1 ? std::max(grid.times[i] - away, 0.)
                    : grid.times[i],
           value);
  }
  RowMatrix u = grid.u;
  known.push_back(std::move(grid));
  if (known.size() > kept_grids) known.erase(known.begin());
  return u;
}

}  // namespace bromwich
