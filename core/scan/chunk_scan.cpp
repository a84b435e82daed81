#include "core/scan/chunk_scan.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index chunks_per_thread = 4;              ///< chunks that settle early leave threads idle
constexpr Index fewest_steps = 32;                  ///< of a chunk: a correction costs about as much as a few steps
constexpr Index looks_back = 4;                     ///< passes that are compared to see whether they lead anywhere
constexpr Index most_passes = 64;                   ///< the work of as many threads as gain nothing then
constexpr double rounding_of_steps = 64 * epsilon;  ///< of a state behind one step; that of L steps grows as L^(1/2)
constexpr double near_solution = 1e-8;  ///< relative: a delta larger than that is none of rounding, whatever the sets
constexpr double least_size = 1e-6;     ///< of the largest component, as which a smaller one counts

class Scan {
 public:
  Scan(Chunks& chunks, std::vector<Vector> starts, Index longest, const HostThreads& threads, const SharedStop& stop)
      : chunks_(chunks),
        threads_(threads),
        stop_(stop),
        rounding_(rounding_of_steps * std::sqrt(double(longest))),
        s_(std::move(starts)),
        ends_(s_.size()) {
    report_.chunks = Index(s_.size());
    delta_.assign(s_.size(), Vector::Zero(s_.front().size()));
    same_.assign(s_.size(), false);
    for (Index c = 0; c < report_.chunks; ++c) open_.push_back(c);
  }

  ScanReport run() {
    while (!open_.empty() && report_.stopped < 0 && !report_.interrupted) {
      if (leads_nowhere()) {
        in_turn();
        break;
      }
      pass();
      if (!report_.interrupted) correct();
    }
    return std::move(report_);
  }

 private:
  // Marches the chunks that have not settled.
  void pass() {
    share_each(threads_, Index(open_.size()), [&](Index k) {
      const Index c = open_[std::size_t(k)];
      ChunkEnd end = chunks_.march(c, s_[std::size_t(c)], true);
      same_[std::size_t(c)] = end.complete && report_.passes > 0 && end.sets == ends_[std::size_t(c)].sets;
      ends_[std::size_t(c)] = std::move(end);
    });
    ++report_.passes;
    report_.interrupted = stop_();
  }

  // delta by the scan; the chunks that have not settled are corrected.
  void correct() {
    const Index C = report_.chunks;
    std::vector<Index> open;
    bool affine = true;  // all steps so far, in two passes
    bool known = true;   // the end of the chunk before
    double largest = 0;
    std::vector<char> was_open(std::size_t(C), 0);
    for (const Index c : open_) was_open[std::size_t(c)] = 1;
    size_ = Vector::Zero(s_.front().size());
    for (Index c = 0; c < C; ++c) {
      const ChunkEnd& end = ends_[std::size_t(c)];
      size_ = size_.cwiseMax((s_[std::size_t(c)] + delta_[std::size_t(c)]).cwiseAbs());
      const double change = relative(delta_[std::size_t(c)]);
      const bool settled = known && (change <= rounding_ || (affine && change <= near_solution));
      if (settled && open.empty() && !end.complete) {
        report_.stopped = c;
        break;
      }
      if (!settled && std::isfinite(change)) largest = std::max(largest, change);
      if (chunks_.hand_over(c) || !settled || !end.complete) open.push_back(c);
      if (settled) delta_[std::size_t(c)].setZero();
      affine = affine && end.complete && (same_[std::size_t(c)] || !was_open[std::size_t(c)]);
      if (is_known(end)) size_ = size_.cwiseMax(end.size);
      known = is_known(end);
      if (c + 1 < C) propagate(c);
    }
    for (const Index c : open) s_[std::size_t(c)] += delta_[std::size_t(c)];
    report_.history.push_back(largest);
    left_.push_back(Index(open.size()));
    open_ = std::move(open);
  }

  static bool is_known(const ChunkEnd& end) { return end.complete && end.s.allFinite() && end.size.allFinite(); }

  void propagate(Index c) {
    const ChunkEnd& end = ends_[std::size_t(c)];
    Vector& next = delta_[std::size_t(c) + 1];
    next.setZero();
    if (!is_known(end)) return;  // nothing is known of the next state
    next = end.s - s_[std::size_t(c) + 1];
    const Vector carried = end.D * delta_[std::size_t(c)];
    if ((s_[std::size_t(c) + 1] + next + carried).allFinite()) next += carried;
  }

  // To the sizes of the states before.
  double relative(const Vector& delta) const {
    if (delta.size() == 0) return 0;
    const double least = std::max(least_size * size_.maxCoeff(), 1e-290);
    return delta.cwiseQuotient(size_.cwiseMax(least)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
  }

  // The passes neither settle chunks, beyond the one of the front, nor bring the states closer.
  bool leads_nowhere() const {
    if (Index(left_.size()) <= looks_back) return false;
    if (Index(left_.size()) >= most_passes) return true;
    const auto before = left_.size() - 1 - std::size_t(looks_back);
    const bool settles = 4 * left_.back() <= 3 * left_[before];
    const bool closer = report_.history.back() <= report_.history[before] / 2;
    return !settles && !closer;
  }

  // From the front on, one chunk after another.
  void in_turn() {
    std::vector<char> open(s_.size(), 0);
    for (const Index c : open_) open[std::size_t(c)] = 1;
    size_ = Vector::Zero(s_.front().size());
    for (Index c = 0; c < report_.chunks && !report_.interrupted; ++c) {
      const std::size_t i = std::size_t(c);
      size_ = size_.cwiseMax(s_[i].cwiseAbs());
      if (c > 0) size_ = size_.cwiseMax(ends_[i - 1].size);
      if (c < open_.front()) continue;
      if (c > 0 && !(relative(ends_[i - 1].s - s_[i]) <= rounding_)) {
        s_[i] = ends_[i - 1].s;
        open[i] = 1;
      }
      if (!chunks_.hand_over(c) && open[i] == 0) continue;
      ends_[i] = chunks_.march(c, s_[i], false);
      ++report_.in_turn;
      report_.interrupted = stop_();
      if (ends_[i].complete || report_.interrupted) continue;
      report_.stopped = c;
      return;
    }
  }

  Chunks& chunks_;
  const HostThreads& threads_;
  const SharedStop& stop_;
  const double rounding_;
  std::vector<Vector> s_, delta_;
  std::vector<ChunkEnd> ends_;
  std::vector<char> same_;   ///< the chunk had the same active sets in its last two passes
  std::vector<Index> open_;  ///< chunks that have not settled
  std::vector<Index> left_;  ///< their number after each pass
  Vector size_;              ///< of the components of the states, up to the chunk that is looked at
  ScanReport report_;
};

}  // namespace

Index chunks_of(const ScanPlan& plan, Index steps) {
  const Index wanted =
      plan.chunks > 0 ? plan.chunks : std::min(chunks_per_thread * plan.threads->threads(), steps / fewest_steps);
  return std::clamp<Index>(wanted, 1, std::max<Index>(1, steps));
}

std::vector<Index> first_rows(Index chunks, Index steps) {
  std::vector<Index> rows;
  for (Index c = 0; c <= chunks; ++c) rows.push_back(c * steps / chunks);
  return rows;
}

ScanReport solve_chunks(Chunks& chunks, std::vector<Vector> starts, Index longest, const HostThreads& threads,
                        const SharedStop& stop) {
  return Scan(chunks, std::move(starts), longest, threads, stop).run();
}

}  // namespace bromwich
