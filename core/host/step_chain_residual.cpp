// Residuals of a chain weighted with an adjoint, a panel of rows at a time so that intermediate values stay in the
// cache. Neighbouring rows mostly use the same matrices and are multiplied together.

#include "core/host/step_chain_rows.hpp"

#include <algorithm>

namespace bromwich::host {

namespace {

/// Rows per panel: a few arrays of this size fit into a core's cache.
Index panel_rows(Index m) { return std::clamp<Index>(4096 / m, 4, 64); }

constexpr Index panels_together = 16;  ///< per task and workspace

/// Rows first, first + stride, ...
auto spread_rows(const RowMatrix& x, Index first, Index count, Index stride) {
  using Stride = Eigen::OuterStride<>;
  return Eigen::Map<const RowMatrix, 0, Stride>(x.data() + first * x.cols(), count, x.cols(),
                                                Stride(stride * x.cols()));
}

}  // namespace

void HostStepChain::apply_steps(Index first, Index stride, RowFactor factor, RowMatrix& in, Index count,
                                RowMatrix& out) {
  const auto kind = [&](Index k) { return map_of_[std::size_t(first + k * stride)]; };
  for (Index k = 0; k < count;) {
    Index end = k + 1;
    while (end < count && kind(end) == kind(k)) ++end;
    const bool of_R = factor == RowFactor::R || factor == RowFactor::R_transposed;
    if (of_R && plain_R_[std::size_t(kind(k))])
      out.middleRows(k, end - k) = in.middleRows(k, end - k);
    else
      apply(kind(k), factor, in.middleRows(k, end - k), out.middleRows(k, end - k));
    k = end;
  }
}

void HostStepChain::residual_rows(const RowMatrix& d, const RowMatrix& x, Index first, Index stride, Index count,
                                  Panel& p) {
  p.in = spread_rows(x, first + 1, count, stride);
  apply_steps(first, stride, RowFactor::change_transposed, p.in, count, p.out);
  p.r = spread_rows(d, first + 1, count, stride) + p.out.topRows(count);
  p.in -= spread_rows(x, first, count, stride);
  apply_steps(first, stride, RowFactor::R_transposed, p.in, count, p.out);
  p.r -= p.out.topRows(count);
}

Vector HostStepChain::weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& z) {
  Vector w(M_);
  const Index rows = panel_rows(m_), panels = (M_ + rows - 1) / rows;
  share(threads_, panels, panels_together, [&](Index begin, Index end) {
    Panel p(rows, m_);
    for (Index b = begin; b < end; ++b) {
      const Index first = b * rows, count = std::min(rows, M_ - first);
      residual_rows(d, x, first, 1, count, p);
      w.segment(first, count) = z.middleRows(first + 1, count).cwiseProduct(p.r).rowwise().sum();
    }
  });
  return w;
}

Vector HostStepChain::locally_weighted_residual(const RowMatrix& d, const RowMatrix& x, const RowMatrix& q,
                                                const RowMatrix& l) {
  Vector w(M_);
  const Index cells = M_ / 2, rows = panel_rows(m_), panels = (cells + rows - 1) / rows;
  share(threads_, panels, panels_together, [&](Index begin, Index end) {
    Panel p(rows, m_);
    RowMatrix mu, z(rows, m_);
    for (Index b = begin; b < end; ++b) {  // cells c + 1 .. c + count; steps count from 0
      const Index c = b * rows, count = std::min(rows, cells - c), first = 2 * c;
      const Index behind = std::min(count, cells - 1 - c);  // cells that have a next cell
      const auto weigh = [&](Index step) {                  // z = S^{-T} mu, then the products of z with the residuals
        apply_steps(step, 2, RowFactor::inverse, mu, count, z);
        residual_rows(d, x, step, 2, count, p);
        for (Index k = 0; k < count; ++k) w[step + 2 * k] = z.row(k).dot(p.r.row(k));
      };
      mu = spread_rows(q, first + 2, count, 2);
      p.in = l.middleRows(c + 2, behind);
      apply_steps(first + 2, 2, RowFactor::R, p.in, behind, p.out);
      mu.topRows(behind) += p.out.topRows(behind);
      weigh(first + 1);
      apply_steps(first + 1, 2, RowFactor::R, z, count, p.out);
      mu = spread_rows(q, first + 1, count, 2) + p.out.topRows(count);
      weigh(first);
    }
  });
  return w;
}

}  // namespace bromwich::host
