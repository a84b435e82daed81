#include "core/multigrid/time_levels.hpp"

#include "core/iteration/forecast.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/lcp/stencil.hpp"
#include "core/multigrid/smoothing.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double marched_kappa0 = 1;            ///< below it M + W_0 is P
constexpr double accurate_kappa0 = 0.1;         ///< of coarse grids that have to compensate amplification by sweeps
constexpr double smoothing_factor = 0.8;        ///< of a sweep on a grid that has a coarser one
constexpr std::size_t finest_grids = 2;         ///< with strong smoothing, since their cycles are few
constexpr double wanted_factor = 0.1;           ///< of all sweeps of a cycle there
constexpr double wanted_below = 0.37;           ///< and on coarser grids
constexpr int most_sweeps = 8;                  ///< before the coarse problem
constexpr double largest_smooth_factor = 1.01;  ///< at frequency 0: 1 plus the error of sampling
constexpr double easily_smoothed = 0.25;        ///< factor for which a single sweep before is enough
constexpr double easily_solved = 0.9;           ///< factor at frequency 0 for which the coarsest grid needs few sweeps
constexpr int few_coarsest_sweeps = 3, few_first_visits = 4;  ///< for these grids, if not marched
constexpr int coarsest_sweeps = 5, first_visits = 3;          ///< for others, at least
constexpr double symbol_over_w0 = 2.62;  ///< 1/sin(pi/8): bound for monotonically decreasing weights above pi/4
constexpr double most_unseen = 0.5;
constexpr int relaxation_sweeps = 2;  ///< in place of an exact solution; a third one gains nothing

// Sweeps before the coarse problem. Together with the one after the correction they reduce the error that a coarser
// grid does not represent by the factor `wanted`.
int sweeps_before(double factor, double wanted, int fewest) {
  if (factor <= easily_smoothed) return 1;
  return std::clamp(int(std::ceil(std::log(wanted) / std::log(factor))) - 1, fewest, most_sweeps);
}

// Requirements on the next coarser grids.
struct Coarsening {
  double kappa0 = 0;  ///< largest allowed value; 0: there are no coarser grids
  Index ratio = 2;    ///< largest ratio of the steps
};

// Chooses the sweeps of this grid.
//
// A sweep multiplies smooth errors by K/M, which may be far above 1. The coarse grid has to compensate for that, so
// there is only one sweep per cycle, and the coarse grids have to be accurate. If the symbol is known and its size at
// frequency 0 is at most 1, more sweeps and coarser grids are allowed.
Coarsening choose_sweeps(const SweptMatrix& M, TimeLevel& level, double kappa0, std::size_t finer_grids) {
  const ModalRecurrence* modal = modal_recurrence_of(*level.weights);
  const auto best = modal ? best_smoothing(M, *modal, level.steps, far_smoothed) : std::nullopt;
  level.unseen = std::min(symbol_over_w0 * kappa0, most_unseen);
  if (!best || best->smooth_factor > largest_smooth_factor) return {accurate_kappa0};
  const double factor = best->factor();
  level.shift = best->shift;
  const bool easy = best->smooth_factor < easily_solved;
  level.coarsest_sweeps =
      std::max(easy ? few_coarsest_sweeps : coarsest_sweeps, 1 + sweeps_before(factor, wanted_factor, 2));
  level.first_visits = easy ? few_first_visits : first_visits;
  level.sweeps =
      finer_grids < finest_grids ? sweeps_before(factor, wanted_factor, 2) : sweeps_before(factor, wanted_below, 1);
  if (finer_grids == 0) level.sweeps = std::max(level.sweeps, 2);
  const auto useful =
      std::count_if(best->unseen.begin(), best->unseen.end(), [](double f) { return f <= far_smoothed; });
  const std::size_t octaves = std::max<std::size_t>(1, std::size_t(useful));
  level.unseen = best->unseen[octaves - 1];
  return {factor < smoothing_factor ? marched_kappa0 : 0, Index(1) << octaves};
}

// Sweeps of projected relaxation where M is a stencil on a face, so that their relaxation is known; else exact
// solutions.
std::unique_ptr<LcpBatch> smoother(const DiscreteProblem& p, const SweptMatrix& M, TimeLevel& level) {
  if (!M.stencil || !sparse_of(p.scene.M) || level.sweeps == 0)
    return p.backend.shifted_lcp(p.scene.M, p.lcp_class, level.shift, level.steps + 1);
  level.passes = relaxation_sweeps;
  const ProjectedSweeps sweeps{sparse_of(p.scene.M), level.shift, best_relaxation(M.stencil->shifted(level.shift)),
                               relaxation_sweeps, M.stencil->extents};
  return p.backend.projected_sweeps(sweeps, p.lcp_class, level.steps + 1);
}

void prepare_march(const DiscreteProblem& p, const std::function<bool()>& interrupted, TimeLevel& level) {
  MarchProblem problem;
  problem.M = &p.scene.M;
  problem.lcp_class = p.lcp_class;
  problem.r = level.r.get();
  if (level.steps > p.backend.traits().unpolled_steps) problem.interrupted = interrupted;
  level.march = make_march(p.backend, problem, *level.weights, level.steps + 1);
}

// to <- K_c phi - R K phi: the source is piecewise linear on the coarse grid. Precondition: the kernel of the finer
// grid was applied to phi last.
void take_driven_difference(Backend& backend, TimeLevel& fine, TimeLevel& coarse, Array& to) {
  backend.inject(*fine.v, to);
  coarse.kernel->apply_injected_modes(*fine.kernel, *coarse.v);
  backend.add(*coarse.v, -1, to, to);
}

// r_c = R r and that difference.
void add_driven_difference(Backend& backend, TimeLevel& fine, TimeLevel& coarse) {
  take_driven_difference(backend, fine, coarse, *coarse.y);
  backend.add(*coarse.r, 1, *coarse.y, *coarse.r);
  backend.add(*coarse.y, -1, *coarse.y, *coarse.y);
}

// r of all grids below the finest, from r of the finest. Precondition: its kernel was applied to phi last, with the
// result in v.
void set_coarse_responses(TimeOperator& op, const std::vector<TimeLevel*>& grids) {
  Backend& backend = op.problem().backend;
  for (std::size_t l = 1; l < grids.size(); ++l) {
    backend.inject(*grids[l - 1]->r, *grids[l]->r);
    if (op.drive()) add_driven_difference(backend, *grids[l - 1], *grids[l]);
    if (const auto r = op.coarse_response(grids[l]->steps)) backend.upload(*r, *grids[l]->r);
  }
}

// The same without that precondition.
void respond(TimeOperator& op, const std::vector<TimeLevel*>& grids) {
  TimeLevel& finest = *grids[0];
  if (const SampledSource* phi = op.drive()) {
    upload(op.problem().backend, *phi, *finest.old);
    finest.kernel->apply(*finest.old, *finest.v, 0);
  }
  set_coarse_responses(op, grids);
}

// What f and g make of r, kept for other x0.
class KnownResponse {
 public:
  KnownResponse(TimeOperator& op, const KernelPlan& plan, const std::vector<TimeLevel*>& grids)
      : op_(op), backend_(op.problem().backend), plan_(plan), grids_(grids) {
    finest_ = backend_.array(grids[0]->r->rows(), grids[0]->r->cols());
    apart_.resize(grids.size());
  }

  // The error of x0 in r. Leaves y of the finest grid with anything.
  double take(const Changes& changes) {
    TimeLevel& finest = *grids_[0];
    if (changes.sources) take_sources();
    backend_.upload(op_.problem().start.transpose(), *finest_);  // row 0
    backend_.add(*finest_, -1, *finest_, *finest.y);
    const double error = op_.add_x0(plan_, *finest.y, *finest_, *finest.r);
    for (std::size_t l = 1; l < grids_.size(); ++l) {
      TimeLevel& coarse = *grids_[l];
      backend_.inject(*grids_[l - 1]->r, *coarse.r);
      if (apart_[l]) backend_.add(*coarse.r, 1, *apart_[l], *coarse.r);
    }
    return error;
  }

 private:
  void take_sources() {
    TimeLevel& finest = *grids_[0];
    op_.response_to_sources(plan_, *finest.y, *finest.v, *finest_);
    for (std::size_t l = 1; l < grids_.size(); ++l) {
      TimeLevel& coarse = *grids_[l];
      if (!op_.drive()) {
        apart_[l].reset();
        continue;
      }
      if (!apart_[l]) apart_[l] = backend_.array(coarse.r->rows(), coarse.r->cols());
      take_driven_difference(backend_, *grids_[l - 1], coarse, *apart_[l]);
    }
  }

  TimeOperator& op_;
  Backend& backend_;
  KernelPlan plan_;
  std::vector<TimeLevel*> grids_;
  std::unique_ptr<Array> finest_;
  std::vector<std::unique_ptr<Array>> apart_;  ///< of the coarser grids: K_c phi - R K phi
};

}  // namespace

std::size_t TimeLevel::bytes() const {
  return r->bytes() + y->bytes() + v->bytes() + old->bytes() + (nested ? nested->bytes() : 0) +
         (ends ? ends->bytes() : 0) + (first_v ? first_v->bytes() : 0) + kernel->bytes() +
         (matrix_change ? matrix_change->bytes() + matrix_term->bytes() : 0) + (lcp ? lcp->bytes() : 0) +
         (march ? march->bytes() : 0);
}

namespace {

// Weights of all possible grids, with their smoothing and the coarse grids that their cycles use.
TimeLevels choose_grids(TimeOperator& op, const SweptMatrix& M) {
  const DiscreteProblem& p = op.problem();
  const RangeOfM range = range_of_M(p);
  TimeLevels levels;
  const Index fewest = p.backend.traits().fewest_steps;
  std::vector<Index> farthest;  // steps of the coarsest grid that each may ask
  Coarsening allowed{marched_kappa0};
  for (Index steps = p.J;;) {
    auto level = std::make_unique<TimeLevel>();
    level->steps = steps;
    const TimeLevel* finer = levels.size() > 0 ? levels.grids.back().get() : nullptr;
    level->weights = op.weights(steps, finer ? finer->weights.get() : nullptr, finer ? finer->steps : 0);
    const ModalRecurrence* modal = modal_recurrence_of(*level->weights);
    const double kappa0 = modal && modal->face.size() > 1 && M.stencil
                              ? instant_contraction(M.eigenvalues, *modal)
                              : instant_contraction(p.scene.M, p.lcp_class, *level->weights, range);
    if (!(kappa0 < allowed.kappa0)) break;
    allowed = choose_sweeps(M, *level, kappa0, levels.size());
    const bool swept = level->sweeps > 0;
    levels.grids.push_back(std::move(level));
    farthest.push_back(steps / allowed.ratio);
    const Index enough = swept && levels.size() >= 3 ? enough_steps : fewest;
    const Index last = levels.size() < 3 ? steps / 2 : std::max(enough, farthest.back());
    if (steps % 2 != 0 || steps / 2 < enough) break;
    do steps /= 2;
    while (steps % 2 == 0 && steps / 2 >= last);
  }
  if (levels.size() == 1 && p.J > most_marched) levels.grids.clear();
  for (std::size_t l = 0; l + 1 < levels.size(); ++l) {
    levels[l].coarse = l + 1;
    for (std::size_t c = l + 2; c < levels.size() && levels[c].steps >= farthest[l]; ++c) levels[l].coarse = c;
  }
  return levels;
}

}  // namespace

TimeLevels time_levels(TimeOperator& op, const Options& options) {
  const DiscreteProblem& p = op.problem();
  const SweptMatrix M = p.modes() ? SweptMatrix(p.scene.M, p.face()) : SweptMatrix();
  TimeLevels levels = choose_grids(op, M);
  if (levels.size() == 0) return levels;
  levels.finest = op.finest_kernel(levels[0].weights, options.tuning.convolution);
  levels.description = levels.finest.description + "; grids of ";
  // After a nested start, sweeps are enough on the coarsest grid if they smooth and do not amplify smooth errors.
  const bool swept = levels.size() > 1 && levels.grids.back()->sweeps > 0;
  for (std::size_t l = 0; l < levels.size(); ++l) {
    TimeLevel& level = levels[l];
    level.kernel =
        l == 0 ? levels.finest.kernel : op.kernel_of(*level.weights, level.steps, options.tuning.convolution);
    for (auto* array : {&level.r, &level.y, &level.v, &level.old})
      *array = p.backend.array(level.steps + 1, p.scene.constraints());
    if (l == 1 || l == 2) level.nested = p.backend.array(level.steps + 1, p.scene.constraints());
    if (l + 1 < levels.size() || swept) level.lcp = smoother(p, M, level);
    levels.description += (l > 0 ? ", " : "") + std::to_string(level.steps);
  }
  for (std::size_t l = 0; l + 1 < levels.size(); ++l) {
    TimeLevel& coarse = levels[levels[l].coarse];
    levels[l].lazy = levels[l].sweeps > 0;
    if (levels[l].lazy && !coarse.first_v) coarse.first_v = p.backend.array(coarse.steps + 1, p.scene.constraints());
  }
  levels.description += swept ? " steps" : " steps, the last marched";
  std::vector<TimeLevel*> grids;
  for (const auto& level : levels.grids) grids.push_back(level.get());
  levels.respond = [&op, grids] { respond(op, grids); };
  std::shared_ptr<KnownResponse> known;
  if (op.keeps_prepared() && op.separates_x0()) known = std::make_shared<KnownResponse>(op, levels.finest, grids);
  levels.take_sources = [&op, grids, known, plan = levels.finest](const Changes& changes) {
    const double error = known ? known->take(changes) : op.response(plan, *grids[0]->v, *grids[0]->r);
    if (!known) set_coarse_responses(op, grids);
    return std::isnan(plan.error) ? NAN : std::max(plan.error, error);
  };
  levels.kernel_error = levels.take_sources({});
  TimeLevel& coarsest = *levels.grids.back();
  levels.prepare_march = [&p, interrupted = options.interrupted, &coarsest] {
    prepare_march(p, interrupted, coarsest);
  };
  if (swept)
    coarsest.sweeps = coarsest.coarsest_sweeps;
  else
    levels.prepare_march();
  return levels;
}

}  // namespace bromwich
