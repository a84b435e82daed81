#include "core/scan/coarse_start.hpp"

#include "core/base/error.hpp"
#include "core/host/stage_march.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bromwich {

namespace {

constexpr Index usual_steps = 10;    ///< of the march, in one coarse step
constexpr Index fewest_coarse = 16;  ///< steps

// Rows of the input that are the next to equal times.
std::vector<Index> nearest_rows(const Vector& t, Index steps) {
  std::vector<Index> rows;
  const double T = t[t.size() - 1];
  for (Index k = 0; k <= steps; ++k) {
    const double time = T * double(k) / double(steps);
    const Index above = std::lower_bound(t.begin(), t.end(), time) - t.begin();
    const bool below = above > 0 && (above == t.size() || time - t[above - 1] < t[above] - time);
    rows.push_back(below ? above - 1 : above);
  }
  return rows;
}

StageSolution coarse_march(const CoarseInput& in, Index steps, const ScanPlan& plan) {
  const std::vector<Index> rows = nearest_rows(in.t, steps);
  StageProblem p;
  p.dynamics = in.dynamics;
  p.M = in.M;
  p.lcp_class = in.lcp_class;
  p.stages = 1;
  p.h = in.t[in.t.size() - 1] / double(steps);
  p.x0 = in.x0;
  p.g = in.g(rows, Eigen::all);
  if (in.phi.size() > 0) p.phi = in.phi(rows, Eigen::all);
  p.F = in.F;
  p.components.resize(std::size_t(in.x0.size()));
  std::iota(p.components.begin(), p.components.end(), Index(0));
  p.interrupted = plan.interrupted;
  return march_by_stages(p, Vector::Constant(in.g.cols(), NAN));
}

}  // namespace

CoarseStates coarse_states(const ScanPlan& plan, const std::vector<Index>& rows,
                           const std::function<CoarseInput()>& input, const Vector& x0, Index constraints) {
  const Index J = rows.back(), chunks = Index(rows.size()) - 1;
  CoarseStates first{std::vector<Vector>(std::size_t(chunks), x0),
                     std::vector<Vector>(std::size_t(chunks), Vector::Zero(constraints))};
  const Index each = std::max<Index>(usual_steps, plan.threads->threads()), steps = J / each;
  if (!plan.coarse_start || chunks == 1 || steps < fewest_coarse) return first;
  const CoarseInput in = input();
  StageSolution coarse;
  try {
    coarse = coarse_march(in, steps, plan);
  } catch (const Error&) {  // a singular step
    return first;
  }
  for (std::size_t c = 1; c < first.x.size(); ++c) {
    const double place = in.t[rows[c]] / in.t[in.t.size() - 1] * double(steps);
    const Index k = std::min<Index>(Index(place), steps - 1);
    const double part = place - double(k);
    const Vector x = ((1 - part) * coarse.x.row(k) + part * coarse.x.row(k + 1)).transpose();
    first.x[c] = x.allFinite() ? x : first.x[c - 1];
    const Vector y = coarse.y.row(part < 0.5 ? k : k + 1).transpose();
    if (x.allFinite() && y.allFinite()) first.y[c] = y;
  }
  return first;
}

}  // namespace bromwich
