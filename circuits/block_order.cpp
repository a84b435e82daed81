#include "circuits/block_order.hpp"

#include <algorithm>

namespace bromwich::circuits {

namespace {

constexpr Index none = -1;

// Equations matched to unknowns by augmenting paths, depth first with a look ahead (Duff, ACM Trans. Math. Softw. 7,
// 1981).
class Matching {
 public:
  explicit Matching(const Rows& P)
      : P_(P),
        equation_(std::size_t(P.cols()), none),
        visited_(std::size_t(P.rows()), none),
        looked_(std::size_t(P.rows())),
        next_(std::size_t(P.rows())) {
    for (Index i = 0; i < P.rows(); ++i) looked_[std::size_t(i)] = P.outerIndexPtr()[i];
  }

  /// The equation of each unknown, none where there is none.
  std::vector<Index> run() {
    for (Index i = 0; i < P_.rows(); ++i) augment(i);
    return std::move(equation_);
  }

 private:
  Index unknown(Index entry) const { return P_.innerIndexPtr()[entry]; }
  Index end(Index row) const { return P_.outerIndexPtr()[row + 1]; }

  void augment(Index first) {
    path_.clear();
    enter(first, none, first);
    while (!path_.empty()) {
      const Index row = path_.back().first;
      Index& look = looked_[std::size_t(row)];
      for (; look < end(row); ++look)
        if (equation_[std::size_t(unknown(look))] == none) return shift(unknown(look));
      Index& next = next_[std::size_t(row)];
      bool deeper = false;
      while (next < end(row) && !deeper) {
        const Index through = unknown(next++), other = equation_[std::size_t(through)];
        if (visited_[std::size_t(other)] == first) continue;
        enter(other, through, first);
        deeper = true;
      }
      if (!deeper) path_.pop_back();
    }
  }
  void enter(Index row, Index through, Index stamp) {
    visited_[std::size_t(row)] = stamp;
    next_[std::size_t(row)] = P_.outerIndexPtr()[row];
    path_.emplace_back(row, through);
  }
  // Every equation of the path takes the unknown through which the next one was entered, the last one a free one.
  void shift(Index free) {
    for (std::size_t k = path_.size(); k-- > 0;) {
      equation_[std::size_t(free)] = path_[k].first;
      free = path_[k].second;
    }
  }

  const Rows& P_;
  std::vector<Index> equation_, visited_, looked_, next_;
  std::vector<std::pair<Index, Index>>
      path_;  ///< an equation and the unknown, its own so far, through which it is entered
};

// Strong components of equations, where one depends on those of its other unknowns (Tarjan, SIAM J. Comput. 1, 1972).
class Components {
 public:
  Components(const Rows& P, const std::vector<Index>& equation)
      : P_(P), equation_(equation), number_(std::size_t(P.rows()), none), low_(number_), on_stack_(number_) {
    own_.resize(equation.size());
    for (std::size_t j = 0; j < equation.size(); ++j) own_[std::size_t(equation[j])] = Index(j);
  }

  std::vector<Block> run() {
    for (Index i = 0; i < P_.rows(); ++i)
      if (number_[std::size_t(i)] == none) visit(i);
    return std::move(blocks_);
  }

 private:
  void visit(Index first) {
    std::vector<std::pair<Index, Index>> calls;  // an equation and its next entry
    const auto enter = [&](Index row) {
      number_[std::size_t(row)] = low_[std::size_t(row)] = count_++;
      on_stack_[std::size_t(row)] = 1;
      stack_.push_back(row);
      calls.emplace_back(row, P_.outerIndexPtr()[row]);
    };
    enter(first);
    while (!calls.empty()) {
      auto& [row, entry] = calls.back();
      const std::size_t r = std::size_t(row);
      if (entry < P_.outerIndexPtr()[row + 1]) {
        const Index other = equation_[std::size_t(P_.innerIndexPtr()[entry++])];
        if (number_[std::size_t(other)] == none)
          enter(other);
        else if (on_stack_[std::size_t(other)] == 1)
          low_[r] = std::min(low_[r], number_[std::size_t(other)]);
        continue;
      }
      if (low_[r] == number_[r]) take_block(row);
      const Index done = low_[r];
      calls.pop_back();
      if (!calls.empty()) {
        Index& above = low_[std::size_t(calls.back().first)];
        above = std::min(above, done);
      }
    }
  }
  void take_block(Index root) {
    Block block;
    for (Index row = none; row != root;) {
      row = stack_.back();
      stack_.pop_back();
      on_stack_[std::size_t(row)] = 0;
      block.emplace_back(row, own_[std::size_t(row)]);
    }
    std::sort(block.begin(), block.end());
    blocks_.push_back(std::move(block));
  }

  const Rows& P_;
  const std::vector<Index>& equation_;
  std::vector<Index> number_, low_, on_stack_, own_, stack_;
  std::vector<Block> blocks_;
  Index count_ = 0;
};

}  // namespace

BlockOrder block_order(const Rows& given) {
  Rows P = given;
  P.prune(0.0, 0.0);
  P.makeCompressed();
  BlockOrder order;
  const std::vector<Index> equation = Matching(P).run();
  const auto free = std::find(equation.begin(), equation.end(), none);
  if (free != equation.end())
    order.unmatched = free - equation.begin();
  else
    order.blocks = Components(P, equation).run();
  return order;
}

}  // namespace bromwich::circuits
