// symbol       variable      meaning
// V            vertices_     all vertices; those of a piece are next to each other, a separator behind its two parts
// d(v, a_k)    distance_     of the four vertices a_k of the piece, in edges

#include "core/numerics/nested_dissection.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <utility>

namespace bromwich {

namespace {

constexpr int smallest = 8;            ///< pieces of up to so many vertices are not divided
constexpr double smaller_part = 0.25;  ///< of the vertices, at least

class Dissection {
 public:
  explicit Dissection(const Graph& graph)
      : g_(graph), vertices_(std::size_t(graph.vertices())), piece_(vertices_.size(), 0), field_(vertices_.size()) {
    std::iota(vertices_.begin(), vertices_.end(), 0);
    for (auto& distances : distance_) distances.resize(vertices_.size());
    waiting_.emplace_back(0, graph.vertices());
  }

  std::vector<int> order() {
    while (!waiting_.empty()) {
      const auto [begin, end] = waiting_.back();
      waiting_.pop_back();
      each_component(begin, end);
    }
    return std::move(vertices_);
  }

 private:
  static constexpr int sources = 4;

  // Makes the components of a piece pieces of their own and divides the large ones.
  void each_component(int begin, int end) {
    if (end - begin <= smallest) return;
    const int given = new_piece(begin, end);
    std::vector<int> found;
    found.reserve(std::size_t(end - begin));
    std::vector<std::pair<int, int>> components;
    for (int i = begin; i < end; ++i) {
      if (piece_[at(vertices_, i)] != given) continue;
      const int first = int(found.size());
      grow(at(vertices_, i), given, ++pieces_, found);
      components.emplace_back(begin + first, begin + int(found.size()));
    }
    std::copy(found.begin(), found.end(), vertices_.begin() + begin);
    for (const auto& [first, last] : components)
      if (last - first > smallest) divide(first, last);
  }

  static int at(const std::vector<int>& list, int i) { return list[std::size_t(i)]; }

  int new_piece(int begin, int end) {
    ++pieces_;
    for (int i = begin; i < end; ++i) piece_[std::size_t(at(vertices_, i))] = pieces_;
    return pieces_;
  }

  template <class Visit>
  void each_neighbour(int v, Visit visit) const {
    for (int e = at(g_.start, v); e < at(g_.start, v + 1); ++e) visit(at(g_.neighbour, e));
  }

  // Appends the vertices that `from` reaches within `given`, and gives them to the piece `own`.
  void grow(int from, int given, int own, std::vector<int>& found) {
    std::size_t next = found.size();
    found.push_back(from);
    piece_[std::size_t(from)] = own;
    for (; next < found.size(); ++next)
      each_neighbour(found[next], [&](int w) {
        if (piece_[std::size_t(w)] != given) return;
        piece_[std::size_t(w)] = own;
        found.push_back(w);
      });
  }

  // d(., from) in a connected piece; returns the last vertex reached, one of the farthest.
  int measure(int begin, int end, int from, std::vector<int>& distance) {
    for (int i = begin; i < end; ++i) distance[std::size_t(at(vertices_, i))] = -1;
    const int own = piece_[std::size_t(from)];
    queue_.assign(1, from);
    distance[std::size_t(from)] = 0;
    for (std::size_t next = 0; next < queue_.size(); ++next) {
      const int v = queue_[next], d = at(distance, v) + 1;
      each_neighbour(v, [&](int w) {
        if (piece_[std::size_t(w)] != own || at(distance, w) >= 0) return;
        distance[std::size_t(w)] = d;
        queue_.push_back(w);
      });
    }
    return queue_.back();
  }

  // A connected piece: separator, parts.
  void divide(int begin, int end) {
    int a = measure(begin, end, at(vertices_, begin), distance_[0]);
    for (int k = 0; k < sources; ++k) {
      measure(begin, end, a, distance_[std::size_t(k)]);
      a = farthest(begin, end, k);
    }
    Cut best;
    for (int k = 0; k < sources; ++k)
      for (int l = 0; l < k; ++l) {
        set_field(begin, end, k, l);
        const Cut cut = best_cut(begin, end);
        if (cut.worth > best.worth) best = cut, best.k = k, best.l = l;
      }
    if (best.worth == 0) return;  // hardly any levels: nearly every vertex is joined to every other one
    set_field(begin, end, best.k, best.l);
    separate(begin, end, best);
  }

  // From the first k + 1 sources: the one for which the least of the distances is largest.
  int farthest(int begin, int end, int k) const {
    int found = at(vertices_, begin), most = -1;
    for (int i = begin; i < end; ++i) {
      const int v = at(vertices_, i);
      int least = at(distance_[0], v);
      for (int j = 1; j <= k; ++j) least = std::min(least, at(distance_[std::size_t(j)], v));
      if (least > most) most = least, found = v;
    }
    return found;
  }

  void set_field(int begin, int end, int k, int l) {
    lowest_ = INT32_MAX, highest_ = INT32_MIN;
    for (int i = begin; i < end; ++i) {
      const auto v = std::size_t(at(vertices_, i));
      const int value = distance_[std::size_t(k)][v] - distance_[std::size_t(l)][v];
      field_[v] = value;
      lowest_ = std::min(lowest_, value);
      highest_ = std::max(highest_, value);
    }
  }

  // The vertices with field <= level on one side, the separator those among them (`below`) or among the others that
  // have a neighbour on the other side.
  struct Cut {
    double worth = 0;  ///< product of the sizes of the parts over that of the separator
    int level = 0;
    bool below = true;
    int k = 0, l = 0;
  };

  // At all levels at once: a vertex is in the separator below the levels from its own up to the largest of its
  // neighbours, and so above.
  Cut best_cut(int begin, int end) {
    const auto levels = std::size_t(highest_ - lowest_) + 2;
    for (auto* list : {&count_, &under_, &over_}) list->assign(levels, 0);
    for (int i = begin; i < end; ++i) {
      const int v = at(vertices_, i), own = at(piece_, v), value = at(field_, v);
      int most = value, least = value;
      each_neighbour(v, [&](int w) {
        if (at(piece_, w) != own) return;
        most = std::max(most, at(field_, w));
        least = std::min(least, at(field_, w));
      });
      ++count_[std::size_t(value - lowest_)];
      ++under_[std::size_t(value - lowest_)], --under_[std::size_t(most - lowest_)];
      ++over_[std::size_t(least - lowest_)], --over_[std::size_t(value - lowest_)];
    }
    Cut best;
    const double all = end - begin;
    double left = 0, under = 0, over = 0;
    for (std::size_t level = 0; level + 2 < levels; ++level) {
      left += count_[level], under += under_[level], over += over_[level];
      for (const bool below : {true, false}) {
        const double size = below ? under : over, first = left - (below ? size : 0), second = all - size - first;
        if (std::min(first, second) < smaller_part * all) continue;
        const double worth = first * second / size;
        if (worth > best.worth) best = {worth, lowest_ + int(level), below};
      }
    }
    return best;
  }

  void separate(int begin, int end, const Cut& cut) {
    std::vector<int> parts[3];
    for (int i = begin; i < end; ++i) {
      const int v = at(vertices_, i), own = at(piece_, v);
      const bool left = at(field_, v) <= cut.level;
      bool meets = false;
      if (left == cut.below)
        each_neighbour(v, [&](int w) { meets |= at(piece_, w) == own && (at(field_, w) <= cut.level) != left; });
      parts[meets ? 2 : left ? 0 : 1].push_back(v);
    }
    auto to = vertices_.begin() + begin;
    for (const auto& part : parts) to = std::copy(part.begin(), part.end(), to);
    const int first = begin + int(parts[0].size()), second = first + int(parts[1].size());
    for (int i = second; i < end; ++i) piece_[std::size_t(at(vertices_, i))] = 0;
    waiting_.emplace_back(begin, first);
    waiting_.emplace_back(first, second);
  }

  const Graph& g_;
  std::vector<int> vertices_, piece_, field_, queue_;
  std::array<std::vector<int>, sources> distance_;
  std::vector<int> count_, under_, over_;
  std::vector<std::pair<int, int>> waiting_;
  int pieces_ = 0, lowest_ = 0, highest_ = 0;
};

}  // namespace

std::vector<int> nested_dissection(const Graph& graph) { return Dissection(graph).order(); }

}  // namespace bromwich
