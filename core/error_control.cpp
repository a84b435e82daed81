#include "core/error_control.hpp"

#include "core/certificate.hpp"
#include "core/error.hpp"
#include "core/text.hpp"
#include "core/timer.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double accepted = 0.8;              ///< of the tolerance
constexpr double algebraic_share = 0.1;       ///< of a grid's discretisation error, that cycles may leave
constexpr double lowest_order = 0.5;          ///< that an estimate is made with
constexpr Index fewest_steps = 16;            ///< of a first grid of our choice
constexpr Index most_steps = Index(1) << 20;  ///< of a further grid
constexpr Index patience = 4;                 ///< times the scene's steps: below, a failure is put down to the grid
constexpr double smallest_jump = 1e-4;        ///< differences below that stop falling are rounding, not jumps
constexpr double out_of_reach = 4;            ///< times most_steps, predicted with the full order

Index first_grid(const Scene& scene, const Options& options) {
  Index J = options.steps > 0 ? options.steps : scene.default_steps;
  while (options.steps == 0 && J % 2 == 0 && J / 2 >= fewest_steps) J /= 2;
  return J;
}

// max_j |coarse_j - fine_2j|, j >= 1, relative to max(1, max |fine|).
double difference(const RowMatrix& coarse, const RowMatrix& fine) {
  double largest = 0, size = 1;
  for (Index j = 1; j < coarse.rows() && coarse.cols() > 0; ++j) {
    const double apart = (coarse.row(j) - fine.row(2 * j)).cwiseAbs().maxCoeff<Eigen::PropagateNaN>();
    if (std::isnan(apart)) return INFINITY;  // states that the method cannot give
    largest = std::max(largest, apart);
    size = std::max(size, fine.row(2 * j).cwiseAbs().maxCoeff());
  }
  return largest / size;
}

// The units of the components differ: each is relative to its own size.
double difference_of_states(const RowMatrix& coarse, const RowMatrix& fine) {
  double largest = 0;
  for (Index c = 0; c < coarse.cols(); ++c) largest = std::max(largest, difference(coarse.col(c), fine.col(c)));
  return largest;
}

// y for half the step, linear between the rows there are.
RowMatrix refined(const RowMatrix& y) {
  RowMatrix fine(2 * y.rows() - 1, y.cols());
  for (Index j = 0; j < y.rows(); ++j) fine.row(2 * j) = y.row(j);
  for (Index j = 0; j + 1 < y.rows(); ++j) fine.row(2 * j + 1) = (y.row(j) + y.row(j + 1)) / 2;
  return fine;
}

// Where solutions are smooth: implicit Euler, continuous piecewise-linear y, Radau IIA.
double order_of(const Result& result) {
  return result.method == to_string(Method::euler) ? 1 : result.continuous ? 2 : 3;
}

bool may_jump(const Result& result) { return !result.continuous || result.method == to_string(Method::euler); }

// The differences of one sequence of grids that one method has solved.
struct Differences {
  explicit Differences(const Result& first) : y(order_of(first)), mean(1, 3), x(order_of(first)), x_with_jumps(1, 3) {}

  void add(const Result& coarse, const Result& fine) {
    y.add(difference(coarse.y, fine.y));
    mean.add(difference(running_integral(coarse.y, 1 / double(coarse.steps)),
                        running_integral(fine.y, 1 / double(fine.steps))));
    x.add(difference_of_states(coarse.x, fine.x));
    x_with_jumps.add(x.last());
  }

  GridDifferences y, mean, x, x_with_jumps;
  bool jumps = false;  ///< y does not converge at all time points
};

class Refinement {
 public:
  Refinement(const Scene& scene, Backend& backend, const Options& options)
      : scene_(scene), backend_(backend), options_(options), expected_(std::max(options.steps, scene.default_steps)) {}

  Result run() {
    for (Index J = first_grid(scene_, options_);; J *= 2) {
      if (!grids_.empty() && J > most_steps)
        return ended(text("more than %ld steps would be needed", long(most_steps)));
      Result next;
      try {
        next = solve_on(J);
      } catch (const Error& error) {  // the first grid says what is wrong with the input
        if (grids_.empty()) throw;
        return ended(std::string("the next grid is refused: ") + error.what());
      }
      grids_.push_back(J);
      if (next.status != Status::solved) {
        if (is_final(next)) return ended_by(next);
        failed_ = std::move(next);
        differences_.reset();
        continue;
      }
      take(next);
      if (const std::optional<std::string> end = verdict()) return ended(*end);
    }
  }

 private:
  Result solve_on(Index J) {
    Options one = options_;
    one.tolerance = 0;
    one.steps = J;
    one.algebraic_share = algebraic_share;
    RowMatrix start;
    if (solved_ && solved_->continuous && 2 * solved_->steps == J) {
      start = refined(solved_->y);
      one.first_iterate = &start;
    } else {
      one.first_iterate = grids_.empty() ? options_.first_iterate : nullptr;
    }
    Result result = solve(scene_, backend_, one);
    spent_ = spent_ + result.seconds;
    return result;
  }

  // Whether a grid that was not solved ends the search. On a coarse grid anything may go wrong.
  bool is_final(const Result& next) const {
    if (next.status == Status::interrupted || next.infeasible_at == 0.0) return true;
    if (next.status == Status::infeasible && failed_ && failed_->status == Status::infeasible &&
        std::abs(*failed_->infeasible_at - *next.infeasible_at) <= 2 * scene_.T / double(failed_->steps))
      return next.steps >= expected_;
    return next.steps >= (next.status == Status::unsupported ? 1 : patience) * expected_;
  }

  void take(Result& next) {
    const bool same = solved_ && solved_->method == next.method && solved_->continuous == next.continuous &&
                      2 * solved_->steps == next.steps;
    if (!same || !differences_) differences_.emplace(next);
    if (same) differences_->add(*solved_, next);
    solved_ = std::move(next);
    failed_.reset();
    estimate();
  }

  void estimate() {
    ErrorEstimate e;
    e.tolerance = options_.tolerance;
    const double largest = solved_->y.bottomRows(solved_->steps).cwiseAbs().maxCoeff();
    e.kernel = solved_->kernel_error * largest / std::max(1.0, largest);
    e.iteration = solved_->algebraic_error.value_or(iteration_error(solved_->history));
    e.rounding = solved_->rounding * largest / std::max(1.0, largest);
    Differences& d = *differences_;
    // Once is enough: later differences may be small because all jumps happen to be in the same steps.
    d.jumps = d.jumps ||
              (may_jump(*solved_) && solved_->steps >= expected_ && d.y.stands_still() && d.y.last() > smallest_jump);
    e.of_integral = d.jumps;
    const GridDifferences& y = e.of_integral ? d.mean : d.y;
    e.discretisation = y.error();
    e.order = y.order();
    if (controls_states()) e.states = (d.jumps ? d.x_with_jumps : d.x).error();
    e.grids = grids_;
    solved_->errors = e;
    solved_->error_estimate.reset();
    if (!std::isnan(e.discretisation)) solved_->error_estimate = std::max(e.total(), controls_states() ? e.states : 0);
  }

  bool controls_states() const { return options_.control_states && solved_->x.cols() > 0; }

  // Empty: the tolerance is met. Nothing: go on. Otherwise why it will not be met.
  std::optional<std::string> verdict() const {
    const ErrorEstimate& e = *solved_->errors;
    const GridDifferences& y = e.of_integral ? differences_->mean : differences_->y;
    const double goal = accepted * options_.tolerance;
    const std::size_t window = e.of_integral ? 3 : 2;
    const bool falls = !e.of_integral || !y.stands_still();
    if (y.confirmed() && falls && *solved_->error_estimate <= goal) return "";
    if (solved_->steps < patience * expected_) return std::nullopt;
    const double other = e.total() - (std::isnan(e.discretisation) ? 0 : e.discretisation);
    if (other > goal)
      return text(
          "the weights of the kernel are known to %.1e, the iteration leaves %.1e and rounding %.1e: no grid "
          "does better",
          e.kernel, e.iteration, e.rounding);
    if (!y.confirmed()) return std::nullopt;
    if (y.stalled(window) && e.total() > goal)
      return text("halving the step does not bring the solutions together any more: %s still moves by %.1e",
                  e.of_integral ? "the mean of y" : "y", y.last());
    if (controls_states() && differences_->x.stalled(window) && e.states > goal)
      return text("halving the step does not bring the states together any more: they still move by %.1e",
                  differences_->x.last());
    const double needed = double(solved_->steps) * std::exp2(y.halvings_to(goal - other));
    if (needed > out_of_reach * double(most_steps)) return text("about %.0e steps would be needed", needed);
    return std::nullopt;
  }

  // What a coarser grid has found stays, except where the scene has no solution.
  Result ended_by(Result& next) {
    if (!solved_ || next.status == Status::infeasible) return failed(next);
    const Status why = next.status == Status::interrupted ? next.status : Status::tolerance_not_met;
    return ended(text("with %ld steps: ", long(next.steps)) + next.reason, why);
  }

  Result failed(Result& next) {
    next.errors.emplace().grids = grids_;
    next.errors->tolerance = options_.tolerance;
    next.seconds = spent_;
    return std::move(next);
  }

  Result ended(const std::string& reason, Status status = Status::tolerance_not_met) {
    if (!solved_) return failed(*failed_);
    Result& result = *solved_;
    result.errors->grids = grids_;
    result.seconds = spent_;
    if (reason.empty()) return std::move(result);
    result.status = status;
    result.reason = result.error_estimate
                        ? text("the error is about %.1e with %ld steps, not %.1e: ", *result.error_estimate,
                               long(result.steps), options_.tolerance) +
                              reason
                        : "the error could not be estimated: " + reason;
    return std::move(result);
  }

  const Scene& scene_;
  Backend& backend_;
  const Options& options_;
  const Index expected_;  ///< steps with which the scene is meant to be solved
  std::vector<Index> grids_;
  std::optional<Result> solved_, failed_;  ///< the last grid of each kind; failed_ only if it is the last of all
  std::optional<Differences> differences_;
  Seconds spent_;
};

}  // namespace

double GridDifferences::counted(std::size_t k) const {
  double largest = 0;
  for (std::size_t i = 0; i <= std::min(k, memory_); ++i)
    largest = std::max(largest, differences_[k - i] * std::exp2(-highest_ * double(i)));
  return largest;
}

double GridDifferences::order_at(std::size_t k) const {
  if (counted(k) == 0) return highest_;
  return std::clamp(std::log2(counted(k - 1) / counted(k)), lowest_order, highest_);
}

double GridDifferences::order() const {
  const std::size_t n = differences_.size();
  if (n < 2) return NAN;
  return n == 2 ? order_at(1) : std::min(order_at(n - 1), order_at(n - 2));
}

double GridDifferences::error() const {
  return differences_.size() < 2 ? NAN : counted(differences_.size() - 1) / (std::exp2(order()) - 1);
}

bool GridDifferences::stands_still() const {
  const std::size_t n = differences_.size();
  return n >= 3 && counted(n - 1) > 0.5 * counted(n - 3);
}

bool GridDifferences::stalled(std::size_t window) const {
  if (differences_.size() < 2 * window) return false;
  const auto middle = differences_.end() - std::ptrdiff_t(window);
  return *std::min_element(middle, differences_.end()) >
         0.5 * *std::min_element(middle - std::ptrdiff_t(window), middle);
}

double GridDifferences::halvings_to(double tolerance) const {
  const double e = counted(differences_.size() - 1) / (std::exp2(highest_) - 1);
  return std::max(0.0, std::log2(e / tolerance) / highest_);
}

double iteration_error(const std::vector<double>& history) {
  const std::size_t n = history.size();
  if (n == 0 || history.back() == 0) return 0;
  constexpr double slowest = 0.99;
  const std::size_t sweeps = std::min<std::size_t>(4, n - 1);
  const double c =
      sweeps == 0 ? slowest : std::min(slowest, std::pow(history[n - 1] / history[n - 1 - sweeps], 1 / double(sweeps)));
  return history.back() * c / (1 - c);
}

Result solve_to_tolerance(const Scene& scene, Backend& backend, const Options& options) {
  return Refinement(scene, backend, options).run();
}

}  // namespace bromwich
