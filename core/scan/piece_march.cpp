#include "core/scan/piece_march.hpp"

#include "core/base/timer.hpp"

#include <algorithm>
#include <map>

namespace bromwich {

namespace {

class PieceIteration {
 public:
  PieceIteration(PieceMarchProblem& problem, const ScanPlan& plan, const SharedStop& stop)
      : problem_(problem), plan_(plan), stop_(stop) {
    for (std::size_t k = 0; k < problem.problems.size(); ++k)
      pieces_.push_back(std::make_unique<SolutionPieces>(problem.problems[k], problem.steps.steps[k]));
  }

  PieceMarch run() {
    PieceMarch result;
    const Index J = problem_.steps.rows() - 1;
    result.report.chunks = chunks(J);
    if (J > 4 * first_steps && !look_at_first_steps()) return result;
    auto march = make();
    if (!march) return result;
    Timer timer;
    for (const auto& [kind, piece] : found_) march->add(kind, piece);
    march->begin(result.report.chunks);
    if (solves(*march, result.report)) result.march = std::move(march);
    result.report.by_pieces = true;
    result.report.seconds = timer.lap();
    return result;
  }

 private:
  Index chunks(Index J) const {
    if (plan_.chunks > 0 || !plan_.device) return chunks_of(plan_, J);
    return std::clamp<Index>(J / steps_of_chunk, 1, most_chunks);
  }

  std::unique_ptr<ChunkMarch> make() const {
    if (plan_.device) return plan_.device->chunk_march(problem_.steps);
    return chunk_march_on_host(*plan_.threads, problem_.steps);
  }

  // The pieces of the first steps, by one thread.
  bool look_at_first_steps() {
    RowMatrix all = std::move(problem_.steps.sources);
    ChunkMarchProblem first = problem_.steps;
    problem_.steps.sources = std::move(all);
    first.sources = problem_.steps.sources.topRows(first_steps + 1);
    const HostThreads one;
    const auto march = chunk_march_on_host(one, first);
    march->begin(1);
    return marches(*march);
  }

  // One pass, with new pieces until no step is outside all of them.
  bool marches(ChunkMarch& march) {
    const auto earlier = [](const ChunkMiss& a, const ChunkMiss& b) { return a.row < b.row; };
    std::vector<ChunkMiss> misses = march.pass(false);
    for (Index round = 0; !misses.empty(); ++round) {
      if (round == most_rounds || stop_()) return false;
      for (const auto& pieces : pieces_) pieces->settle();
      std::sort(misses.begin(), misses.end(), earlier);  // the pieces do not depend on the threads
      for (const ChunkMiss& miss : misses) {
        SolutionPieces& pieces = *pieces_[std::size_t(miss.kind)];
        const auto piece = pieces.at(miss.q);
        if (piece) {
          if (++count_[miss.kind] > ChunkMarch::most_pieces) return false;
          found_.emplace_back(miss.kind, *piece);
          march.add(miss.kind, *piece);
        } else if (pieces.failed()) {
          return false;
        }
      }
      misses = march.pass(true);
    }
    return true;
  }

  bool solves(ChunkMarch& march, ScanReport& report) {
    std::vector<Index> left;
    for (;;) {
      if (stop_() || !marches(march)) return false;
      ++report.passes;
      const ChunkCorrection c = march.correct();
      report.history.push_back(c.largest);
      left.push_back(c.open);
      if (c.open == 0) return c.finite;
      if (leads_nowhere(left, report.history)) return false;
    }
  }

  // As Scan::leads_nowhere.
  static bool leads_nowhere(const std::vector<Index>& left, const std::vector<double>& history) {
    if (Index(left.size()) <= looks_back) return false;
    if (Index(left.size()) >= most_passes) return true;
    const auto before = left.size() - 1 - std::size_t(looks_back);
    return 4 * left.back() > 3 * left[before] && history.back() > history[before] / 2;
  }

  static constexpr Index most_rounds = 64;      ///< of new pieces, in a pass
  static constexpr Index first_steps = 2048;    ///< whose pieces are known before the first pass
  static constexpr Index steps_of_chunk = 128;  ///< on a device
  static constexpr Index most_chunks = 32768;   ///< on a device
  static constexpr Index most_passes = 64, looks_back = 4;

  PieceMarchProblem& problem_;
  const ScanPlan& plan_;
  const SharedStop& stop_;
  std::vector<std::unique_ptr<SolutionPieces>> pieces_;
  std::vector<std::pair<Index, ChunkPiece>> found_;
  std::map<Index, Index> count_;
};

}  // namespace

PieceMarch march_by_pieces(PieceMarchProblem given, const ScanPlan& plan, const SharedStop& stop) {
  if (!fits_chunk_march(given.steps)) return {};
  auto problem = std::make_unique<PieceMarchProblem>(std::move(given));
  PieceMarch march = PieceIteration(*problem, plan, stop).run();
  march.problem = std::move(problem);
  return march;
}

}  // namespace bromwich
