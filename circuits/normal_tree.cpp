#include "circuits/normal_tree.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace bromwich::circuits {

namespace {

/// Beside other elements larger resistances of open diodes and switches count as none: rounding would decide the signs
/// of what they carry.
constexpr double largest_off = 1e7;
constexpr int of_current = 5;  ///< the rank of sources of current

Index node(const std::map<std::string, Index>& nodes, const std::string& name) { return nodes.at(name); }

[[noreturn]] void refuse(const Element& e, const std::string& found, const std::string& remedy) {
  throw Error(to_string(e.place), found, remedy);
}

int rank_of(const Element& e, bool follows) {
  switch (e.kind) {
    case 'V':
    case 'E':
    case 'H':
    case 'P':
    case 'U':
      return 0;
    case 'B':
      return e.of_voltage ? 0 : 5;
    case 'C':
      return 1;
    case 'R':
      return 2;
    case 'D':
    case 'S':
    case 'W':
      return opens(e) ? 3 : 2;
    case 'L':
      return follows ? 0 : 4;
    default:
      return 5;
  }
}

// Joins everything that connects nodes, and gives parts without a path to ground a node of reference.
std::vector<Index> ground(const Netlist& netlist, const std::map<std::string, Index>& nodes, Forest& forest) {
  Forest all(Index(nodes.size()));
  for (const Element& e : netlist.elements) all.join(node(nodes, e.nodes[0]), node(nodes, e.nodes[1]));
  std::vector<Index> grounded;
  for (const auto& [name, i] : nodes)
    if (all.join(0, i)) {
      forest.join(0, i);
      grounded.push_back(i);
    }
  return grounded;
}

// How many elements are in excess: capacitors that close loops, inductors that no loop of others takes; and loops of
// voltage sources and ideal windings, which weigh more.
long excess(const Netlist& netlist, const std::map<std::string, Index>& nodes, const std::vector<char>& follows) {
  Forest forest(Index(nodes.size()));
  ground(netlist, nodes, forest);
  long count = 0;
  for (int rank = 0; rank < 5; ++rank)
    for (std::size_t i = 0; i < netlist.elements.size(); ++i) {
      const Element& e = netlist.elements[i];
      if (rank_of(e, follows[i]) != rank) continue;
      const bool joined = forest.join(node(nodes, e.nodes[0]), node(nodes, e.nodes[1]));
      if (rank == 0 && !joined) count += 1000;
      if ((rank == 1 && !joined) || (rank == 4 && joined)) ++count;
    }
  return count;
}

void mark(const WindingGroup& g, std::vector<char>& follows) {
  for (std::size_t k = 0; k < g.order.size(); ++k)
    follows[std::size_t(g.inductors[std::size_t(g.order[k])])] = Index(k) >= g.base;
}

}  // namespace

std::map<std::string, Index> number_nodes(const Netlist& netlist) {
  std::map<std::string, Index> nodes{{"0", 0}};
  for (const Element& e : netlist.elements)
    for (const std::string& name : e.nodes) nodes.emplace(name, Index(nodes.size()));
  return nodes;
}

bool opens(const Element& e) { return std::isinf(e.kind == 'D' ? e.diode.off : e.gate.off); }

std::vector<std::string> open_large_resistances(Netlist& netlist, const std::map<std::string, Index>& nodes) {
  const auto off = [](Element& e) -> double* {
    if (e.kind == 'D') return &e.diode.off;
    return e.kind == 'S' || e.kind == 'W' ? &e.gate.off : nullptr;
  };
  Forest others{Index(nodes.size())};
  for (Element& e : netlist.elements)
    if (const double* r = off(e); rank_of(e, false) < of_current && (!r || *r <= largest_off))
      others.join(node(nodes, e.nodes[0]), node(nodes, e.nodes[1]));
  std::vector<std::string> opened;
  for (Element& e : netlist.elements) {
    double* r = off(e);
    if (!r || *r <= largest_off || std::isinf(*r)) continue;
    if (others.root(node(nodes, e.nodes[0])) != others.root(node(nodes, e.nodes[1]))) continue;
    *r = INFINITY;
    opened.push_back(e.name);
  }
  return opened;
}

NormalTree normal_tree(const Netlist& netlist, const std::map<std::string, Index>& nodes) {
  const std::size_t count = netlist.elements.size();
  NormalTree tree{std::vector<char>(count, 0), std::vector<char>(count, 0), winding_groups(netlist), {}};
  // Nodes that elements only see.
  std::vector<char> driven(nodes.size(), 0);
  for (const Element& e : netlist.elements)
    for (int k = 0; k < 2; ++k) driven[std::size_t(node(nodes, e.nodes[std::size_t(k)]))] = 1;
  for (const Element& e : netlist.elements)
    for (std::size_t k = 2; k < e.nodes.size(); ++k)
      if (const Index i = node(nodes, e.nodes[k]); i > 0 && !driven[std::size_t(i)])
        refuse(e, fmt::format("{}: node {} is only sensed, nothing drives it", e.name, netlist.written.at(e.nodes[k])),
               "connect it");
  for (WindingGroup& g : tree.groups) {
    mark(g, tree.follows);
    if (g.base == Index(g.inductors.size())) continue;
    long best = excess(netlist, nodes, tree.follows);
    for (Index first = 1; first < Index(g.inductors.size()) && best > 0; ++first) {
      WindingGroup other = with_base(g, first);
      mark(other, tree.follows);
      const long found = excess(netlist, nodes, tree.follows);
      if (found < best) g = std::move(other), best = found;
    }
    mark(g, tree.follows);
  }
  Forest forest{Index(nodes.size())};
  tree.grounded = ground(netlist, nodes, forest);
  for (int rank = 0; rank < 6; ++rank)
    for (std::size_t i = 0; i < count; ++i) {
      const Element& e = netlist.elements[i];
      if (rank_of(e, tree.follows[i]) != rank) continue;
      const bool joined = forest.join(node(nodes, e.nodes[0]), node(nodes, e.nodes[1]));
      tree.in_tree[i] = joined;
      if (rank == 0 && !joined)
        refuse(e, fmt::format("{} closes a loop of voltage sources", e.name), "put a resistance into the loop");
      if (rank == 5 && joined)
        refuse(e,
               fmt::format(
                   "{}: nothing but current sources leads to node {}", e.name,
                   netlist.written.count(e.nodes[0]) ? netlist.written.at(e.nodes[0]) : netlist.written.at(e.nodes[1])),
               "put a resistance beside it");
    }
  return tree;
}

}  // namespace bromwich::circuits
