#include "bromwich/friction_problem.hpp"

#include "core/base/require.hpp"
#include "core/lcp/blocks.hpp"

namespace bromwich {

FrictionResult solve_friction(const Matrix& W, const Vector& q, const Vector& mu, const FrictionOptions& options) {
  const Index k = mu.size();
  if (W.rows() != 3 * k || W.cols() != 3 * k)
    throw Error("W", text("is %td x %td", W.rows(), W.cols()), text("make it %td x %td, 3 for each mu", 3 * k, 3 * k));
  if (q.size() != 3 * k) throw Error("q", text("has %td values", q.size()), text("give %td, 3 for each mu", 3 * k));
  if (!(mu.array() >= 0).all() || !mu.allFinite())
    throw Error("mu", "has an entry that is negative or not finite", "give numbers >= 0");
  if (!(options.tolerance > 0)) throw Error("tolerance", text("is %g", options.tolerance), "give a positive number");
  FrictionResult result;
  if (!W.allFinite() || !q.allFinite()) {
    result.r = result.u = Vector::Constant(3 * k, NAN);
    result.residual = NAN;
    result.status = LcpStatus::nonfinite;
    return result;
  }
  if (k == 0) {
    result.status = LcpStatus::solved;
    return result;
  }
  Blocks blocks;
  for (Index i = 0; i < k; ++i) blocks.push_back(std::make_unique<FrictionBlock>(3 * i, mu[i], false));
  BlockSolution found = solve_blocks(W, q, blocks, options.tolerance, options.most_sweeps);
  result.r = std::move(found.z);
  result.u = W * result.r + q;
  result.status = found.solved ? LcpStatus::solved : LcpStatus::unsolved;
  result.residual = found.residual;
  result.newton = found.newton;
  result.sweeps = found.sweeps;
  return result;
}

}  // namespace bromwich
