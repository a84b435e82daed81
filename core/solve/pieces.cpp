#include "core/solve/pieces.hpp"

#include "core/accuracy/interior_check.hpp"
#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/separable.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace bromwich {

namespace {

constexpr double accepted_in_pieces = 0.8;          ///< of the goal
constexpr double divided_above = 0.25;              ///< of the goal
constexpr double negligible_between_pieces = 0.05;  ///< of the goal: need not fall any more
constexpr double least_fall = 1.414214;             ///< of the difference when all steps are halved: order 1/2
constexpr int most_rounds = 20;
constexpr int most_levels = 20;
constexpr int most_at_once = 3;  ///< levels

struct Piece {
  Index first, last;  ///< cells first .. last-1
  int level;
};

std::vector<Piece> pieces_of(const std::vector<int>& levels) {
  std::vector<Piece> pieces;
  for (Index k = 0; k < Index(levels.size()); ++k) {
    const int level = levels[std::size_t(k)];
    if (pieces.empty() || pieces.back().level != level) pieces.push_back({k, k, level});
    pieces.back().last = k + 1;
  }
  return pieces;
}

Index steps_of(const std::vector<int>& levels) {
  Index steps = 0;
  for (const int level : levels) steps += Index(1) << level;
  return steps;
}

// What the pieces have in common, and what is the largest or the sum.
void add(const Result& part, Result& whole) {
  whole.residual = std::isnan(whole.residual) ? part.residual : std::max(whole.residual, part.residual);
  whole.kernel_error =
      std::isnan(whole.kernel_error) ? part.kernel_error : std::max(whole.kernel_error, part.kernel_error);
  whole.magnification = std::isnan(whole.magnification)
                            ? part.magnification
                            : std::max(whole.magnification, 1.0) * std::max(part.magnification, 1.0);
  whole.rounding += part.rounding;
  whole.rounding_of_y = std::max(whole.rounding_of_y, part.rounding_of_y);
  whole.unresolved_sources = std::max(whole.unresolved_sources, part.unresolved_sources);
  whole.jumps_inside = whole.jumps_inside || part.jumps_inside;
  whole.rough_steps += part.rough_steps;
  whole.well_posed = whole.well_posed && part.well_posed;
  whole.lcp += part.lcp;
  whole.seconds = whole.seconds + part.seconds;
  whole.bytes = std::max(whole.bytes, part.bytes);
  whole.bytes_predicted = std::max(whole.bytes_predicted, part.bytes_predicted);
  whole.iterations = part.iterations;
  if (!part.warning.empty()) add_warning(whole, part.warning);
}

// The rows of the cells of a piece.
void place(const Result& part, const Piece& piece, const std::vector<Index>& components, Result& whole) {
  const Index stride = Index(1) << piece.level, count = piece.last - piece.first + 1;
  const auto rows = Eigen::seqN(Index(0), count, stride);
  const Index from = piece.first == 0 ? 0 : 1;  // what a piece begins with the one before has ended with
  const auto put = [&](const RowMatrix& values, RowMatrix& all) {
    if (values.cols() == all.cols()) all.middleRows(piece.first + from, count - from) = values.bottomRows(count - from);
  };
  put(part.y(rows, Eigen::all), whole.y);
  put(part.x(rows, components), whole.x);
  if (part.trace.size() > 0) put(part.trace(rows, Eigen::all), whole.trace);
  RowMatrix integral = integral_of_y(part)(rows, Eigen::all);
  if (piece.first > 0) integral.rowwise() += whole.y_integral.row(piece.first).eval();
  put(integral, whole.y_integral);
}

Result empty_cells(const Scene& scene, const Backend& backend, const InnerOptions& options, Index cells) {
  Result whole;
  whole.method = Method::march;
  whole.backend = backend.name();
  whole.status = Status::solved;
  whole.continuous = false;
  whole.steps = cells;
  whole.t = time_grid(scene.T, cells);
  whole.x_components = recorded_components(scene, options);
  whole.y = whole.y_integral = RowMatrix::Constant(cells + 1, scene.constraints(), NAN);
  whole.x = RowMatrix::Constant(cells + 1, Index(whole.x_components.size()), NAN);
  if (options.trace) whole.trace = whole.y;
  return whole;
}

void end(const Result& part, double begin, Result& whole) {
  whole.status = part.status == Status::solved ? Status::unsupported : part.status;
  whole.reason = part.status == Status::solved ? "y is not linear between the points of a piece" : part.reason;
  if (part.infeasible_at) whole.infeasible_at = begin + *part.infeasible_at;
}

// What differences of y do not show, at the ends of cells.
RowMatrix hidden_errors(const Scene& scene, const Result& coarse, const Result& fine) {
  const Vector of_M = diagonal(scene.M);
  RowMatrix hidden = RowMatrix::Zero(fine.y.rows(), fine.y.cols());
  Vector g = Vector::Zero(of_M.size());
  for (Index k = 1; k < hidden.rows(); ++k) {
    if (scene.g) scene.g(fine.t[k], g);
    const Vector v = fine.trace.row(k).transpose(), y = fine.y.row(k).transpose();
    const Vector apart = (v - coarse.trace.row(k).transpose()).cwiseAbs();
    hidden.row(k) = hidden_error(of_M, coarse.y.row(k).transpose(), y, apart, v + multiply(scene.M, y) + g).transpose();
  }
  return hidden;
}

// Of the goal, at the end of each cell: e_1, e_2, ...
std::vector<double> piece_differences(const Scene& scene, const Result& coarse, const Result& fine,
                                      const PieceGoal& goal) {
  std::vector<double> e(std::size_t(fine.steps), 0);
  const auto take = [&](const RowMatrix& a, const RowMatrix& b, const Vector& size, double wanted) {
    if (wanted <= 0 || b.cols() == 0) return;
    for (Index k = 1; k < b.rows(); ++k)
      for (Index i = 0; i < b.cols(); ++i) {
        const double apart = std::abs(a(k, i) - b(k, i));
        double& worst = e[std::size_t(k - 1)];
        if (!(apart <= 0)) worst = std::max(worst, std::isfinite(apart) ? apart / (size[i] * wanted) : INFINITY);
      }
  };
  take(coarse.y, fine.y, goal.sizes.of_y(fine), goal.y);
  take(hidden_errors(scene, coarse, fine), RowMatrix::Zero(fine.y.rows(), fine.y.cols()), goal.sizes.of_y(fine),
       goal.y);
  take(coarse.x, fine.x, goal.sizes.of_x(fine), goal.x);
  return e;
}

double largest_of(const std::vector<double>& e) { return *std::max_element(e.begin(), e.end()); }

// Of second order a level takes a factor of 4.
int levels_to_add(double e) {
  if (!(e > divided_above)) return 0;
  return std::isfinite(e) ? std::clamp(int(std::ceil(std::log2(e / divided_above) / 2)), 1, most_at_once) : 1;
}

class PieceRefinement {
 public:
  PieceRefinement(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve, Index cells,
                  const PieceGoal& goal)
      : scene_(scene),
        backend_(backend),
        options_(options),
        solve_(solve),
        goal_(goal),
        levels_(std::size_t(cells), 0) {}

  std::optional<Result> run() {
    for (int round = 0; round < most_rounds; ++round) {
      const auto coarse = on(levels_);
      const auto fine = coarse ? on(halved(levels_)) : std::nullopt;
      if (!fine) return std::nullopt;
      const std::vector<double> e = piece_differences(scene_, *coarse, *fine, goal_);
      note(options_.log, LogLevel::debug, "pieces of %ld steps: %.2g of the tolerance", long(steps_of(levels_)),
           largest_of(e));
      if (largest_of(e) <= accepted_in_pieces) {
        auto result = confirmed(*fine, largest_of(e));
        if (result) return result;
      }
      bool divided = false;
      for (std::size_t k = 0; k < levels_.size(); ++k) {
        const int more = largest_of(e) <= accepted_in_pieces ? 1 : levels_to_add(e[k]);
        levels_[k] += more;
        divided = divided || more > 0;
        if (levels_[k] > most_levels) return std::nullopt;
      }
      if (!divided) return std::nullopt;
    }
    return std::nullopt;
  }

 private:
  static std::vector<int> halved(std::vector<int> levels) {
    for (int& level : levels) ++level;
    return levels;
  }

  std::optional<Result> on(const std::vector<int>& levels) {
    const Index steps = steps_of(levels);
    if (steps > goal_.most_steps || (goal_.most_seconds > 0 && elapsed_ > goal_.most_seconds)) return std::nullopt;
    grids_.push_back(steps);
    InnerOptions with_trace = options_;
    with_trace.trace = true;
    Result result = solve_in_pieces(scene_, backend_, with_trace, solve_, levels);
    elapsed_ += clock_.lap();
    spent_ = spent_ + result.seconds;
    if (result.status != Status::solved) return std::nullopt;
    return result;
  }

  // All steps halved once more.
  std::optional<Result> confirmed(const Result& fine, double before) {
    auto finest = on(halved(halved(levels_)));
    if (!finest) return std::nullopt;
    const double last = largest_of(piece_differences(scene_, fine, *finest, goal_));
    if (!(last <= negligible_between_pieces) && !(last * least_fall <= before)) return std::nullopt;
    const double ratio = last > 0 ? std::clamp(before / last, least_fall, 2.0) : 2;
    const double error = last / (ratio - 1);
    if (!(error <= accepted_in_pieces)) return std::nullopt;
    report(error, std::log2(ratio), *finest);
    if (!options_.trace) finest->trace.resize(0, 0);
    return finest;
  }

  void report(double error, double order, Result& result) const {
    const double smallest = goal_.y > 0 && goal_.x > 0 ? std::min(goal_.y, goal_.x) : std::max(goal_.y, goal_.x);
    ErrorEstimate e;
    e.discretisation = error * smallest;
    e.states = goal_.x > 0 && result.x.cols() > 0 ? error * goal_.x : NAN;
    e.tolerance = smallest;
    e.order = order;
    e.grids = grids_;
    e.estimates.assign(grids_.size(), NAN);
    e.estimates.back() = e.discretisation;
    result.errors = e;
    result.error_estimate = e.discretisation;
    result.seconds = spent_;
    const auto [least, most] = std::minmax_element(levels_.begin(), levels_.end());
    result.kernel += text("; %ld steps in pieces, of T/%ld to T/%ld", long(grids_.back()),
                          long(result.steps << (*least + 2)), long(result.steps << (*most + 2)));
  }

  const Scene& scene_;
  Backend& backend_;
  const InnerOptions& options_;
  const Solve& solve_;
  const PieceGoal& goal_;
  std::vector<int> levels_;
  std::vector<Index> grids_;  ///< steps of all grids
  Seconds spent_;
  Timer clock_;
  double elapsed_ = 0;
};

}  // namespace

std::string unsuited_to_pieces(const Scene& scene) {
  if (!scene.dynamics->small_state()) return "the state is not stepped as a whole";
  if (scene.boundary) return "the scene has boundary values";
  if (!scene.free_rows.empty()) return "the scene has free rows";
  const LcpClass c = known_class(scene.M, scene.lcp_class);
  return has_one_solution(c) ? "" : "M is not known to be of class P";
}

Result solve_in_pieces(const Scene& scene, Backend& backend, const InnerOptions& options, const Solve& solve,
                       const std::vector<int>& levels) {
  const Index cells = Index(levels.size());
  Result whole = empty_cells(scene, backend, options, cells);
  InnerOptions one = options;
  one.method = Method::march;
  one.states = StateSelection::all;
  one.prepared = {};  // the scenes of pieces do not come back
  one.progress = {};
  one.tuning.first_iterate = nullptr;
  one.tolerance = one.tolerance_x = one.tolerance_y = one.absolute_tolerance = 0;
  one.compares_grids = true;
  one.fall_back_to_euler = false;
  one.look_inside_every_step = true;
  Vector x = scene.x0;
  for (const Piece& piece : pieces_of(levels)) {
    const double begin = whole.t[piece.first], length = whole.t[piece.last] - begin;
    one.steps = (piece.last - piece.first) << piece.level;
    // All pieces have exactly the same steps, which share their exponentials.
    Scene part = part_of(scene, begin, length, x);
    part.T = scene.T / double(cells) * double(piece.last - piece.first);
    part.exact = {};
    const Result solved = solve(part, backend, one);
    add(solved, whole);
    if (solved.status != Status::solved || !solved.continuous || solved.method != Method::march) {
      end(solved, begin, whole);
      return whole;
    }
    place(solved, piece, whole.x_components, whole);
    x = solved.x.row(solved.steps).transpose();
    if (piece.first == 0) whole.kernel = solved.kernel;
  }
  return whole;
}

std::optional<Result> refine_pieces(const Scene& scene, Backend& backend, const InnerOptions& options,
                                    const Solve& solve, Index cells, const PieceGoal& goal) {
  return PieceRefinement(scene, backend, options, solve, cells, goal).run();
}

}  // namespace bromwich
