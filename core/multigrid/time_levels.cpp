#include "core/multigrid/time_levels.hpp"

#include "core/iteration/forecast.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/discretise.hpp"
#include "core/multigrid/smoothing.hpp"

#include <unsupported/Eigen/FFT>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr double marched_kappa0 = 1;            ///< M + W_0 is P below it
constexpr double accurate_kappa0 = 0.1;         ///< of coarse grids that have to make up for what sweeps add
constexpr double smoothing_factor = 0.8;        ///< of a sweep on a grid that has a coarser one
constexpr std::size_t finest_grids = 2;         ///< that are smoothed well: their cycles are few and have to suffice
constexpr double wanted_factor = 0.1;           ///< of all sweeps of a cycle there
constexpr double wanted_below = 0.37;           ///< and on coarser grids
constexpr int most_sweeps = 8;                  ///< before a coarser grid is asked
constexpr double largest_smooth_factor = 1.01;  ///< at frequency 0: 1, and what a sample of it may miss
constexpr double easily_smoothed = 0.25;        ///< by a single sweep before
constexpr double easily_solved = 0.9;           ///< factor of a sweep at frequency 0: the coarsest grid needs few then
constexpr int few_coarsest_sweeps = 3, few_first_visits = 4;  ///< there, where it is not marched
constexpr int coarsest_sweeps = 5, first_visits = 3;          ///< elsewhere, at least
constexpr double symbol_over_w0 = 2.62;  ///< 1/sin(pi/8): of weights that fall monotonously, above pi/4
constexpr double most_unseen = 0.5;
constexpr Index most_unasked = 2048;  ///< steps of a march that is not interrupted on a device

// Where the weights and kernels of all grids come from.
class Source {
 public:
  Source(const DiscreteProblem& p, const SparseKernel* sparse, ConvolutionChoice choice)
      : p_(p), sparse_(sparse), choice_(choice) {
    by_fft_ = choice == ConvolutionChoice::fft ||
              (choice == ConvolutionChoice::automatic && p.dense() && !scan_is_cheaper(p));
    if (p.kronecker()) fit(*p.kronecker());
  }

  // Of the grid with `steps` steps, from a finer one or null.
  Weights weights(Index steps, const TimeLevel* finer) const {
    if (finer && !p_.dense()) {
      const auto halved = [this](const Weights& w) {
        return sparse_ ? Weights(coarsen(std::get<LagTable>(w)))
                       : Weights(Recurrence(coarsen(std::get<ModalRecurrence>(std::get<Recurrence>(w)))));
      };
      Weights w = halved(finer->weights);
      for (Index at = finer->steps / 2; at > steps; at /= 2) w = halved(w);
      return w;
    }
    if (sparse_) return sparse_->weights;
    const double h = p_.scene.T / double(steps);
    if (const DenseDynamics* d = p_.dense())
      return Recurrence(dense_recurrence(*d, step_operators(d->A, Rule::exponential, h, steps)));
    const KroneckerDynamics& d = *p_.kronecker();
    return Recurrence(fits_ ? compressed_recurrence(p_.backend, d, sum_, h)
                            : modal_recurrence(d, Rule::exponential, h, RowMatrix()));
  }

  // The kernel of the finest grid.
  KernelChoice finest(const TimeLevel& level) {
    if (p_.dense()) return make_kernel(p_, choice_);
    KernelChoice made{kernel(level), "", NAN};
    if (sparse_) {
      made.description = "FFT over lag weights; " + sparse_->description;
      made.error = sparse_->error;
      return made;
    }
    made.description = (by_fft_ ? "FFT over lag weights of " : "scan of ") +
                       (fits_ ? std::to_string(sum_.rates.size()) + " exponentials a mode, fitted to contour values"
                              : "all " + std::to_string(p_.kronecker()->across.points) + " eigenvalues a mode");
    if (!fits_) return made;
    made.error = sum_.error;
    const auto x0 = by_fft_ ? std::nullopt : kronecker_initial_sum(p_, sum_);
    if (!x0) return made;
    made.started = started(std::get<ModalRecurrence>(std::get<Recurrence>(level.weights)), x0->coefficients);
    if (made.started) made.error = std::max(made.error, x0->error);
    return made;
  }

  std::unique_ptr<SpaceTimeKernel> kernel(const TimeLevel& level) const {
    const Index rows = level.steps + 1, n = p_.scene.constraints();
    const auto* table = std::get_if<LagTable>(&level.weights);
    const auto* recurrence = std::get_if<Recurrence>(&level.weights);
    auto convolution = table     ? p_.backend.convolution(*table, rows)
                       : by_fft_ ? p_.backend.convolution(lag_table(*recurrence, level.steps), rows)
                                 : p_.backend.convolution(*recurrence, rows);
    return std::make_unique<SpaceTimeKernel>(p_.backend, std::move(convolution), p_.kronecker() != nullptr, rows, n);
  }

 private:
  // Of the finest grid: it serves all.
  void fit(const KroneckerDynamics& d) {
    sum_ = compress_line_kernel(d, p_.h, p_.scene.T);
    fits_ = sum_.error <= accepted_compression_error;
  }

  const DiscreteProblem& p_;
  const SparseKernel* sparse_;
  ConvolutionChoice choice_;
  bool by_fft_ = false, fits_ = false;
  ExponentialSum sum_;
};

// |S diag(w) S| 1. Products of sines are differences of cosines: entry (i, j) is c(i-j) - c(i+j) with
// c(d) = 1/(n+1) Σ_k w_k cos(pi k d/(n+1)), an even function of period 2(n+1).
Vector row_sums_in_modes(const Vector& w) {
  const Index n = w.size(), period = 2 * (n + 1);
  Vector padded = Vector::Zero(period);
  padded.segment(1, n) = w / double(n + 1);
  ComplexVector transformed;
  Eigen::FFT<double>().fwd(transformed, padded);
  Vector c(3 * n + 1);  // from -n to 2n
  for (Index d = -n; d <= 2 * n; ++d) c[n + d] = transformed[std::abs(d)].real();
  Vector sums(n);
  for (Index i = 1; i <= n; ++i)
    sums[i - 1] = (c.segment(n + 1 - i, n) - c.segment(n + 1 + i, n)).cwiseAbs().sum();  // c(j-i) - c(j+i), j = 1..n
  return sums;
}

// |W_0| 1
Vector first_row_sums(const Weights& weights) {
  if (const auto* table = std::get_if<LagTable>(&weights))
    return Eigen::Map<const RowMatrix>(table->W.row(0).data(), table->outputs, table->inputs)
        .cwiseAbs()
        .rowwise()
        .sum();
  const auto& recurrence = std::get<Recurrence>(weights);
  if (const auto* dense = std::get_if<DenseRecurrence>(&recurrence)) return dense->w0.cwiseAbs().rowwise().sum();
  return row_sums_in_modes(std::get<ModalRecurrence>(recurrence).w0);
}

// With the one behind the correction they multiply what a coarser grid cannot see by `wanted`.
int sweeps_before(double factor, double wanted, int fewest) {
  if (factor <= easily_smoothed) return 1;
  return std::clamp(int(std::ceil(std::log(wanted) / std::log(factor))) - 1, fewest, most_sweeps);
}

// What the next coarser grids may be.
struct Coarsening {
  double kappa0 = 0;  ///< that they may have, 0: none
  Index ratio = 2;    ///< of the steps, at most
};

// Chooses the sweeps of this grid.
//
// A sweep multiplies what is smooth in time by K/M, which may be far above 1; the coarse grid has to make up for that,
// so that there is but one sweep a cycle, and the coarse grids have to be accurate. Where the symbol is known and its
// size at frequency 0 is at most 1, there may be more of both.
Coarsening choose_sweeps(const DiscreteProblem& p, TimeLevel& level, double kappa0, std::size_t finer_grids) {
  const auto* recurrence = std::get_if<Recurrence>(&level.weights);
  const auto* modal = recurrence ? std::get_if<ModalRecurrence>(recurrence) : nullptr;
  const auto best = modal ? best_smoothing(p.scene.M, *modal, level.steps, far_smoothed) : std::nullopt;
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

void prepare_march(const DiscreteProblem& p, const Options& options, TimeLevel& level) {
  MarchProblem problem;
  problem.M = &p.scene.M;
  problem.lcp_class = p.lcp_class;
  problem.recurrence = std::get_if<Recurrence>(&level.weights);
  problem.lags = std::get_if<LagTable>(&level.weights);
  problem.r = level.r.get();
  const bool queues = p.backend.device().memory > 0;  // where nobody asks on the way
  if (!queues || level.steps > most_unasked) problem.interrupted = options.interrupted;
  level.march = p.backend.march(problem, level.steps + 1);
}

// Every R-th row of the tables.
DiscreteProblem on_grid(const DiscreteProblem& p, Index steps) {
  const Index ratio = p.J / steps;
  DiscreteProblem coarse{p.scene, p.backend, p.lcp_class, steps, p.scene.T / double(steps), {}, {}, {}, p.start};
  coarse.t = p.t(Eigen::seqN(0, steps + 1, ratio));
  coarse.g = p.g.rows(0, steps + 1, ratio);
  if (p.f.size() > 0) coarse.f = p.f.rows(0, steps + 1, ratio);
  if (p.defects) resolve_sources(coarse, false);
  return coarse;
}

// r_c = R r, and K_c phi in place of R K phi: the source piecewise linear on the coarse grid. The kernel of the finer
// grid has been applied to phi last.
void add_driven_difference(Backend& backend, TimeLevel& fine, TimeLevel& coarse) {
  backend.inject(*fine.v, *coarse.y);
  backend.add(*coarse.r, -1, *coarse.y, *coarse.r);
  coarse.kernel->apply_injected_modes(*fine.kernel, *coarse.v);
  backend.add(*coarse.r, 1, *coarse.v, *coarse.r);
  backend.add(*coarse.y, -1, *coarse.y, *coarse.y);
}

// r of all grids but the finest, from that, where the kernel of the finest was applied to phi last and v has the
// outcome.
void set_coarse_responses(const DiscreteProblem& p, const std::vector<TimeLevel*>& grids) {
  for (std::size_t l = 1; l < grids.size(); ++l) {
    p.backend.inject(*grids[l - 1]->r, *grids[l]->r);
    if (p.kronecker() && p.drive()) add_driven_difference(p.backend, *grids[l - 1], *grids[l]);
    if (p.dense() && p.f.size() > 0)
      p.backend.upload(dense_response(on_grid(p, grids[l]->steps), Rule::exponential), *grids[l]->r);
  }
}

// The same at any time.
void respond(const DiscreteProblem& p, const std::vector<TimeLevel*>& grids) {
  TimeLevel& finest = *grids[0];
  if (p.kronecker() && p.drive()) {
    upload(p.backend, *p.drive(), *finest.old);
    finest.kernel->apply(*finest.old, *finest.v, 0);
  }
  set_coarse_responses(p, grids);
}

}  // namespace

std::size_t TimeLevel::bytes() const {
  return r->bytes() + y->bytes() + v->bytes() + old->bytes() + (nested ? nested->bytes() : 0) + kernel->bytes() +
         (lcp ? lcp->bytes() : 0) + (march ? march->bytes() : 0);
}

LagTable coarsen(const LagTable& fine) {
  const Index last = (fine.W.rows() - 1) / 2, end = fine.W.rows() - 1;
  LagTable coarse{fine.outputs, fine.inputs, fine.modal, RowMatrix(last + 1, fine.W.cols()),
                  RowMatrix::Zero(last + 1, fine.W.cols())};
  coarse.W.row(0) = fine.W.row(0) + 0.5 * fine.W.row(1);
  for (Index d = 1; d <= last; ++d) {
    coarse.W.row(d) = 0.5 * fine.W.row(2 * d - 1) + fine.W.row(2 * d);
    if (2 * d < end) coarse.W.row(d) += 0.5 * fine.W.row(2 * d + 1);  // the last lag acts on y_0 alone, by S
    coarse.S.row(d) = fine.S.row(2 * d) + 0.5 * fine.W.row(2 * d - 1);
  }
  return coarse;
}

ModalRecurrence coarsen(const ModalRecurrence& fine) {
  ModalRecurrence coarse;
  const auto E = fine.decay.array(), C = fine.output.array();
  coarse.decay = E.square();
  coarse.output = 0.5 * C * (1 + E).square();
  coarse.start = (2 * E * fine.start.array() + 1) / (1 + E).square();
  coarse.w0 = fine.w0 + 0.5 * (fine.w1 + fine.output.colwise().sum().transpose());
  coarse.w1 = coarse.s1 = 0.5 * fine.w1;
  return coarse;
}

namespace {

// Weights of all grids there may be, with how they smooth and which they ask.
TimeLevels choose_grids(const DiscreteProblem& p, const Source& source) {
  TimeLevels levels;
  const Index fewest = p.backend.device().memory > 0 ? fewest_steps_on_device : fewest_steps;
  std::vector<Index> farthest;  // steps of the coarsest grid that each may ask
  Coarsening allowed{marched_kappa0};
  for (Index steps = p.J;;) {
    auto level = std::make_unique<TimeLevel>();
    level->steps = steps;
    level->weights = source.weights(steps, levels.size() > 0 ? levels.grids.back().get() : nullptr);
    const double kappa0 = instant_contraction(p.scene.M, p.lcp_class, first_row_sums(level->weights));
    if (!(kappa0 < allowed.kappa0)) break;
    allowed = choose_sweeps(p, *level, kappa0, levels.size());
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

TimeLevels time_levels(const DiscreteProblem& p, const SparseKernel* sparse, const Options& options) {
  Source source(p, sparse, options.convolution);
  TimeLevels levels = choose_grids(p, source);
  if (levels.size() == 0) return levels;
  KernelChoice finest = source.finest(levels[0]);
  levels.kernel_error = finest.error;
  levels.description = finest.description + "; grids of ";
  // Sweeps that smooth and do not enlarge what is smooth do, after a nested start, for what is left on the coarsest.
  const bool swept = levels.size() > 1 && levels.grids.back()->sweeps > 0;
  for (std::size_t l = 0; l < levels.size(); ++l) {
    TimeLevel& level = levels[l];
    if (l > 0) level.kernel = source.kernel(level);
    for (auto* array : {&level.r, &level.y, &level.v, &level.old})
      *array = p.backend.array(level.steps + 1, p.scene.constraints());
    if (l == 1 || l == 2) level.nested = p.backend.array(level.steps + 1, p.scene.constraints());
    if (l + 1 < levels.size() || swept)
      level.lcp = p.backend.shifted_lcp(p.scene.M, p.lcp_class, level.shift, level.steps + 1);
    levels.description += (l > 0 ? ", " : "") + std::to_string(level.steps);
  }
  levels.description += swept ? " steps" : " steps, the last marched";
  if (sparse)
    p.backend.upload(p.g.table() + sparse->free, *levels[0].r);
  else
    levels[0].r = make_response(p, finest, *levels[0].v);
  levels[0].kernel = std::move(finest.kernel);
  std::vector<TimeLevel*> grids;
  for (const auto& level : levels.grids) grids.push_back(level.get());
  levels.respond = [&p, grids] { respond(p, grids); };
  set_coarse_responses(p, grids);
  TimeLevel& coarsest = *levels.grids.back();
  levels.prepare_march = [&p, &options, &coarsest] { prepare_march(p, options, coarsest); };
  if (swept)
    coarsest.sweeps = coarsest.coarsest_sweeps;
  else
    levels.prepare_march();
  return levels;
}

}  // namespace bromwich
