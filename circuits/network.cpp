#include "circuits/network.hpp"

#include <Eigen/LU>

#include <cmath>
#include <numeric>

namespace bromwich::circuits {

namespace {

// Rows and columns scaled by powers of two, so that conductances of 1e-9 and 1e3 count alike in the search of pivots.
struct Scaled {
  Matrix P;
  Vector rows, columns;
};

Scaled equilibrated(Matrix P) {
  Scaled s{std::move(P), {}, {}};
  s.rows = Vector::Ones(s.P.rows());
  s.columns = Vector::Ones(s.P.cols());
  const auto power = [](double largest) { return largest > 0 ? std::exp2(-std::round(std::log2(largest) / 2)) : 1.0; };
  for (int pass = 0; pass < 6; ++pass) {
    for (Index i = 0; i < s.P.rows(); ++i) {
      const double f = power(s.P.row(i).cwiseAbs().maxCoeff());
      s.P.row(i) *= f, s.rows[i] *= f;
    }
    for (Index i = 0; i < s.P.cols(); ++i) {
      const double f = power(s.P.col(i).cwiseAbs().maxCoeff());
      s.P.col(i) *= f, s.columns[i] *= f;
    }
  }
  return s;
}

}  // namespace

NetworkSolution solve_network(const std::vector<Branch>& branches, Index nodes, Index signals) {
  // Unknown: voltages of the nodes 1, 2, ..., then the currents of the branches of voltage.
  std::vector<Index> unknown(branches.size(), -1);
  Index size = nodes - 1;
  for (std::size_t b = 0; b < branches.size(); ++b)
    if (branches[b].of_voltage) unknown[b] = size++;
  Matrix P = Matrix::Zero(size, size), Q = Matrix::Zero(size, signals);
  const auto add = [&](Index row, Index node, double value) {
    if (row >= 0 && node > 0) P(row, node - 1) += value;
  };
  for (std::size_t b = 0; b < branches.size(); ++b) {
    const Branch& one = branches[b];
    const Index from = one.from - 1, to = one.to - 1;
    if (one.of_voltage) {  // v(from) - v(to) - R i - ... = a s
      const Index row = unknown[b];
      add(row, one.from, 1), add(row, one.to, -1);
      P(row, row) -= one.slope;
      for (const auto& [pair, k] : one.voltages) add(row, pair.first, -k), add(row, pair.second, k);
      for (const auto& [other, r] : one.currents) P(row, unknown[std::size_t(other)]) -= r;
      for (const auto& [signal, a] : one.signals) Q(row, signal) += a;
      if (from >= 0) P(from, row) += 1;
      if (to >= 0) P(to, row) -= 1;
      continue;
    }
    for (const auto& [node, sign] :
         {std::pair(from, 1.0), {to, -1.0}}) {  // the sum of currents that leave the node is 0
      if (node < 0) continue;
      add(node, one.from, sign * one.slope), add(node, one.to, -sign * one.slope);
      for (const auto& [pair, k] : one.voltages) add(node, pair.first, sign * k), add(node, pair.second, -sign * k);
      for (const auto& [other, r] : one.currents) P(node, unknown[std::size_t(other)]) += sign * r;
      for (const auto& [signal, a] : one.signals) Q(node, signal) -= sign * a;
    }
  }
  NetworkSolution solution;
  const Scaled scaled = equilibrated(P);
  Eigen::FullPivLU<Matrix> lu(scaled.P);
  lu.setThreshold(1e-13 * double(std::max<Index>(size, 1)));
  if (size > 0 && !lu.isInvertible()) {
    Index worst = 0;
    lu.kernel().col(0).cwiseAbs().maxCoeff(&worst);
    for (std::size_t b = 0; b < branches.size(); ++b)
      if (unknown[b] == worst) solution.singular_branch = Index(b);
    if (worst < nodes - 1) solution.singular_node = worst + 1;
    return solution;
  }
  Matrix Z = scaled.columns.asDiagonal() * lu.solve(Matrix(scaled.rows.asDiagonal() * Q));
  // One step of refinement: what cancels should cancel.
  Z += scaled.columns.asDiagonal() * lu.solve(Matrix(scaled.rows.asDiagonal() * (Q - P * Z)));
  solution.voltages = Matrix::Zero(nodes, signals);
  solution.voltages.bottomRows(nodes - 1) = Z.topRows(nodes - 1);
  solution.currents = Matrix::Zero(Index(branches.size()), signals);
  for (std::size_t b = 0; b < branches.size(); ++b) {
    const Branch& one = branches[b];
    auto row = solution.currents.row(Index(b));
    if (one.of_voltage) {
      row = Z.row(unknown[b]);
      continue;
    }
    row = one.slope * (solution.voltages.row(one.from) - solution.voltages.row(one.to));
    for (const auto& [pair, k] : one.voltages)
      row += k * (solution.voltages.row(pair.first) - solution.voltages.row(pair.second));
    for (const auto& [other, r] : one.currents) row += r * Z.row(unknown[std::size_t(other)]);
    for (const auto& [signal, a] : one.signals) row[signal] += a;
  }
  // Entries that are rounding of their column: signals that do not reach a node.
  const auto clean = [](Matrix& m) {
    for (Index j = 0; j < m.cols(); ++j) {
      const double small = 1e-15 * m.col(j).cwiseAbs().maxCoeff();
      for (Index i = 0; i < m.rows(); ++i)
        if (std::abs(m(i, j)) <= small) m(i, j) = 0;
    }
  };
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
