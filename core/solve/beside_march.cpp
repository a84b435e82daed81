#include "core/solve/beside_march.hpp"

namespace bromwich {

namespace {

constexpr Index most_blocks = 8;  ///< a mode that grows by 1e8 over T grows by 10 over one of them

// 8, 4, 2 or 1, of equal numbers of steps.
Index blocks_of(Index J) {
  Index blocks = most_blocks;
  while (J % blocks != 0) blocks /= 2;
  return blocks;
}

}  // namespace

Result beside_march(const Scene& scene, Backend& backend, const InnerOptions& options, const Result& result,
                    const RowMatrix& x) {
  InnerOptions one = options;
  one.method = Method::march;
  one.steps = result.steps;
  if (!scene.boundary) return solve_on_one_grid(scene, backend, one);
  const Index blocks = blocks_of(result.steps), steps = result.steps / blocks;
  one.steps = steps;
  one.prepared = {};  // the scenes of blocks do not come back
  one.progress = {};
  Result whole = result;
  whole.y_left.resize(0, 0);
  whole.interval_rules.clear();
  whole.y_integral = RowMatrix::Zero(result.y.rows(), result.y.cols());
  for (Index k = 0; k < blocks; ++k) {
    const Index from = k * steps;
    Scene part = part_of(scene, result.t[from], scene.T / double(blocks), x.row(from).transpose());
    part.exact = {};
    const Result solved = solve_on_one_grid(part, backend, one);
    if (solved.status != Status::solved) return solved;
    if (k == 0) whole.y.row(0) = solved.y.row(0);
    whole.y.middleRows(from + 1, steps) = solved.y.bottomRows(steps);
    whole.x.middleRows(from + 1, steps) = solved.x.bottomRows(steps);
    whole.y_integral.middleRows(from + 1, steps) =
        integral_of_y(solved).bottomRows(steps).rowwise() + whole.y_integral.row(from);
    whole.jumps_inside = whole.jumps_inside || solved.jumps_inside;
  }
  return whole;
}

}  // namespace bromwich
