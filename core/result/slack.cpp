#include "core/result/slack.hpp"

#include "core/result/located.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/scene/source_steps.hpp"

#include <algorithm>

namespace bromwich {

namespace {

double defect(const Eigen::Ref<const Vector>& y, const Vector& w) { return y.cwiseMin(w).cwiseAbs().maxCoeff(); }

// Whether g may jump at t, which is known to `resolution`.
bool may_jump(const Scene& scene, double t, double resolution) {
  if (!scene.breakpoints_are_all) return true;
  const auto next = std::lower_bound(scene.breakpoints.begin(), scene.breakpoints.end(), t - resolution);
  return next != scene.breakpoints.end() && *next <= t + resolution;
}

// w with the limit of g, from the left or from the right, that y is complementary to; `w` if neither is better.
Vector on_the_side_of_y(const OneSided& g, double t, double T, const Vector& own, const Eigen::Ref<const Vector>& y,
                        const Vector& w) {
  constexpr double clear = 0.1;
  Vector best = w;
  const auto look = [&](const Vector& limit) {
    const Vector there = w + (g.whole(limit) - own);
    if (defect(y, there) < clear * defect(y, best)) best = there;
  };
  if (t > 0) look(g.before(t, T));
  if (t < T) look(g.after(t, T));
  return best;
}

}  // namespace

RowMatrix slack(const Scene& scene, const Result& result, Index first, Index count) {
  constexpr double met = 1e-12;
  const double resolution = 256 * epsilon * scene.T;
  const Vector t = result.t.segment(first, count);
  RowMatrix w = result.trace.middleRows(first, count);
  ScenesInModes scenes(scene);
  for (Index j = 0; j < count; ++j) {  // polls nothing: a result that is there is kept
    const Scene& now = scenes.at_row(result.modes, first + j);
    const Vector y = result.y.row(first + j).transpose();
    Vector g = Vector::Zero(w.cols());
    if (now.g) now.g(t[j], g);
    w.row(j) += (g + multiply(now.M, y)).transpose();
    const bool one_sided = locates_switches(result) || has_own_steps(result) || result.method == Method::galerkin;
    if (!one_sided || !now.g || y.size() == 0 || !may_jump(scene, t[j], resolution)) continue;
    const Vector here = w.row(j).transpose();
    if (defect(y, here) <= met * g.cwiseAbs().maxCoeff()) continue;
    const OneSided sides(now.g, w.cols(), resolution);
    w.row(j) = on_the_side_of_y(sides, t[j], scene.T, g, y, here).transpose();
  }
  return w;
}

RowMatrix slack(const Scene& scene, const Result& result) {
  if (result.trace.rows() != result.t.size()) return {};
  return slack(scene, result, 0, result.t.size());
}

}  // namespace bromwich
