#include "core/adapted/tree_march.hpp"

#include "core/base/interruption.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

namespace bromwich {

namespace {

constexpr double same_row = 1e-9;   ///< of a cell
constexpr double same_end = 1e-12;  ///< of T

std::vector<double> marks_of(const Vector& times) { return {times.data(), times.data() + times.size()}; }

// From a to b, beginning short behind a jump.
void add_interval(double a, double b, double length, bool jump, std::vector<Part>& parts) {
  for (double begin = 0; begin < 1;) {
    const double end = !jump ? 1 : begin == 0 ? shortest_part : 2 * begin;
    Part part;
    part.begin = begin;
    part.end = end;
    part.length = (end - begin) * length;
    part.from = a + begin * (b - a);
    part.to = end == 1 ? b : a + end * (b - a);
    parts.push_back(part);
    begin = end;
  }
}

// The intervals between the ends of cells, breakpoints and rows.
std::vector<Part> exact_parts(double T, Index cells, const std::vector<double>& breakpoints, const Vector& times) {
  enum Kind { cell, row, jump };
  std::map<double, Kind> ends;
  for (Index k = 0; k <= cells; ++k) ends[double(k) / double(cells) * T] = cell;
  const auto add = [&](double t, Kind kind) {
    const auto next = ends.lower_bound(t - same_end * T);
    if (next != ends.end() && next->first <= t + same_end * T)
      next->second = std::max(next->second, kind);
    else if (t > 0 && t < T)
      ends[t] = kind;
  };
  for (const double b : breakpoints) add(b, jump);
  for (const double t : times) add(t, row);
  ends.begin()->second = jump;  // x0 may be off the constraints
  std::vector<Part> parts;
  const double h = T / double(cells);
  for (auto a = ends.begin(), b = std::next(a); b != ends.end(); a = b++) {
    const double length = b->first - a->first;
    add_interval(a->first, b->first, std::abs(length - h) <= same_end * T ? h : length, a->second == jump, parts);
  }
  return parts;
}

}  // namespace

TreeMarch::TreeMarch(double T, Index cells, const std::vector<double>& breakpoints, const Vector& times, bool exact,
                     TreeRow start, Take take, std::size_t most)
    : times_(times),
      same_time_(same_row * T / double(cells)),
      start_(std::move(start)),
      take_(std::move(take)),
      most_(most),
      leaves_(exact ? exact_parts(T, cells, breakpoints, times)
                    : divide(Vector::LinSpaced(cells + 1, 0, T), breakpoints, 1, marks_of(times))) {}

bool TreeMarch::take(const Part& part, const TreeRow& from, TreeRow& to) {
  if (++steps_ % 64 == 0) check_interruption();
  return take_(part, from, to);
}

bool TreeMarch::pass(const Part& part, const TreeRow& from, std::optional<TreeRow> whole, const Measure& measure,
                     TreeRow& to) {
  if (leaves_.size() >= most_) return false;
  if (!whole && !take(part, from, whole.emplace())) whole.reset();
  const auto [first, second] = halves(part);
  TreeRow middle;
  const bool solved = take(first, from, middle) && take(second, middle, to);
  if (solved && whole && (is_shortest(part) || measure(*whole, to) <= 1)) {
    leaves_.push_back(part);
    return true;
  }
  if (is_shortest(part)) return false;
  TreeRow reached;
  return pass(first, from, solved ? std::optional(std::move(middle)) : std::nullopt, measure, reached) &&
         pass(second, reached, std::nullopt, measure, to);
}

std::optional<TreeRows> TreeMarch::along(const std::vector<Part>& parts,
                                         const std::function<bool(const Part&, TreeRow&)>& step) {
  TreeRows rows;
  rows.x.resize(times_.size(), start_.x.size());
  rows.y.resize(times_.size(), start_.y.size());
  rows.integral.resize(times_.size(), start_.y.size());
  TreeRow row = start_;
  Index next = 0;
  const auto put = [&](double t) {
    for (; next < times_.size() && times_[next] <= t + same_time_; ++next) {
      rows.x.row(next) = row.x.transpose();
      rows.y.row(next) = row.y.transpose();
      rows.integral.row(next) = row.integral.transpose();
    }
  };
  put(0);
  for (const Part& part : parts) {
    if (!step(part, row)) return std::nullopt;
    put(part.to);
  }
  return rows;
}

std::optional<TreeRows> TreeMarch::refine(const Measure& measure) {
  const std::vector<Part> parts = std::exchange(leaves_, {});
  return along(parts, [&](const Part& part, TreeRow& row) {
    const TreeRow from = std::exchange(row, {});
    return pass(part, from, std::nullopt, measure, row);
  });
}

std::optional<TreeRows> TreeMarch::coarse() {
  return along(leaves_, [&](const Part& part, TreeRow& row) {
    const TreeRow from = std::exchange(row, {});
    return take(part, from, row);
  });
}

}  // namespace bromwich
