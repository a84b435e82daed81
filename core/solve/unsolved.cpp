#include "core/solve/unsolved.hpp"

#include <cmath>

namespace bromwich {

Result unsolved(const Scene& scene, const Backend& backend, const Options& options, Status status,
                const std::string& why) {
  Result result;
  result.status = status;
  result.reason = why;
  result.method = options.method;
  result.backend = backend.name();
  result.steps = steps_of(scene, options);
  result.t = Vector::LinSpaced(result.steps + 1, 0, scene.T);
  result.x_components = recorded_components(scene, options);
  result.y = RowMatrix::Constant(result.steps + 1, scene.constraints(), NAN);
  result.x = RowMatrix::Constant(result.steps + 1, Index(result.x_components.size()), NAN);
  if (options.trace) result.trace = result.y;
  return result;
}

}  // namespace bromwich
