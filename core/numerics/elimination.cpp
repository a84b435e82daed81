#include "core/numerics/elimination.hpp"

#include "core/numerics/nested_dissection.hpp"

#include <Eigen/OrderingMethods>

#include <algorithm>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

using Pattern = Eigen::SparseMatrix<char>;

// Pattern of A + A^T in the given order, without the diagonal.
Pattern symmetric_pattern(const SparseMatrix& A, const std::vector<int>& order) {
  std::vector<int> position(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) position[std::size_t(order[i])] = int(i);
  std::vector<Eigen::Triplet<char>> entries;
  entries.reserve(2 * std::size_t(A.nonZeros()));
  for (Index c = 0; c < A.cols(); ++c)
    for (SparseMatrix::InnerIterator a(A, c); a; ++a) {
      const int i = position[std::size_t(a.row())], j = position[std::size_t(c)];
      if (i == j) continue;
      entries.emplace_back(i, j, 1);
      entries.emplace_back(j, i, 1);
    }
  Pattern S(A.rows(), A.cols());
  S.setFromTriplets(entries.begin(), entries.end(), [](char, char) { return char(1); });
  return S;
}

// parent[j]: the first row below the diagonal of column j of the factor, or -1 (Liu's algorithm with path compression).
std::vector<int> elimination_tree(const Pattern& S) {
  std::vector<int> parent(std::size_t(S.cols()), -1), ancestor(parent);
  for (int j = 0; j < int(S.cols()); ++j)
    for (Pattern::InnerIterator s(S, j); s && s.row() < j; ++s)
      for (int i = int(s.row()); i != -1 && i != j;) {
        const int next = ancestor[std::size_t(i)];
        ancestor[std::size_t(i)] = j;
        if (next == -1) parent[std::size_t(i)] = j;
        i = next;
      }
  return parent;
}

std::vector<int> postorder(const std::vector<int>& parent) {
  const int m = int(parent.size());
  std::vector<int> head(parent.size(), -1), next(parent.size(), -1), order, path;
  for (int j = m; j-- > 0;)
    if (parent[std::size_t(j)] >= 0) {
      next[std::size_t(j)] = head[std::size_t(parent[std::size_t(j)])];
      head[std::size_t(parent[std::size_t(j)])] = j;
    }
  order.reserve(parent.size());
  for (int root = 0; root < m; ++root) {
    if (parent[std::size_t(root)] >= 0) continue;
    path.push_back(root);
    while (!path.empty()) {
      const int child = head[std::size_t(path.back())];
      if (child >= 0) {
        head[std::size_t(path.back())] = next[std::size_t(child)];
        path.push_back(child);
      } else {
        order.push_back(path.back());
        path.pop_back();
      }
    }
  }
  return order;
}

// Number of entries below the diagonal in each column of the factor: row i has an entry in every column on the paths
// from the columns of row i of S up to i.
std::vector<int> column_counts(const Pattern& S, const std::vector<int>& parent) {
  std::vector<int> count(parent.size(), 0), mark(parent.size(), -1);
  for (int i = 0; i < int(S.cols()); ++i) {
    mark[std::size_t(i)] = i;
    for (Pattern::InnerIterator s(S, i); s && s.row() < i; ++s)
      for (int j = int(s.row()); mark[std::size_t(j)] != i; j = parent[std::size_t(j)]) {
        mark[std::size_t(j)] = i;
        ++count[std::size_t(j)];
      }
  }
  return count;
}

// Groups columns with equal or nearly equal structure into fronts. A chain of fronts with few pivots each is limited by
// memory traffic, so the last child is merged with its parent if at most 1/16 of the entries become explicit zeros.
std::vector<Index> front_starts(const std::vector<int>& parent, const std::vector<int>& count) {
  const Index m = Index(parent.size());
  std::vector<Index> starts, entries;  // of the fronts so far; entries without the zeros
  for (Index j = 0; j < m; ++j) {
    const Index below = count[std::size_t(j)];
    starts.push_back(j);
    entries.push_back(1 + below);
    while (starts.size() >= 2) {
      const Index last = starts.back() - 1, child = starts[starts.size() - 2], pivots = j - child + 1;
      if (parent[std::size_t(last)] < starts.back() || parent[std::size_t(last)] > j) break;
      const Index together = entries.back() + entries[entries.size() - 2],
                  all = pivots * (pivots + 1) / 2 + pivots * below;
      if (16 * (all - together) > all) break;
      starts.pop_back();
      entries.pop_back();
      entries.back() = together;
    }
  }
  starts.push_back(m);
  return starts;
}

// Union of sorted lists.
void merge_into(std::vector<int>& all, const std::vector<int>& more) {
  if (more.empty()) return;
  std::vector<int> both;
  both.reserve(all.size() + more.size());
  std::set_union(all.begin(), all.end(), more.begin(), more.end(), std::back_inserter(both));
  all.swap(both);
}

void sort_unique(std::vector<int>& list) {
  std::sort(list.begin(), list.end());
  list.erase(std::unique(list.begin(), list.end()), list.end());
}

void measure(Elimination& e) {
  std::vector<Index> stack;
  Index waiting = 0;
  for (const Front& front : e.fronts) {
    for (Index c = 0; c < front.children; ++c) {
      waiting -= stack.back();
      stack.pop_back();
    }
    const Index remainder = front.remainder();
    if (remainder > 0) stack.push_back(remainder);
    waiting += remainder;
    e.largest_stack = std::max(e.largest_stack, waiting);
    e.largest_front = std::max(e.largest_front, front.rows() * front.cols());
    for (Index p = 1; p <= front.pivots; ++p) e.products += double(front.rows() - p) * double(front.cols() - p);
  }
}

using Order = std::vector<int>;

Order by_degree(const SparseMatrix& A) {
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> found;
  Eigen::AMDOrdering<int>()(A, found);
  return {found.indices().begin(), found.indices().end()};
}

Order by_dissection(const SparseMatrix& A) {
  Order as_given(std::size_t(A.rows()));
  std::iota(as_given.begin(), as_given.end(), 0);
  const Pattern S = symmetric_pattern(A, as_given);
  const int* const start = S.outerIndexPtr();
  const int* const neighbour = S.innerIndexPtr();
  return nested_dissection({{start, start + S.cols() + 1}, {neighbour, neighbour + S.nonZeros()}});
}

// A postorder of the elimination tree: the same fill, and columns of a front are next to each other.
Order in_postorder(const SparseMatrix& A, const Order& given) {
  Order order = postorder(elimination_tree(symmetric_pattern(A, given)));
  for (int& position : order) position = given[std::size_t(position)];
  return order;
}

Elimination in_order(Order order, const SparseMatrix& A, const SparseMatrix& B, const SparseMatrix& N,
                     Index dense_inputs) {
  Elimination e;
  const Index m = A.rows();
  e.order = std::move(order);
  const Pattern S = symmetric_pattern(A, e.order);
  const std::vector<int> parent = elimination_tree(S);
  const std::vector<Index> starts = front_starts(parent, column_counts(S, parent));
  const Eigen::SparseMatrix<double, Eigen::RowMajor> rows_of_B = B;
  e.fronts.resize(starts.size() - 1);
  std::vector<std::size_t> front_of(static_cast<std::size_t>(m));
  for (std::size_t s = 0; s < e.fronts.size(); ++s)
    for (Index j = starts[s]; j < starts[s + 1]; ++j) front_of[std::size_t(j)] = s;
  for (std::size_t s = 0; s < e.fronts.size(); ++s) {
    Front& front = e.fronts[s];
    front.first = starts[s];
    front.pivots = starts[s + 1] - starts[s];
    const Index end = starts[s + 1];
    // The children have left their own lists here.
    for (Index j = front.first; j < end; ++j) {
      for (Pattern::InnerIterator a(S, j); a; ++a)
        if (a.row() >= end) front.rest.push_back(int(a.row()));
      const Index original = e.order[std::size_t(j)];
      for (Eigen::SparseMatrix<double, Eigen::RowMajor>::InnerIterator b(rows_of_B, original); b; ++b)
        front.inputs.push_back(int(b.col()));
      for (SparseMatrix::InnerIterator n(N, original); n; ++n) front.outputs.push_back(int(n.row()));
    }
    sort_unique(front.rest);
    sort_unique(front.inputs);
    sort_unique(front.outputs);
    if (!front.rest.empty()) {
      const std::size_t parent_front = front_of[std::size_t(front.rest.front())];
      Front& up = e.fronts[parent_front];
      ++up.children;
      const auto beyond = std::lower_bound(front.rest.begin(), front.rest.end(), int(starts[parent_front + 1]));
      merge_into(up.rest, std::vector<int>(beyond, front.rest.end()));
      merge_into(up.inputs, front.inputs);
      merge_into(up.outputs, front.outputs);
    }
    // Full columns are inputs of every front, behind those of B, which alone are handed on.
    for (Index d = 0; d < dense_inputs; ++d) front.inputs.push_back(int(B.cols() + d));
  }
  measure(e);
  return e;
}

}  // namespace

Elimination analyse(const SparseMatrix& A, const SparseMatrix& B, const SparseMatrix& N, Index dense_inputs) {
  constexpr double worth_dissecting = 1000;  // products a state: they take about as long as the dissection then
  Elimination found = in_order(in_postorder(A, by_degree(A)), A, B, N, dense_inputs);
  if (found.products < worth_dissecting * double(A.rows())) return found;
  Elimination other = in_order(in_postorder(A, by_dissection(A)), A, B, N, dense_inputs);
  return other.products < found.products ? other : found;
}

}  // namespace bromwich
