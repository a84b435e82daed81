#include "core/kernel/wide_system.hpp"

#include "core/base/error.hpp"

#include <initializer_list>
#include <string>

namespace bromwich {

namespace {

// f given per state has m columns.
constexpr Index most_source_columns = 4096;
constexpr double most_source_bytes = 1 << 30;

SparseMatrix beside(std::initializer_list<const SparseMatrix*> blocks, Index rows) {
  std::vector<Eigen::Triplet<double>> entries;
  Index width = 0;
  for (const SparseMatrix* block : blocks) {
    for (Index c = 0; c < block->cols(); ++c)
      for (SparseMatrix::InnerIterator b(*block, c); b; ++b) entries.emplace_back(b.row(), width + c, b.value());
    width += block->cols();
  }
  SparseMatrix all(rows, width);
  all.setFromTriplets(entries.begin(), entries.end());
  return all;
}

SparseMatrix source_columns(const DiscreteProblem& p, Index outputs) {
  const Index m = p.scene.states();
  SparseMatrix none(m, 0);
  if (p.f.size() == 0 || p.scene.f_entry == SourceEntry::through_B) return none;
  if (p.scene.f_entry == SourceEntry::through_F) return p.scene.F;
  const double bytes = 2 * sizeof(double) * double(p.J + 1) * double(outputs) * double(m);
  if (m > most_source_columns || bytes > most_source_bytes)
    throw Error("f", "found one value for each of " + std::to_string(m) + " states",
                "write f as F phi(t) with a few columns F");
  SparseMatrix identity(m, m);
  identity.setIdentity();
  return identity;
}

}  // namespace

Wide widen(const DiscreteProblem& p, const std::vector<Index>& components) {
  const Dynamics& d = p.scene.dynamics;
  const SparseMatrix B = d->inputs(), given_N = d->outputs();
  const Index m = p.scene.states();
  Wide wide;
  wide.n = given_N.rows();
  wide.components = Index(components.size());
  const SparseMatrix F = source_columns(p, wide.outputs());
  wide.sources = F.cols();
  SparseMatrix x0(m, 0);
  if ((p.scene.x0.array() != 0).any()) x0 = d->times_mass(p.scene.x0).sparseView(0, 0);
  wide.states = x0.cols();
  std::vector<Eigen::Triplet<double>> rows;
  for (Index c = 0; c < m; ++c)
    for (SparseMatrix::InnerIterator a(given_N, c); a; ++a) rows.emplace_back(a.row(), c, a.value());
  for (Index i = 0; i < wide.components; ++i) rows.emplace_back(wide.n + i, components[std::size_t(i)], 1.0);
  SparseMatrix N(wide.outputs(), m);
  N.setFromTriplets(rows.begin(), rows.end());
  wide.dynamics = Dynamics(d->with_inputs_and_outputs(beside({&B, &F, &x0}, m), N));
  return wide;
}

}  // namespace bromwich
