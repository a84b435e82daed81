#include "core/result/slack.hpp"

#include "core/scene/separable.hpp"

namespace bromwich {

RowMatrix slack(const Scene& scene, const Result& result) {
  if (result.trace.rows() != result.t.size()) return {};
  RowMatrix w = sample(scene.g, result.t, scene.constraints()).table() + result.trace;
  for (Index j = 0; j < w.rows(); ++j) w.row(j) += multiply(scene.M, result.y.row(j).transpose()).transpose();
  return w;
}

}  // namespace bromwich
