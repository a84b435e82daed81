#pragma once
// March over a dyadic tree of steps, each as long as the solution allows.
//
// Cells between the rows of a result are divided at breakpoints (core/certificate/parts.hpp), and a part in halves
// until one step over it and two over its halves agree:
//
//     |one step - two halves| <= local tolerance:   the part is a leaf, and the march goes on from the two halves.
//
// Lengths are those of the tree, h 2^-k, so that few exponentials or factors occur. The same leaves with one step each
// are a second solution of twice the step: its difference is an estimate of the error of the whole march.

#include "../certificate/parts.hpp"

#include <functional>
#include <optional>
#include <vector>

namespace bromwich {

/// A solution at one time.
struct TreeRow {
  Vector x, y;
  Vector integral;     ///< of y over [0, t]
  Vector apart = {};   ///< of x, between two methods in the step that ends here; empty: it was not looked at
  Vector missed = {};  ///< of the integral of y: what switches between two stages may make; likewise
};

/// Rows at some times.
struct TreeRows {
  RowMatrix x, y, integral;
};

/// A part as short as that is not divided.
inline bool is_shortest(const Part& p) { return p.end - p.begin < 1.5 * shortest_part; }

class TreeMarch {
 public:
  /// From one row over a part to the next. False: no solution.
  using Take = std::function<bool(const Part&, const TreeRow& from, TreeRow& to)>;
  /// Of the local tolerance: one step against two.
  using Measure = std::function<double(const TreeRow& one, const TreeRow& two)>;

  /// Cells of [0, T] of equal length, divided at breakpoints. `times`: of the rows, increasing, from 0 to T. `most`:
  /// leaves. `exact`: what lies between breakpoints has lengths of its own; otherwise these are moved by up to 2^-17 of
  /// a cell, so that all lengths are those of one tree.
  TreeMarch(double T, Index cells, const std::vector<double>& breakpoints, const Vector& times, bool exact,
            TreeRow start, Take, std::size_t most);

  /// Divides the leaves where they do not meet the local tolerance. The rows are those of halved leaves; nothing if a
  /// shortest part has no solution or there are too many.
  std::optional<TreeRows> refine(const Measure&);
  /// One step over each leaf.
  std::optional<TreeRows> coarse();

  const std::vector<Part>& leaves() const { return leaves_; }
  const Vector& times() const { return times_; }

 private:
  bool pass(const Part&, const TreeRow& from, std::optional<TreeRow> whole, const Measure&, TreeRow& to);
  bool take(const Part&, const TreeRow& from, TreeRow& to);
  std::optional<TreeRows> along(const std::vector<Part>&, const std::function<bool(const Part&, TreeRow&)>& step);

  Vector times_;
  double same_time_;
  TreeRow start_;
  Take take_;
  std::size_t most_;
  std::vector<Part> leaves_;
  Index steps_ = 0;
};

}  // namespace bromwich
