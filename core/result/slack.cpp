#include "core/result/slack.hpp"

#include "core/result/located.hpp"
#include "core/scene/source_steps.hpp"

namespace bromwich {

namespace {

double defect(const Eigen::Ref<const Vector>& y, const Vector& w) { return y.cwiseMin(w).cwiseAbs().maxCoeff(); }

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
  const Vector t = result.t.segment(first, count);
  RowMatrix g = RowMatrix::Zero(count, scene.constraints());
  for (Index j = 0; j < count && scene.g; ++j) {  // polls nothing: a result that is there is kept
    Vector value = g.row(j).transpose();
    scene.g(t[j], value);
    g.row(j) = value.transpose();
  }
  RowMatrix w = g + result.trace.middleRows(first, count);
  const OneSided sides(scene.g, scene.constraints(), 256 * epsilon * scene.T);
  for (Index j = 0; j < count; ++j) {
    const Vector y = result.y.row(first + j).transpose();
    w.row(j) += multiply(scene.M, y).transpose();
    if (!(locates_switches(result) || has_own_steps(result)) || !scene.g || y.size() == 0) continue;
    const Vector here = w.row(j).transpose(), own = g.row(j).transpose();
    if (defect(y, here) > met * own.cwiseAbs().maxCoeff())
      w.row(j) = on_the_side_of_y(sides, t[j], scene.T, own, y, here).transpose();
  }
  return w;
}

RowMatrix slack(const Scene& scene, const Result& result) {
  if (result.trace.rows() != result.t.size()) return {};
  return slack(scene, result, 0, result.t.size());
}

}  // namespace bromwich
