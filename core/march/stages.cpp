#include "core/march/stages.hpp"

#include "core/base/text.hpp"
#include "core/base/timer.hpp"
#include "core/host/stage_march.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/response.hpp"
#include "core/kernel/rough_response.hpp"
#include "core/kernel/transfer_fit.hpp"
#include "core/lcp/active_set.hpp"
#include "core/march/outcome.hpp"
#include "core/march/stage_grid.hpp"
#include "core/scan/stage_chunks.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace bromwich {

namespace {

constexpr double first_node = 1.0 / 3;  ///< c_1 of Radau IIA; the last node is the end of the step

constexpr Index fewest_compressed_stages = 40;  ///< eigenvalues of a line above which a fit by few poles is tried
constexpr double nearly_as_long = 1e-2;         ///< where sources are looked at, as the part
constexpr int most_passes = 8;                  ///< marches until contacts stay in the same steps

// g or phi at the stages of every step. Row j belongs to the step that ends at row j; row 0 holds the value at t = 0
// for all stages.
RowMatrix sample_stages(const DiscreteProblem& p, const StageGrid& grid, const TimeFunction& function,
                        const RowMatrix& at_nodes, Index stages) {
  const Index width = at_nodes.cols(), rows = grid.t.size();
  RowMatrix values(rows, stages * width);
  const bool divided = !grid.lengths.empty();
  const auto time = [&](Index j, double node) {
    const double from = divided ? grid.from[std::size_t(j) - 1] : grid.t[j - 1];
    return from + node * (divided ? grid.to[std::size_t(j) - 1] - from : p.h);
  };
  if (divided) {
    Vector ends = grid.t;
    for (Index j = 1; j < rows; ++j) ends[j] = grid.to[std::size_t(j) - 1];
    values.rightCols(width) = sample(function, ends, width).table();
  }
  for (std::size_t j = 0; j < grid.at.size(); ++j) values.row(grid.at[j]).tail(width) = at_nodes.row(Index(j));
  if (stages == 1) return values;
  Vector inner(rows);
  inner[0] = 0;
  for (Index j = 1; j < rows; ++j) inner[j] = time(j, first_node);
  values.leftCols(width) = sample(function, inner, width).table();
  return values;
}

// Sets g at the end of each part to its limit from the left. At grid points this is done only if M determines y
// (`at_points`); y there is computed later from g's own value. Otherwise the state has to follow g itself.
void take_limits(const DiscreteProblem& p, const StageGrid& grid, bool at_points, RowMatrix& g) {
  if (!p.sources || !p.scene.g) return;
  const OneSided source(p.scene.g, p.scene.constraints(), p.sources->resolution);
  for (Index j = 1; j < grid.t.size(); ++j) {
    const Index step = grid.step[std::size_t(j)];
    if (!p.sources->at(step) || (grid.at[std::size_t(step)] == j && !at_points)) continue;
    const double from = grid.from[std::size_t(j) - 1], to = grid.to[std::size_t(j) - 1];
    g.row(j).tail(p.scene.constraints()) = source.whole(source.before(to, to - from)).transpose();
  }
  const Index n = p.scene.constraints();
  for (const Index row : grid.after) {
    const RowMatrix own = p.g.table().row(grid.step[std::size_t(row)]);
    for (Index k = 0; k < g.cols() / n; ++k) g.row(row).segment(k * n, n) = own;
  }
}

// f at a stage if a single polynomial describes it on this part. The stages then use point values, as on smooth steps.
std::optional<Vector> value_of_one_piece(const RoughStep& rough, double begin, double d, double stage) {
  const double near = 1e-9 * d;
  for (const SourcePiece& piece : rough.pieces) {
    if (piece.start > begin + near || piece.start + piece.length < begin + d - near) continue;
    const double sigma = (begin + stage * d - piece.start) / piece.length;
    return Vector(piece.phi * Vector{{1, sigma, sigma * sigma}});
  }
  return std::nullopt;
}

// On rough steps, stage values of f are set by its moments: orders 0 and 1 for two stages, the mean for one. For a
// smooth f, point values are more accurate if y balances a stiff f.
void take_moments(const DiscreteProblem& p, const StageGrid& grid, Index stages, RowMatrix& phi) {
  if (!p.sources) return;
  const Index width = phi.cols() / stages;
  for (Index j = 1; j < grid.t.size(); ++j) {
    const RoughStep* rough = p.sources->at(grid.step[std::size_t(j)]);
    if (!rough || rough->pieces.empty()) continue;
    const bool divided = !grid.lengths.empty();
    const double length = divided ? grid.lengths[std::size_t(j) - 1] : p.h;
    const double from = divided ? grid.from[std::size_t(j) - 1] : grid.t[j - 1];
    const double d = divided ? grid.to[std::size_t(j) - 1] - from : p.h;
    const bool as_long = std::abs(d - length) <= nearly_as_long * length;
    const auto whole = [&](const Vector& v) { return p.f.shapes().size() > 0 ? Vector(p.f.shapes() * v) : v; };
    const auto first = value_of_one_piece(*rough, from, d, first_node), last = value_of_one_piece(*rough, from, d, 1);
    if (stages == 2 && as_long && first && last) {
      phi.row(j) << whole(*first).transpose(), whole(*last).transpose();
      continue;
    }
    // Up to where the next part begins to look: the integral of f is that of the step.
    const bool next = divided && std::size_t(j) < grid.from.size();
    const double upto = next ? grid.from[std::size_t(j)] - from : d;
    Matrix linear = linear_by_moments(*rough, from, upto) * (divided ? upto / length : 1);
    if (linear.rows() == 0) continue;
    if (p.f.shapes().size() > 0) linear = (p.f.shapes() * linear).eval();
    const Vector mean = linear.col(0) + linear.col(1) / 2;
    phi.row(j).tail(width) = (stages == 1 ? mean : Vector(linear.col(0) + linear.col(1))).transpose();
    if (stages == 2) phi.row(j).head(width) = (linear.col(0) + first_node * linear.col(1)).transpose();
  }
}

// y at grid points where g has a value of its own. Null: all solved; otherwise the first unsolved point.
std::optional<Index> solve_at_own_values(const DiscreteProblem& p, const StageGrid& grid, const RowMatrix& g,
                                         const RowMatrix& seen, Result& result) {
  const Index n = p.scene.constraints();
  const double scale = p.g.table().cwiseAbs().maxCoeff();
  std::optional<ActiveSetLcp> lcp;
  for (const RoughStep& rough : p.sources->rough) {
    const Index j = rough.step, row = grid.at[std::size_t(j)];
    const Vector own = p.g.row(j);
    if (!result.y.row(j).allFinite() || !seen.row(j).allFinite()) break;
    if ((g.row(row).tail(n).transpose() - own).cwiseAbs().maxCoeff() <= same_at_end * scale) continue;
    if (!lcp) lcp.emplace(to_dense(p.scene.M), p.lcp_class);
    Vector y;
    if (!lcp->solve(own + seen.row(j).transpose(), y).solved) return j;
    result.y.row(j) = y.transpose();
  }
  return std::nullopt;
}

SparseMatrix source_matrix(const Scene& scene, const Dynamics& dynamics) {
  if (scene.f_entry == SourceEntry::through_F) return scene.F;
  if (scene.f_entry == SourceEntry::through_B) return dynamics->inputs();
  SparseMatrix identity(scene.states(), scene.states());
  identity.setIdentity();
  return identity;
}

std::string describe(Index stages, const MarchReport& report, const ModalStages* modal) {
  if (stages == 1) return "implicit Euler on the state";
  std::string text = "y discontinuous between steps: Radau IIA on the state";
  if (modal)
    text += ", " + std::to_string(modal->rates.size()) + (modal->has_state ? " eigenvalues a mode" : " poles a mode");
  if (report.jumps > 0) text += ", " + std::to_string(report.jumps) + " steps by implicit Euler (the state jumps)";
  return text;
}

std::unique_ptr<Array> on_backend(const DiscreteProblem& p, const RowMatrix& values) {
  auto array = p.backend.array(values.rows(), values.cols());
  p.backend.upload(values, *array);
  return array;
}

// Input of the march and the objects that it refers to.
struct Given {
  Dynamics written_out;  ///< a Kronecker sum as sparse matrices
  StageProblem problem;
};

bool takes_limits_at_points(const DiscreteProblem& p, const StageGrid& grid) {
  return !grid.lengths.empty() && takes_limits_at_points(p);
}

// Whether N B is a multiple of the identity: y of one face is not seen at once at the other one.
bool acts_alone(const KroneckerDynamics& d) { return !d.both_faces || d.n.dot(d.b.reverse()) == 0; }

// The modes of a Kronecker sum: all eigenvalues of a line, or few poles of its transfer function if no states are
// requested, x0 is zero and all steps have one length.
std::shared_ptr<const ModalStages> modal_stages(const DiscreteProblem& p, Index stages, RecurrenceChoice choice,
                                                const StageGrid& grid) {
  const KroneckerDynamics& d = *p.modes();
  auto modal = std::make_shared<ModalStages>();
  modal->face = p.face();
  modal->along = d.face_eigenvalues();
  modal->direct = d.n.dot(d.b);
  const Vector nu = d.across.eigenvalues();
  const bool chosen = choice == RecurrenceChoice::compressed;
  const bool one_length = grid.lengths.empty();
  if (one_length && p.components.empty() && p.scene.x0.isZero(0) && choice != RecurrenceChoice::modal &&
      (chosen || nu.size() > fewest_compressed_stages)) {
    const PoleSum fit = fit_line(d, stages == 2, p.h, p.scene.T);
    if (fit.error <= accepted_compression_error && (chosen || 2 * fit.rates.size() <= nu.size())) {
      modal->rates = fit.rates;
      modal->input = RowMatrix::Ones(fit.rates.size(), modal->along.size());
      modal->output = d.of_modes(fit.coefficients);
      modal->start = RowMatrix::Zero(fit.rates.size(), modal->along.size());
      modal->has_state = false;
      return modal;
    }
  }
  modal->rates = nu;
  if (!p.components.empty()) modal->across = d.across.modes();
  modal->input = d.of_modes(d.inputs_in_modes());
  modal->output = d.of_modes(d.across.in_modes(d.n));
  modal->start = x0_in_modes(p.backend, d, p.scene.x0, true).transpose();
  return modal;
}

void state_problem(const DiscreteProblem& p, const StageGrid& grid, Index stages, const Options& options,
                   Given& given) {
  StageProblem& problem = given.problem;
  const bool in_modes =
      p.modes() && p.modes()->beside.empty() && acts_alone(*p.modes()) && (p.f.size() == 0 || p.drive());
  if (p.modes() && !in_modes) given.written_out = to_sparse(*p.modes());
  problem.dynamics = p.modes() && !in_modes ? &given.written_out : &p.scene.dynamics;
  problem.modal = in_modes ? modal_stages(p, stages, options.tuning.recurrence, grid) : nullptr;
  problem.substitutes_euler = options.tuning.substitutes_euler;
  problem.M = &p.scene.M;
  problem.lcp_class = p.lcp_class;
  problem.stages = stages;
  problem.h = p.h;
  problem.lengths = grid.lengths;
  problem.x0 = p.scene.x0;
  problem.components = p.components;
  problem.interrupted = options.interrupted;
  if (options.progress) problem.progress = [&](Index row) { options.progress({grid.step[std::size_t(row)], 0, p.J}); };
  problem.g = sample_stages(p, grid, p.scene.g, p.g.table(), stages);
  if (!grid.lengths.empty()) take_limits(p, grid, takes_limits_at_points(p, grid), problem.g);
  if (p.f.size() == 0) return;
  problem.phi = sample_stages(p, grid, p.scene.f, p.f.table(), stages);
  take_moments(p, grid, stages, problem.phi);
  if (!in_modes) problem.F = source_matrix(p.scene, *problem.dynamics);
}

// Keeps the rows at grid points.
void keep_points(const DiscreteProblem& p, const StageGrid& grid, const Given& given, StageSolution& s,
                 Result& result) {
  for (Index* row : {&s.report.stopped, &s.report.infeasible})
    if (*row >= 0) *row = grid.step[std::size_t(*row)];
  for (RowMatrix* values : {&s.v, &result.y, &result.y_integral, &result.x})
    *values = (*values)(grid.at, Eigen::all).eval();
  result.defects = std::make_shared<StepDefects>();
  if (p.sources) result.kernel += text("; %zu steps in parts, where sources are not smooth", p.sources->rough.size());
  if (p.sources && takes_limits_at_points(p, grid) && s.report.stopped < 0)
    if (const auto j = solve_at_own_values(p, grid, given.problem.g, s.v, result)) s.report.stopped = *j;
}

}  // namespace

StageProblem smooth_stage_problem(const DiscreteProblem& p) {
  Given given;
  state_problem(p, make_grid(p, 2, LayersOf::nothing), 2, {}, given);
  return std::move(given.problem);
}

void solve_by_stages(const DiscreteProblem& p, Index stages, const InnerOptions& options, Result& result,
                     std::shared_ptr<const PoleModel> poles, const ScanPlan* plan) {
  Timer timer;
  const Start start = solve_at_zero(p, result);
  if (start == Start::none) return;
  result.seconds.lcp += timer.lap();
  const LayersOf given_steps = start == Start::impulse ? LayersOf::impulses_and_start : LayersOf::impulses;
  StageGrid grid = make_grid(p, stages, options.compares_grids ? LayersOf::all_jumps : given_steps);
  Given given;
  state_problem(p, grid, stages, options, given);
  given.problem.jumps_at_start = start == Start::impulse;
  if (grid.lengths.empty()) given.problem.poles = std::move(poles);
  result.seconds.setup += timer.lap();
  const Vector y0 = result.y.row(0).transpose();
  ScanReport scan;
  const auto march = [&] {
    return plan ? march_in_chunks(given.problem, y0, *plan, scan) : march_by_stages(given.problem, y0);
  };
  StageSolution s = march();
  // A more accurate contact moves the contacts after it.
  Contacts divided;
  for (int pass = 0; pass < most_passes && options.compares_grids; ++pass) {
    Contacts contacts = contacts_of(grid, s, given.problem.g);
    const auto known = [&](const auto& contact) { return divided.count(contact.first) > 0; };
    if (std::all_of(contacts.begin(), contacts.end(), known)) break;
    count(s.report, result);
    divided = std::move(contacts);
    grid = make_grid(p, stages, LayersOf::all_jumps, divided);
    state_problem(p, grid, stages, options, given);
    s = march();
  }
  result.bytes =
      s.bytes + host_bytes(p) +
      sizeof(double) * std::size_t(4 * s.y.size() + s.x.size() + given.problem.g.size() + given.problem.phi.size());
  result.y = std::move(s.y);
  result.y_integral = std::move(s.impulse);
  for (Index j = 1; j < result.y_integral.rows(); ++j) result.y_integral.row(j) += result.y_integral.row(j - 1);
  result.x = std::move(s.x);
  result.continuous = false;
  result.well_posed = s.report.well_posed;
  result.kernel = describe(stages, s.report, given.problem.modal.get());
  if (const PoleModel* model = given.problem.poles.get()) {
    result.kernel += text(", %td poles with %td numbers in the state", model->distinct, model->rows());
    result.kernel_error = model->error;
  }
  result.euler_steps = s.report.jumps;
  result.starts_with_impulse = start == Start::impulse;
  if (result.starts_with_impulse) result.kernel += impulse_note;
  count(s.report, result);
  if (plan) tell(scan, result);
  // The first part is the impulse: y and w of row 0 are those behind the second.
  const Index behind = std::min<Index>(grid.lengths.empty() ? 1 : 2, result.y.rows() - 1);
  const Vector y_behind = result.y.row(behind).transpose();
  const Vector g_behind = given.problem.g.row(behind).tail(y_behind.size()).transpose();
  const Vector seen_behind = s.v.row(behind).transpose() + g_behind - p.g.row(0);
  if (!grid.lengths.empty()) keep_points(p, grid, given, s, result);
  if (start == Start::impulse) {
    result.y.row(0) = y_behind.transpose();
    s.v.row(0) = seen_behind.transpose();
  }
  const auto r = on_backend(p, p.g.table()), v = on_backend(p, s.v), y = on_backend(p, result.y);
  if (options.trace) result.trace = trace(p, *r, *v);
  if (s.report.stopped >= 0) return explain_stop(p, s.report, result);
  result.residual = march_residual(p, start, *r, *v, *y);
  result.status = Status::solved;
}

}  // namespace bromwich
