#include "batch/derivatives_side_by_side.hpp"

#include "batch/array_scenes.hpp"
#include "batch/batch_groups.hpp"
#include "core/base/error.hpp"
#include "core/base/interruption.hpp"
#include "core/base/text.hpp"
#include "core/kernel/recurrence.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/scene/input_samples.hpp"
#include "core/scene/source_steps.hpp"
#include "derivatives/check_table.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

namespace bromwich {

namespace {

using scene_steps::HeldPacked;
using scene_steps::HeldState;

constexpr double share_of_memory = 0.5;
constexpr const char* one_sided =
    "derivative: not differentiable here: y = w = 0 at t = 0 for a constraint, and derivatives that move it are "
    "one-sided; change x0 or g(0) slightly";

// Whether all scenes of the batch are steps of one problem that scenes in arrays have.
bool suitable(const Batch& batch, const Scene& scene) {
  const Index most = scene_steps::most_held;
  return batch.own.empty() && !own_matrices(batch) && batch.times.empty() && !scene.boundary &&
         scene.free_rows.empty() && scene.dynamics->small_state() && !scene.dynamics->has_mass() &&
         scene.states() >= 1 && scene.states() <= most && scene.constraints() >= 1 && scene.constraints() <= most &&
         has_one_solution(known_class(scene.M, scene.lcp_class));
}

// As SolutionDerivative takes them.
bool has_steps(Method method) {
  return method == Method::march || method == Method::contour || method == Method::multigrid ||
         method == Method::shooting;
}

RowMatrix rows_of(const TimeFunction& function, const Vector& t, Index width) {
  return function ? RowMatrix(sample(function, t, width).table()) : RowMatrix::Zero(t.size(), width);
}

// f in x' = A x + B y + f; empty where it jumps or bends inside steps, as SolutionDerivative judges.
RowMatrix smooth_source(const Scene& scene, const Vector& t) {
  const SampledSource f = sample(scene.f, t, scene.sources());
  if (!find_source_steps(scene, t, f, sample(scene.g, t, scene.constraints()), false).rough.empty()) return {};
  return f.table() * source_matrix(scene, *scene.dynamics->small_state()).transpose();
}

double bytes_of(const SceneArraysProblem& p, Index scenes) {
  const double tables = 4 * double(p.m) + 8 * double(p.n);  // of a solution, a change and what comes out of it
  return sizeof(double) * double(scenes) * (double(p.J + 1) * tables + double(HeldPacked{p.m, p.n}.size()));
}

}  // namespace

Result single_result(const Scene& scene, const BatchResult& all, Index k) {
  Result r;
  r.status = all.status[std::size_t(k)];
  r.method = all.method[std::size_t(k)];
  r.steps = all.rows() - 1;
  r.t = all.t * (scene.T / all.t[r.steps]);
  r.y = all.of(all.y, k);
  const LcpClass c = known_class(scene.M, scene.lcp_class);
  r.continuous = has_one_solution(c);
  r.rough_steps = -1;  // not known
  return r;
}

std::unique_ptr<DerivativesSideBySide> DerivativesSideBySide::make(const Batch& batch, const BatchResult& result,
                                                                   Backend& backend) {
  const Scene first = scene_of(batch, 0);
  if (!suitable(batch, first)) return nullptr;
  std::vector<Index> scenes;
  for (Index k = 0; k < batch.scenes; ++k)
    if (result.status[std::size_t(k)] == Status::solved && has_steps(result.method[std::size_t(k)]))
      scenes.push_back(k);
  if (Index(scenes.size()) < fewest) return nullptr;
  const DenseDynamics& dense = *first.dynamics->small_state();
  SceneArraysProblem problem = scene_arrays_problem(dense, to_dense(first.M), first.T, result.rows() - 1);
  const double memory = backend.device().memory;
  if (memory > 0 && bytes_of(problem, Index(scenes.size())) > share_of_memory * memory) return nullptr;
  std::unique_ptr<DerivativesSideBySide> made(
      new DerivativesSideBySide(dense, std::move(problem), backend, std::move(scenes), batch.scenes));
  made->upload(batch, result);
  return made;
}

DerivativesSideBySide::DerivativesSideBySide(const DenseDynamics& dense, SceneArraysProblem problem, Backend& backend,
                                             std::vector<Index> scenes, Index of_batch)
    : backend_(backend),
      problem_(std::move(problem)),
      directions_(dense.A, problem_.h),
      scenes_(std::move(scenes)),
      place_(std::size_t(of_batch), -1),
      plan_(make_scene_arrays(backend, problem_, Index(scenes_.size()))) {}

void DerivativesSideBySide::upload(const Batch& batch, const BatchResult& result) {
  const Index K = Index(scenes_.size()), m = problem_.m, n = problem_.n;
  RowMatrix x0(K, m), y(K * rows(), n), f, g;
  std::vector<char> smooth(std::size_t(K), 1);
  const bool own = own_sources(batch);
  for (Index i = 0; i < K; ++i) {
    if (i % 64 == 0) check_interruption();
    const Scene scene = scene_of(batch, scenes_[std::size_t(i)]);
    x0.row(i) = scene.x0.transpose();
    y.middleRows(i * rows(), rows()) = result.of(result.y, scenes_[std::size_t(i)]);
    if (!own && i > 0) {
      smooth[std::size_t(i)] = smooth[0];
      continue;
    }
    const Index of_all = own ? K * rows() : rows();
    if (scene.f && f.size() == 0) f = RowMatrix::Zero(of_all, m);
    if (scene.g && g.size() == 0) g = RowMatrix::Zero(of_all, n);
    if (scene.f) {
      const RowMatrix table = smooth_source(scene, result.t);
      smooth[std::size_t(i)] = table.size() > 0;
      if (table.size() > 0) f.middleRows(i * rows(), rows()) = table;
    }
    if (scene.g) g.middleRows(i * rows(), rows()) = rows_of(scene.g, result.t, n);
  }
  const auto uploaded = [this](const RowMatrix& values) {
    auto array = backend_.array(values.rows(), values.cols());
    backend_.upload(values, *array);
    return array;
  };
  x0_ = uploaded(x0), y_ = uploaded(y);
  if (f.size() > 0) f_ = uploaded(f);
  if (g.size() > 0) g_ = uploaded(g);
  x_ = backend_.array(y.rows(), m), w_ = backend_.array(y.rows(), n);
  states_ = plan_->follow({x0_.get(), f_.get(), g_.get()}, *y_, *x_, *w_);
  for (Index i = 0; i < K; ++i)
    if (smooth[std::size_t(i)] && states_[std::size_t(i)].verdict == HeldState::fine)
      place_[std::size_t(scenes_[std::size_t(i)])] = i;
}

DerivativeMargin DerivativesSideBySide::margin(Index k) const {
  const HeldState& state = states_[std::size_t(place_[std::size_t(k)])];
  return {state.margin, problem_.h * double(state.step), state.constraint};
}

// One table of `rows` rows for all scenes, or one under another; null where none has it.
template <class Change, class Table>
std::unique_ptr<Array> DerivativesSideBySide::table_of(const std::vector<Change>& all, Table Change::*member,
                                                       Index rows, Index cols) const {
  if (std::all_of(all.begin(), all.end(), [&](const Change& c) { return (c.*member).size() == 0; })) return nullptr;
  const bool shared = all.size() == 1;
  RowMatrix values = RowMatrix::Zero(shared ? rows : rows * Index(scenes_.size()), cols);
  for (Index i = 0; i < (shared ? 1 : Index(scenes_.size())); ++i) {
    const Table& table = all[shared ? 0 : std::size_t(scenes_[std::size_t(i)])].*member;
    if (table.size() == 0) continue;
    if constexpr (std::is_same_v<Table, Vector>)
      values.row(i) = table.transpose();
    else
      values.middleRows(i * rows, rows) = table;
  }
  auto array = backend_.array(values.rows(), cols);
  backend_.upload(values, *array);
  return array;
}

// The changes of A, B, N and M, a row for each scene; without rows if no scene has one.
RowMatrix DerivativesSideBySide::packed(const std::vector<DataChange>& all) const {
  const auto has = [](const DataChange& c) { return c.A.size() + c.B.size() + c.N.size() + c.M.size() > 0; };
  if (std::none_of(all.begin(), all.end(), has)) return {};
  const HeldPacked at{problem_.m, problem_.n};
  const Index count = all.size() == 1 ? 1 : Index(scenes_.size());
  RowMatrix values = RowMatrix::Zero(count, at.size());
  for (Index i = 0; i < count; ++i) {
    const DataChange& c = all[all.size() == 1 ? 0 : std::size_t(scenes_[std::size_t(i)])];
    double* const to = values.row(i).data();
    if (c.A.size() > 0) directions_.forward(c.A, to);
    for (const auto& [matrix, first] : {std::pair(&c.B, at.B()), {&c.N, at.N()}, {&c.M, at.M()}})
      if (matrix->size() > 0) Eigen::Map<RowMatrix>(to + first, matrix->rows(), matrix->cols()) = *matrix;
  }
  return values;
}

void DerivativesSideBySide::jvp(const std::vector<DataChange>& changes, std::vector<SolutionChange>& to,
                                std::vector<std::string>& reason) const {
  const Index m = problem_.m, n = problem_.n, all = Index(scenes_.size()) * rows();
  for (const DataChange& c : changes) {
    check_no_b(c.b);
    check_no_restitution(c.restitution);
    check_data(c, rows(), m, n);
  }
  const auto x0 = table_of(changes, &DataChange::x0, 1, m), f = table_of(changes, &DataChange::f, rows(), m),
             g = table_of(changes, &DataChange::g, rows(), n);
  std::unique_ptr<Array> matrices;
  if (const RowMatrix values = packed(changes); values.size() > 0) {
    matrices = backend_.array(values.rows(), values.cols());
    backend_.upload(values, *matrices);
  }
  const auto dy = backend_.array(all, n), dx = backend_.array(all, m), dw = backend_.array(all, n),
             integral = backend_.array(all, n);
  const std::vector<char> decided =
      plan_->forward({{x0.get(), f.get(), g.get()}, matrices.get()}, {dy.get(), dx.get(), dw.get(), integral.get()});
  RowMatrix of_y, of_x, of_w, of_integral;
  backend_.download(*dy, of_y), backend_.download(*dx, of_x);
  backend_.download(*dw, of_w), backend_.download(*integral, of_integral);
  for (Index i = 0; i < Index(scenes_.size()); ++i) {
    const std::size_t k = std::size_t(scenes_[std::size_t(i)]);
    if (place_[k] < 0) continue;
    const auto part = [&](const RowMatrix& table) { return table.middleRows(i * rows(), rows()); };
    const DataChange& c = changes[changes.size() == 1 ? 0 : k];
    if (c.E.size() > 0)
      reason[k] = "derivative: the scene has no E; change A and B instead";
    else if (!decided[std::size_t(i)])
      reason[k] = one_sided;
    else
      to[k] = {part(of_y), part(of_x), part(of_w), part(of_integral)};
  }
}

void DerivativesSideBySide::vjp(const std::vector<SolutionChange>& functions, std::vector<DataChange>& to) const {
  const Index m = problem_.m, n = problem_.n, K = Index(scenes_.size());
  for (const SolutionChange& of : functions) {
    check_table("y", of.y, rows(), n);
    check_table("x", of.x, rows(), m);
    check_table("w", of.w, rows(), n);
    check_table("integral", of.integral, rows(), n);
  }
  const auto y = table_of(functions, &SolutionChange::y, rows(), n),
             x = table_of(functions, &SolutionChange::x, rows(), m),
             w = table_of(functions, &SolutionChange::w, rows(), n),
             integral = table_of(functions, &SolutionChange::integral, rows(), n);
  const HeldPacked at{m, n};
  const auto x0 = backend_.array(K, m), f = backend_.array(K * rows(), m), g = backend_.array(K * rows(), n),
             matrices = backend_.array(K, at.size());
  const std::vector<char> decided =
      plan_->backward({y.get(), x.get(), w.get(), integral.get()}, {x0.get(), f.get(), g.get(), matrices.get()});
  RowMatrix of_x0, of_f, of_g, sums;
  backend_.download(*x0, of_x0), backend_.download(*f, of_f);
  backend_.download(*g, of_g), backend_.download(*matrices, sums);
  RowMatrix start, y_rows;  // where a gradient is one-sided
  if (std::find(decided.begin(), decided.end(), char(0)) != decided.end())
    backend_.download(*x0_, start), backend_.download(*y_, y_rows);
  for (Index i = 0; i < K; ++i) {
    const std::size_t k = std::size_t(scenes_[std::size_t(i)]);
    if (place_[k] < 0) continue;
    const double* const of = sums.row(i).data();
    const auto matrix = [&](Index first, Index rows, Index cols) {
      return Matrix(Eigen::Map<const RowMatrix>(of + first, rows, cols));
    };
    to[k] = {of_x0.row(i).transpose(),
             of_f.middleRows(i * rows(), rows()),
             of_g.middleRows(i * rows(), rows()),
             directions_.backward(of),
             matrix(at.B(), m, n),
             matrix(at.N(), n, m),
             matrix(at.M(), n, n)};
    if (!decided[std::size_t(i)]) leave_out_start(to[k], start.row(i).transpose(), y_rows.row(i * rows()));
  }
}

}  // namespace bromwich
