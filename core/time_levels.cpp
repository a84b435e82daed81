#include "core/time_levels.hpp"

#include "core/compression.hpp"
#include "core/forecast.hpp"
#include "core/smoothing.hpp"
#include "core/weight_check.hpp"

#include <cmath>

namespace bromwich {

namespace {

constexpr double largest_kappa0 = 0.5;

// Where the weights of every grid come from.
class Source {
 public:
  Source(const DiscreteProblem& p, const SparseKernel* sparse, ConvolutionChoice choice)
      : p_(p), sparse_(sparse), by_fft_(choice == ConvolutionChoice::fft) {
    if (sparse) {
      description = "FFT over lag weights; " + sparse->description;
      error = sparse->error;
    } else if (p.kronecker()) {
      fit(*p.kronecker());
    } else {
      by_fft_ = by_fft_ || (choice == ConvolutionChoice::automatic && !scan_is_cheaper(p));
    }
  }

  // Of the grid with `steps` steps; `finer` are the weights of that with twice as many, or null.
  std::variant<Recurrence, LagTable> weights(Index steps, const std::variant<Recurrence, LagTable>* finer) {
    if (sparse_) return finer ? coarsen(std::get<LagTable>(*finer)) : sparse_->weights;
    const double h = p_.scene.T / double(steps);
    if (const KroneckerDynamics* d = p_.kronecker())
      return Recurrence(fits_ ? compressed_recurrence(p_.backend, *d, sum_, h)
                              : modal_recurrence(*d, Rule::exponential, h, RowMatrix()));
    const DenseRecurrence r = dense_recurrence(*p_.dense(), Rule::exponential, h);
    if (!finer) describe(r);
    return Recurrence(r);
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

  std::string description;
  double error = NAN;

 private:
  // One fit on [h, T] serves all grids: the coarser ones begin later.
  void fit(const KroneckerDynamics& d) {
    sum_ = compress_line_kernel(d, p_.h, p_.scene.T);
    fits_ = sum_.error <= accepted_compression_error;
    if (fits_) error = sum_.error;
    description = (by_fft_ ? "FFT over lag weights of " : "scan of ") +
                  (fits_ ? std::to_string(sum_.rates.size()) + " exponentials a mode, fitted to contour values"
                         : "all " + std::to_string(d.across.points) + " eigenvalues a mode");
  }

  void describe(const DenseRecurrence& r) {
    const WeightCheck check = check_weights(p_, r, INFINITY);
    error = check.error;
    description = std::string(by_fft_ ? "FFT over lag weights" : "scan of the state") + "; matrix exponential" +
                  (check.against.empty() ? "" : ", checked against " + check.against);
  }

  const DiscreteProblem& p_;
  const SparseKernel* sparse_;
  bool by_fft_, fits_ = false;
  ExponentialSum sum_;
};

// W_0 as an n x n matrix.
Matrix first_weight(const std::variant<Recurrence, LagTable>& weights) {
  if (const auto* table = std::get_if<LagTable>(&weights))
    return Eigen::Map<const RowMatrix>(table->W.row(0).data(), table->outputs, table->inputs);
  const auto& recurrence = std::get<Recurrence>(weights);
  if (const auto* dense = std::get_if<DenseRecurrence>(&recurrence)) return dense->w0;
  const Vector& w0 = std::get<ModalRecurrence>(recurrence).w0;
  const Matrix S = sine_matrix(w0.size());
  return S * w0.asDiagonal() * S;
}

LcpMatrix shifted(const LcpMatrix& M, double shift) {
  LcpMatrix sum = M;
  if (shift != 0) std::get<Tridiagonal>(sum).diagonal.array() += shift;
  return sum;
}

void prepare(const DiscreteProblem& p, const Source& source, TimeLevel& level) {
  const Index rows = level.steps + 1, n = p.scene.constraints();
  level.kernel = source.kernel(level);
  for (auto* array : {&level.r, &level.y, &level.v, &level.old}) *array = p.backend.array(rows, n);
}

void prepare_smoothing(const DiscreteProblem& p, TimeLevel& level) {
  if (const auto* recurrence = std::get_if<Recurrence>(&level.weights))
    if (const auto* modal = std::get_if<ModalRecurrence>(recurrence))
      level.shift = best_smoothing(p.scene.M, *modal).shift;
  level.lcp = p.backend.lcp(shifted(p.scene.M, level.shift), p.lcp_class, level.steps + 1);
}

void prepare_march(const DiscreteProblem& p, const Options& options, TimeLevel& level) {
  MarchProblem problem;
  problem.M = &p.scene.M;
  problem.lcp_class = p.lcp_class;
  problem.recurrence = std::get_if<Recurrence>(&level.weights);
  problem.lags = std::get_if<LagTable>(&level.weights);
  problem.r = level.r.get();
  problem.interrupted = options.interrupted;
  level.march = p.backend.march(problem, level.steps + 1);
}

void set_responses(const DiscreteProblem& p, const SparseKernel* sparse, TimeLevels& levels) {
  TimeLevel& finest = levels[0];
  if (sparse)
    p.backend.upload(p.g + sparse->free, *finest.r);
  else
    finest.r = make_response(p, *finest.kernel, *finest.v);
  for (std::size_t l = 1; l < levels.size(); ++l) p.backend.inject(*levels[l - 1].r, *levels[l].r);
}

}  // namespace

std::size_t TimeLevel::bytes() const {
  return r->bytes() + y->bytes() + v->bytes() + old->bytes() + kernel->bytes() + (lcp ? lcp->bytes() : 0) +
         (march ? march->bytes() : 0);
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

TimeLevels time_levels(const DiscreteProblem& p, const SparseKernel* sparse, const Options& options) {
  Source source(p, sparse, options.convolution);
  TimeLevels levels;
  for (Index steps = p.J;; steps /= 2) {
    auto level = std::make_unique<TimeLevel>();
    level->steps = steps;
    level->weights = source.weights(steps, levels.size() > 0 ? &levels.grids.back()->weights : nullptr);
    const bool contracts = instant_contraction(p.scene.M, p.lcp_class, first_weight(level->weights)) < largest_kappa0;
    if (levels.size() > 0 && !contracts) break;
    levels.grids.push_back(std::move(level));
    if (!contracts || steps % 2 != 0 || steps / 2 < fewest_steps) break;
  }
  for (auto& level : levels.grids) prepare(p, source, *level);
  for (std::size_t l = 0; l + 1 < levels.size(); ++l) prepare_smoothing(p, levels[l]);
  set_responses(p, sparse, levels);
  prepare_march(p, options, *levels.grids.back());
  levels.description = source.description + "; grids of ";
  for (std::size_t l = 0; l < levels.size(); ++l)
    levels.description += (l > 0 ? ", " : "") + std::to_string(levels[l].steps);
  levels.description += " steps, the last marched";
  levels.kernel_error = source.error;
  return levels;
}

}  // namespace bromwich
