#include "derivatives/set_margin.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "derivatives/lcp_terms.hpp"

#include <algorithm>

namespace bromwich {

namespace {

constexpr double degenerate = 1e-10;  ///< of the largest y_i and w_i: margins below count as y_i = w_i = 0
constexpr double rounding = 1e-12;    ///< of the terms of a sum

}  // namespace

SetRounding rounding_of_sets(const Vector& terms, const LcpMatrix& M, const RowMatrix& y, const RowMatrix& g) {
  SetRounding r{Vector::Zero(terms.size()), terms};
  if (terms.size() == 0) return r;
  if (g.size() > 0) r.w += Vector(g.cwiseAbs().colwise().maxCoeff());
  const Vector most_y = y.cwiseAbs().colwise().maxCoeff();
  add_product(absolute(M), most_y.data(), r.w.data());
  r.w *= rounding;
  const Vector own = diagonal(M);
  for (Index i = 0; i < own.size(); ++i)
    if (own[i] > 0) r.y[i] = r.w[i] / own[i];
  return r;
}

DerivativeMargin margin_of_sets(const RowMatrix& y, const RowMatrix& w, const SetRounding& zero, const Vector& t,
                                const ActiveSetAt& active_at) {
  DerivativeMargin found;
  for (Index i = 0; i < y.cols(); ++i) {
    const double most_y = y.col(i).cwiseAbs().maxCoeff(), most_w = w.col(i).cwiseAbs().maxCoeff();
    for (Index j = 0; j < y.rows(); ++j) {
      const std::vector<Index>& S = active_at(j);
      const bool active = std::binary_search(S.begin(), S.end(), i);
      if (active && y(j, i) <= 0) continue;  // a free row
      const double most = active ? most_y : most_w, value = active ? y(j, i) : w(j, i);
      const double margin = value > (active ? zero.y : zero.w)[i] ? value / most : 0;
      if (j == 0 && !active && margin <= degenerate) continue;  // see undecided_at_start
      if (margin < found.margin) found = {margin, t[j], i};
    }
  }
  if (found.margin <= degenerate)
    throw Error("derivative",
                text("not differentiable here: y_%ld = w_%ld = 0 at t = %.6g, where derivatives are one-sided",
                     long(found.constraint), long(found.constraint), found.time),
                "change the data or the number of steps slightly");
  return found;
}

std::vector<Index> undecided_at_start(const RowMatrix& w, const SetRounding& zero, const std::vector<Index>& active) {
  std::vector<Index> found;
  for (Index i = 0; i < w.cols(); ++i)
    if (!std::binary_search(active.begin(), active.end(), i) &&
        w(0, i) <= std::max(zero.w[i], degenerate * w.col(i).cwiseAbs().maxCoeff()))
      found.push_back(i);
  return found;
}

void check_change_at_start(const std::vector<Index>& undecided, const Vector& change_of_w, const Vector& terms) {
  for (const Index i : undecided)
    if (std::abs(change_of_w[i]) > rounding * terms[i])
      throw Error("derivative",
                  text("not differentiable here: the change moves w_%ld at t = 0, where y_%ld = w_%ld = 0", long(i),
                       long(i), long(i)),
                  "change x0 and g(0) slightly, or leave this w_i as it is");
}

bool weighs_start(const std::vector<Index>& undecided, const Vector& weight, double terms) {
  return std::any_of(undecided.begin(), undecided.end(),
                     [&](Index i) { return std::abs(weight[i]) > rounding * terms; });
}

}  // namespace bromwich
