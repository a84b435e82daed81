// Orders of nested dissection: permutations of any graph, and the fill on a square against George's bound. Fill is
// counted by eliminating the graph vertex by vertex.

#include "core/numerics/nested_dissection.hpp"
#include "tests/support/reference.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

namespace bromwich {
namespace {

using Edges = std::vector<std::pair<int, int>>;

Graph graph_of(int vertices, const Edges& edges) {
  std::vector<std::set<int>> neighbours(std::size_t(vertices), std::set<int>{});
  for (const auto& [a, b] : edges) {
    if (a == b) continue;
    neighbours[std::size_t(a)].insert(b);
    neighbours[std::size_t(b)].insert(a);
  }
  Graph graph{{0}, {}};
  for (const auto& list : neighbours) {
    graph.neighbour.insert(graph.neighbour.end(), list.begin(), list.end());
    graph.start.push_back(int(graph.neighbour.size()));
  }
  return graph;
}

Edges square(int G) {
  Edges edges;
  for (int i = 0; i < G; ++i)
    for (int k = 0; k < G; ++k) {
      if (i + 1 < G) edges.emplace_back(i * G + k, (i + 1) * G + k);
      if (k + 1 < G) edges.emplace_back(i * G + k, i * G + k + 1);
    }
  return edges;
}

// Entries of the factor below its diagonal.
long fill(const Graph& graph, const std::vector<int>& order) {
  std::vector<std::set<int>> left(order.size());
  for (int v = 0; v < graph.vertices(); ++v)
    left[std::size_t(v)] = {graph.neighbour.begin() + graph.start[std::size_t(v)],
                            graph.neighbour.begin() + graph.start[std::size_t(v) + 1]};
  long count = 0;
  for (const int v : order) {
    const std::set<int> around = left[std::size_t(v)];
    count += long(around.size());
    for (const int a : around) {
      left[std::size_t(a)].erase(v);
      for (const int b : around)
        if (a != b) left[std::size_t(a)].insert(b);
    }
  }
  return count;
}

bool is_permutation_of_all(std::vector<int> order, int vertices) {
  std::sort(order.begin(), order.end());
  for (int i = 0; i < vertices; ++i)
    if (i >= int(order.size()) || order[std::size_t(i)] != i) return false;
  return int(order.size()) == vertices;
}

TEST(NestedDissection, TakesAnyGraph) {
  Edges complete, star, path;
  for (int i = 0; i < 40; ++i) {
    for (int k = 0; k < i; ++k) complete.emplace_back(i, k);
    star.emplace_back(0, i);
    path.emplace_back(i, i + 1);
  }
  for (const auto& [vertices, edges] :
       std::vector<std::pair<int, Edges>>{{0, {}}, {1, {}}, {30, {}}, {40, complete}, {40, star}, {41, path}})
    EXPECT_TRUE(is_permutation_of_all(nested_dissection(graph_of(vertices, edges)), vertices)) << vertices;
  reference::Random random(5);
  for (int trial = 0; trial < 60; ++trial) {
    const int vertices = 1 + int(random.uniform(0, 200));
    Edges edges;
    for (int e = 0; e < int(random.uniform(0, 3) * vertices); ++e)
      edges.emplace_back(int(random.uniform(0, 1) * vertices), int(random.uniform(0, 1) * vertices));
    EXPECT_TRUE(is_permutation_of_all(nested_dissection(graph_of(vertices, edges)), vertices)) << trial;
  }
}

// 31/4 G^2 log2 G for a square of G x G vertices (George, SIAM J. Numer. Anal. 10, 1973), whatever the numbers of its
// vertices.
TEST(NestedDissection, FillsASquareLittle) {
  for (const int G : {15, 31, 40}) {
    const double bound = 31. / 4 * G * G * std::log2(G);
    EXPECT_LE(double(fill(graph_of(G * G, square(G)), nested_dissection(graph_of(G * G, square(G))))), bound) << G;
    Edges renumbered = square(G);
    for (auto& [a, b] : renumbered) a = int(long(a) * 7919 % (G * G)), b = int(long(b) * 7919 % (G * G));
    const Graph graph = graph_of(G * G, renumbered);
    EXPECT_LE(double(fill(graph, nested_dissection(graph))), bound) << G;
  }
}

}  // namespace
}  // namespace bromwich
