#include "circuits/network.hpp"

#include <cmath>
#include <numeric>

namespace bromwich::circuits {

namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;

Rows from(const Triplets& entries, Index rows, Index columns) {
  Rows m(rows, columns);
  m.setFromTriplets(entries.begin(), entries.end());
  return m;
}

/// The equations P z = Q s of the unknown z, voltages of the nodes 1, 2, ... and currents of the branches of voltage;
/// and all currents, C z + D s.
struct Equations {
  Equations(const std::vector<Branch>& branches, Index nodes, Index signals)
      : branches_(branches), unknown_(branches.size(), -1), size_(nodes - 1) {
    for (std::size_t b = 0; b < branches.size(); ++b)
      if (branches[b].of_voltage) unknown_[b] = size_++;
    for (std::size_t b = 0; b < branches.size(); ++b) add(Index(b));
    P = from(p_, size_, size_), Q = from(q_, size_, signals);
    C = from(c_, Index(branches.size()), size_), D = from(d_, Index(branches.size()), signals);
    P.prune(0.0, 0.0);
  }

  Rows P, Q, C, D;
  const std::vector<Index>& unknown() const { return unknown_; }

 private:
  static void entry(Triplets& to, Index row, Index column, double value) {
    to.emplace_back(int(row), int(column), value);
  }
  static void of_node(Triplets& to, Index row, Index node, double value) {
    if (node > 0) entry(to, row, node - 1, value);
  }

  void add(Index b) {
    const Branch& one = branches_[std::size_t(b)];
    const Index own = unknown_[std::size_t(b)];
    if (one.of_voltage) {  // v(from) - v(to) - R i - ... = a s
      of_node(p_, own, one.from, 1), of_node(p_, own, one.to, -1);
      entry(p_, own, own, -one.slope);
      for (const auto& [pair, k] : one.voltages) of_node(p_, own, pair.first, -k), of_node(p_, own, pair.second, k);
      for (const auto& [other, r] : one.currents) entry(p_, own, unknown_[std::size_t(other)], -r);
      for (const auto& [signal, a] : one.signals) entry(q_, own, signal, a);
      entry(c_, b, own, 1);
    } else {
      of_node(c_, b, one.from, one.slope), of_node(c_, b, one.to, -one.slope);
      for (const auto& [pair, k] : one.voltages) of_node(c_, b, pair.first, k), of_node(c_, b, pair.second, -k);
      for (const auto& [other, r] : one.currents) entry(c_, b, unknown_[std::size_t(other)], r);
      for (const auto& [signal, a] : one.signals) entry(d_, b, signal, a);
    }
    for (const auto& [node, sign] : {std::pair(one.from, 1.0), {one.to, -1.0}}) {  // what leaves a node is 0
      if (node == 0) continue;
      const Index row = node - 1;
      if (one.of_voltage) {
        entry(p_, row, own, sign);
        continue;
      }
      of_node(p_, row, one.from, sign * one.slope), of_node(p_, row, one.to, -sign * one.slope);
      for (const auto& [pair, k] : one.voltages)
        of_node(p_, row, pair.first, sign * k), of_node(p_, row, pair.second, -sign * k);
      for (const auto& [other, r] : one.currents) entry(p_, row, unknown_[std::size_t(other)], sign * r);
      for (const auto& [signal, a] : one.signals) entry(q_, row, signal, -sign * a);
    }
  }

  const std::vector<Branch>& branches_;
  std::vector<Index> unknown_;
  Index size_;
  Triplets p_, q_, c_, d_;
};

// Entries that are rounding of their column: signals that do not reach a node.
void clean(Rows& m) {
  Vector largest = Vector::Zero(m.cols());
  for (Index i = 0; i < m.rows(); ++i)
    for (Rows::InnerIterator e(m, i); e; ++e) largest[e.col()] = std::max(largest[e.col()], std::abs(e.value()));
  m.prune([&](Index, Index column, double value) { return std::abs(value) > 1e-15 * largest[column]; });
}

}  // namespace

NetworkSolution solve_network(const std::vector<Branch>& branches, Index nodes, Index signals) {
  const Equations equations(branches, nodes, signals);
  NetworkSolution solution;
  const BlockSolution found = solve_in_blocks(equations.P, equations.Q);
  if (found.singular >= 0) {
    if (found.singular < nodes - 1) solution.singular_node = found.singular + 1;
    for (std::size_t b = 0; b < branches.size(); ++b)
      if (equations.unknown()[b] == found.singular) solution.singular_branch = Index(b);
    return solution;
  }
  solution.currents = Rows(equations.C * found.Z) + equations.D;
  solution.voltages = below(Rows(1, signals), Rows(found.Z.topRows(nodes - 1)));
  clean(solution.voltages);
  clean(solution.currents);
  return solution;
}

Forest::Forest(Index nodes) : parent_(std::size_t(nodes)) { std::iota(parent_.begin(), parent_.end(), Index(0)); }

Index Forest::root(Index node) {
  while (parent_[std::size_t(node)] != node)
    node = parent_[std::size_t(node)] = parent_[std::size_t(parent_[std::size_t(node)])];
  return node;
}

bool Forest::join(Index a, Index b) {
  a = root(a), b = root(b);
  parent_[std::size_t(a)] = b;
  return a != b;
}

}  // namespace bromwich::circuits
