#include "core/events/combination.hpp"

namespace bromwich {

Combination::Combination(const Matrix& factors) {
  for (Index i = 0; i < factors.rows(); ++i)
    for (Index j = 0; j < factors.cols(); ++j)
      if (factors(i, j) != 0) entries_.push_back({i, j, factors(i, j)});
}

JetCombination::JetCombination(const Jet& c) : x(c.x), f(c.f), df(c.df), g(c.g), dg(c.dg), ddg(c.ddg) {}

void JetCombination::add_terms(const JetValues& size, Vector& sum) const {
  x.add_terms(size.x, sum);
  f.add_terms(size.f, sum);
  df.add_terms(size.df, sum);
  g.add_terms(size.g, sum);
  dg.add_terms(size.dg, sum);
  ddg.add_terms(size.ddg, sum);
}

}  // namespace bromwich
