#include "circuits/windings.hpp"

#include "circuits/network.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <map>

namespace bromwich::circuits {

namespace {

constexpr double dependent = 1e-9;  ///< of the couplings: K = 1 up to the digits in which it is written

}  // namespace

WindingGroup with_base(WindingGroup g, Index first) {
  const Index n = Index(g.inductors.size());
  const Vector size = g.inductance.diagonal().cwiseSqrt().cwiseInverse();
  Matrix rest = size.asDiagonal() * g.inductance * size.asDiagonal();
  std::vector<bool> taken(std::size_t(n), false);
  g.order.clear();
  for (Index k = 0; k < n; ++k) {  // pivoted Cholesky
    Index pivot = first;
    if (k > 0) {
      pivot = -1;
      for (Index i = 0; i < n; ++i)
        if (!taken[std::size_t(i)] && (pivot < 0 || rest(i, i) > rest(pivot, pivot))) pivot = i;
    }
    if (!(rest(pivot, pivot) > dependent)) break;
    taken[std::size_t(pivot)] = true;
    g.order.push_back(pivot);
    const Vector column = rest.col(pivot) / rest(pivot, pivot);
    rest -= column * rest.row(pivot);
  }
  g.base = Index(g.order.size());
  for (Index i = 0; i < n; ++i)
    if (!taken[std::size_t(i)]) g.order.push_back(i);
  const std::vector<Index> base(g.order.begin(), g.order.begin() + g.base),
      follow(g.order.begin() + g.base, g.order.end());
  g.ratios = Matrix(0, g.base);
  if (!follow.empty())
    g.ratios = Matrix(g.inductance(base, base)).llt().solve(Matrix(g.inductance(base, follow))).transpose();
  return g;
}

std::vector<WindingGroup> winding_groups(const Netlist& netlist) {
  const auto& elements = netlist.elements;
  std::map<std::string, Index> by_name;
  for (std::size_t i = 0; i < elements.size(); ++i)
    if (elements[i].kind == 'L') by_name[lower(elements[i].name)] = Index(i);
  Forest joined(Index(elements.size()));
  std::map<std::pair<Index, Index>, double> couplings;
  std::map<Index, const Coupling*> cause;
  for (const Coupling& k : netlist.couplings) {
    std::vector<Index> of;
    for (const std::string& name : k.inductors) {
      const auto found = by_name.find(name);
      if (found == by_name.end())
        throw Error(to_string(k.place), fmt::format("{}: there is no inductor '{}'", k.name, name), "name inductors");
      of.push_back(found->second);
      cause[found->second] = &k;
    }
    for (const Index a : of)
      for (const Index b : of)
        if (a != b) couplings[{a, b}] = k.value, joined.join(a, b);
  }
  std::map<Index, WindingGroup> groups;
  for (const auto& [name, i] : by_name) groups[joined.root(i)].inductors.push_back(i);
  std::vector<WindingGroup> all;
  for (auto& [root, g] : groups) {
    std::sort(g.inductors.begin(), g.inductors.end());
    const Index n = Index(g.inductors.size());
    g.inductance = Matrix::Zero(n, n);
    Matrix coupling = Matrix::Identity(n, n);
    for (Index a = 0; a < n; ++a)
      for (Index b = 0; b < n; ++b) {
        const Index p = g.inductors[std::size_t(a)], q = g.inductors[std::size_t(b)];
        if (const auto found = couplings.find({p, q}); found != couplings.end()) coupling(a, b) = found->second;
        g.inductance(a, b) =
            coupling(a, b) * std::sqrt(elements[std::size_t(p)].value * elements[std::size_t(q)].value);
      }
    if (n > 1) {
      const double least = Eigen::SelfAdjointEigenSolver<Matrix>(coupling).eigenvalues().minCoeff();
      if (least < -dependent) {
        const Coupling& k = *cause.at(g.inductors[0]);
        throw Error(to_string(k.place),
                    fmt::format("{}: the couplings of {} are too large together: the inductance matrix is not positive",
                                k.name, elements[std::size_t(g.inductors[0])].name),
                    "give smaller couplings");
      }
    }
    all.push_back(with_base(std::move(g), 0));
  }
  return all;
}

}  // namespace bromwich::circuits
