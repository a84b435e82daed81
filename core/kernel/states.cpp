#include "core/kernel/states.hpp"

#include "core/base/error.hpp"
#include "core/kernel/closed_loop.hpp"
#include "core/kernel/kernel.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/numerics/phi.hpp"

#include <algorithm>
#include <map>
#include <set>

namespace bromwich {

namespace {

// Σ_d c_p F_d(z_p) u_{j-d} over the lags of one window, back to u_0 at most; u_0 has the weights S.
ComplexMatrix past_inputs(const LagWindow& window, const RowMatrix& u, Index j) {
  ComplexMatrix sums = ComplexMatrix::Zero(window.contour.nodes.size(), u.cols());
  const Index last = std::min(window.last, j - 1);
  for (Index d = window.first; d <= last; ++d)
    sums.noalias() += window.F.row(d - window.first).transpose() * u.row(j - d).cast<Complex>();
  if (window.first <= j && j <= window.last)
    sums.noalias() += window.S.row(j - window.first).transpose() * u.row(0).cast<Complex>();
  return sums;
}

// The state at one time point of a Kronecker sum, in modes of the `along` direction: row l is the grid line of mode l.
RowMatrix lines_at(const DiscreteProblem& p, const std::vector<LagWindow>& windows, const RowMatrix& u, Index j) {
  const KroneckerDynamics& d = *p.modes();
  const Vector mu = d.face_eigenvalues();
  RowMatrix lines = RowMatrix::Zero(mu.size(), d.across.points);
  std::vector<Vector> inputs;
  for (Index f = 0; f < d.families(); ++f) inputs.push_back(d.input(f));
  for (const LagWindow& window : windows) {
    if (window.first > j) break;
    const ComplexMatrix sums = past_inputs(window, u, j);
    for (Index l = 0; l < mu.size(); ++l)
      for (Index q = 0; q < sums.rows(); ++q)
        // zI - across is symmetric: the solution on a grid line with right-hand side b is its Green's row.
        lines.row(l) +=
            (sums(q, l) * green_row(d.across, inputs[std::size_t(d.family(l))], window.contour.nodes[q] - mu[l]))
                .real()
                .transpose();
  }
  return lines;
}

// The response to f on rough steps (core/kernel/rough_response.hpp) at chosen time points, in modes of both directions.
std::map<Index, RowMatrix> rough_states(const DiscreteProblem& p, const std::vector<Index>& rows) {
  std::map<Index, RowMatrix> at;
  if (!p.rough_response || rows.empty()) return at;
  const std::set<Index> wanted(rows.begin(), rows.end());
  each_rough_state(p, std::min(p.J, *wanted.rbegin()), [&](Index j, const RowMatrix& x) {
    if (wanted.count(j) > 0) at[j] = x.transpose();
  });
  return at;
}

Matrix kronecker_states_at(const DiscreteProblem& p, const RowMatrix& y, const std::vector<Index>& rows) {
  const KroneckerDynamics& d = *p.modes();
  const RowMatrix u =
      transformed(p.backend, p.face(), p.drive() ? RowMatrix(y + p.drive()->table()) : y, Way::to_modes);
  const RowMatrix x0 = x0_in_modes(p.backend, d, p.scene.x0, true);
  const Vector mu = d.face_eigenvalues(), nu = d.across.eigenvalues();
  const std::vector<LagWindow> windows = lag_windows(*contour_parameters(0), p.h, p.J);
  const std::map<Index, RowMatrix> rough = rough_states(p, rows);
  Matrix x(p.scene.states(), Index(rows.size()));
  for (std::size_t c = 0; c < rows.size(); ++c) {
    const Index j = rows[c];
    if (j == 0) {
      x.col(Index(c)) = p.scene.x0;
      continue;
    }
    // e^{A t} x0 is diagonal in both directions.
    RowMatrix free = x0;
    for (Index l = 0; l < mu.size(); ++l) free.row(l).array() *= (p.t[j] * (nu.transpose().array() + mu[l])).exp();
    if (const auto more = rough.find(j); more != rough.end()) free += more->second;
    const RowMatrix lines = from_line_modes(p.backend, d.across, free) + lines_at(p, windows, u, j);
    const RowMatrix grid = transformed(p.backend, p.face(), lines.transpose(), Way::to_points).transpose();
    x.col(Index(c)) = Eigen::Map<const Vector>(grid.data(), x.rows());  // of two faces: the view from the first one
  }
  return x;
}

}  // namespace

Matrix states_at_rows(const DiscreteProblem& p, const RowMatrix& y, const std::vector<Index>& rows,
                      const StepDefects* defects) {
  if (p.modes()) return kronecker_states_at(p, y, rows);
  if (p.small_state()) return states_of(p, Rule::exponential, y, defects).x(rows, Eigen::all).transpose();
  throw Error("dynamics", "whole states of sparse or supplied dynamics are not computed afterwards",
              "ask for components with Options::states when solving");
}

}  // namespace bromwich
