#include "core/solve/mixed.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/numerics/equilibration.hpp"
#include "core/scene/port_hamiltonian.hpp"
#include "core/solve/certification.hpp"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

constexpr Index largest_inverse = 4096;
constexpr Index largest_written_out = 1024;  ///< states of a Kronecker sum that become a dense A

std::vector<Index> other_rows(const std::vector<Index>& rows, Index n) {
  std::vector<Index> others;
  for (Index i = 0; i < n; ++i)
    if (!std::binary_search(rows.begin(), rows.end(), i)) others.push_back(i);
  return others;
}

/// n x |rows|, unit columns: B E picks columns, E^T N rows.
SparseMatrix selection(const std::vector<Index>& rows, Index n) {
  SparseMatrix E(n, Index(rows.size()));
  for (std::size_t k = 0; k < rows.size(); ++k) E.insert(rows[k], Index(k)) = 1;
  E.makeCompressed();
  return E;
}

/// M_FF^{-1}; empty if it has lost all digits.
std::optional<Matrix> inverse_of_free(const Matrix& M, const std::vector<Index>& free) {
  return scaled_inverse(M(free, free), 1e3 * double(free.size()) * epsilon);
}

Matrix add(const Matrix& A, const Matrix& B) { return A + B; }
SparseMatrix add(const SparseMatrix& A, const SparseMatrix& B) { return A + B; }

template <typename Matrices>
Matrices eliminated(const Matrices& d, const Matrix& M, const EliminatedScene& e) {
  using Block = std::decay_t<decltype(d.A)>;
  const auto block = [](const Matrix& dense) {
    if constexpr (std::is_same_v<Block, Matrix>)
      return dense;
    else
      return SparseMatrix(dense.sparseView());
  };
  const Index n = M.rows();
  const SparseMatrix E_F = selection(e.free, n), E_C = selection(e.kept, n);
  const Block B_F = d.B * E_F, B_C = d.B * E_C, N_F = E_F.transpose() * d.N, N_C = E_C.transpose() * d.N;
  const Block from_x = block(-e.R) * N_F, from_y = block(-e.R * e.M_FC), back = block(e.M_CF);
  return {add(d.A, Block(B_F * from_x)), add(B_C, Block(B_F * from_y)), add(N_C, Block(back * from_x)), d.E};
}

TimeFunction selected(const TimeFunction& g, Index n, const std::vector<Index>& rows) {
  return [g, n, rows](double t, Eigen::Ref<Vector> value) {
    Vector all(n);
    g(t, all);
    value = all(rows);
  };
}

/// f' = f - B_F R g_F, as columns F phi but where f is given for every state.
void eliminate_sources(const Scene& given, const SparseMatrix& B, EliminatedScene& e) {
  Scene& scene = e.scene;
  const Index n = given.constraints();
  if (given.f && given.f_entry == SourceEntry::through_B) {
    scene.f_entry = SourceEntry::through_F;
    scene.F = B;
  }
  if (!given.g) return;
  const TimeFunction g_F = selected(given.g, n, e.free);
  const Matrix through = -(B * selection(e.free, n)) * e.R;  // m x |F|
  const Index k = Index(e.free.size());
  if (!given.f) {
    scene.f_entry = SourceEntry::through_F;
    scene.F = through.sparseView();
    scene.f = g_F;
  } else if (given.f_entry == SourceEntry::state) {
    scene.f = [f = given.f, g_F, through, k](double t, Eigen::Ref<Vector> value) {
      Vector free(k);
      g_F(t, free);
      f(t, value);
      value.noalias() += through * free;
    };
  } else {
    const Index before = scene.F.cols();
    Matrix columns(scene.F.rows(), before + k);
    columns << Matrix(scene.F), through;
    scene.F = columns.sparseView();
    scene.f = [phi = given.f, g_F, before, k](double t, Eigen::Ref<Vector> value) {
      phi(t, value.head(before));
      g_F(t, value.tail(k));
    };
  }
  const std::vector<Index>& kept = e.kept;
  scene.g = [g = given.g, n, free = e.free, kept, D = Matrix(e.M_CF * e.R)](double t, Eigen::Ref<Vector> value) {
    Vector all(n);
    g(t, all);
    value = all(kept);
    value.noalias() -= D * all(free);
  };
}

RowMatrix sampled(const TimeFunction& g, const Vector& t, Index n) {
  RowMatrix values = RowMatrix::Zero(t.size(), n);
  Vector row(n);
  for (Index j = 0; g && j < t.size(); ++j) {
    g(t[j], row);
    values.row(j) = row.transpose();
  }
  return values;
}

/// The requested states and those that recovery needs, each once, in order.
std::vector<Index> with_seen(const Scene& scene, const Options& options, const std::vector<Index>& seen) {
  std::vector<Index> all = seen;
  if (options.states == StateSelection::list)
    all.insert(all.end(), options.components.begin(), options.components.end());
  if (options.states == StateSelection::all)
    for (Index i = 0; i < scene.states(); ++i) all.push_back(i);
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

std::vector<Index> positions(const std::vector<Index>& wanted, const std::vector<Index>& all) {
  std::vector<Index> found;
  for (const Index i : wanted) found.push_back(std::lower_bound(all.begin(), all.end(), i) - all.begin());
  return found;
}

/// max_j max(||min(y_C, w_C)||, ||w_F||) / max(1, ||N x + g||) over the rows that are valid.
double mixed_residual(const RowMatrix& y, const RowMatrix& q, const Matrix& M, const EliminatedScene& e) {
  double largest = NAN;
  for (Index j = 0; j < y.rows(); ++j) {
    if (!y.row(j).allFinite() || !q.row(j).allFinite()) continue;
    const Vector w = M * y.row(j).transpose() + q.row(j).transpose();
    const double size = std::max(1., q.row(j).cwiseAbs().maxCoeff());
    double residual = w(e.free).cwiseAbs().maxCoeff();
    for (const Index i : e.kept) residual = std::max(residual, std::abs(std::min(y(j, i), w[i])));
    largest = std::isnan(largest) ? residual / size : std::max(largest, residual / size);
  }
  return largest;
}

/// The residual of all rows: the solve itself has checked only the eliminated scene.
void check_all_rows(Result& result, const Options& options) {
  if (result.status != Status::solved) return;
  const bool iterated = iterates(result.method);
  if (result.residual <= residual_limit(iterated, result, options)) return;
  result.status = Status::tolerance_not_met;
  result.reason = text(
      "with the free rows the residual is %.1e: M is nearly singular there, and eliminating them loses that much; give "
      "these unknowns a regular block of M, or use method galerkin",
      result.residual);
}

/// y_F = -R w_F, and a large R takes the digits of w_F. The size of y_F is its median: a layer at t = 0 may be large.
void check_digits(const RowMatrix& y_F, double rounding, Result& result) {
  constexpr double most = 1e-3;
  if (result.status != Status::solved) return;
  std::vector<double> sizes;
  for (Index j = 0; j < y_F.rows(); ++j)
    if (y_F.row(j).allFinite()) sizes.push_back(y_F.row(j).cwiseAbs().maxCoeff());
  if (sizes.empty()) return;
  const auto middle = sizes.begin() + std::ptrdiff_t(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  if (rounding <= most * std::max(1.0, *middle)) return;
  result.status = Status::tolerance_not_met;
  result.reason = text(
      "the free rows and columns of M are nearly singular: rounding leaves the free unknowns an error of up to %.1e; "
      "scale these rows, or give them a larger block of M",
      rounding);
}

/// N x of all rows: N_C x = N' x + M_CF R N_F x.
RowMatrix whole_trace(const EliminatedScene& e, const RowMatrix& trace_C, const RowMatrix& x_seen) {
  RowMatrix trace_F = RowMatrix::Zero(x_seen.rows(), Index(e.free.size()));
  e.add_trace(x_seen, trace_F);
  RowMatrix trace(x_seen.rows(), Index(e.free.size() + e.kept.size()));
  trace(Eigen::all, e.free) = trace_F;
  trace(Eigen::all, e.kept) = trace_C + trace_F * (e.M_CF * e.R).transpose();
  return trace;
}

/// The rounding error of each y_F that follows from those of y_C and x; sizes: largest values of the states `seen`.
Vector rounding_of_free(const EliminatedScene& e, const Result& result, const RowMatrix& sizes) {
  const RowMatrix of_y = (e.R * e.M_FC).cwiseAbs(), of_x = (e.R * Matrix(e.N_F)(Eigen::all, e.seen)).cwiseAbs();
  return of_y.rowwise().sum() * result.rounding_of_y + of_x * sizes.transpose() * result.rounding;
}

/// y of all rows from that of the rows kept.
void take_y(const EliminatedScene& e, const RowMatrix& y_C, const RowMatrix& y_F, Result& result) {
  result.y.resize(y_C.rows(), y_C.cols() + y_F.cols());
  result.y(Eigen::all, e.kept) = y_C;
  result.y(Eigen::all, e.free) = y_F;
  const RowMatrix of_kept = std::exchange(result.y_integral, {});
  if (of_kept.size() == 0) return;
  RowMatrix all = integral_of_y(result);
  all(Eigen::all, e.kept) = of_kept.leftCols(y_C.cols());
  result.y_integral = std::move(all);
}

}  // namespace

Result EliminatedScene::reduced(const Result& result) const {
  Result part = result;
  for (RowMatrix* table : {&part.y, &part.y_integral})
    if (table->size() > 0)
      *table = kept.empty() ? RowMatrix(RowMatrix::Zero(table->rows(), 1)) : RowMatrix((*table)(Eigen::all, kept));
  return part;
}

void EliminatedScene::add_trace(const RowMatrix& x_seen, RowMatrix& w_F) const {
  for (std::size_t k = 0; k < seen.size(); ++k)
    for (SparseMatrix::InnerIterator entry(N_F, seen[k]); entry; ++entry)
      w_F.col(entry.row()) += entry.value() * x_seen.col(Index(k));
}

RowMatrix EliminatedScene::recover(const RowMatrix& y_C, const RowMatrix& x_seen, const RowMatrix& g_F) const {
  RowMatrix w_F = g_F;
  add_trace(x_seen, w_F);
  w_F += y_C.leftCols(M_FC.cols()) * M_FC.transpose();
  return -w_F * R.transpose();
}

bool can_eliminate_free(const Scene& scene) {
  if (Index(scene.free_rows.size()) > largest_inverse) return false;
  return inverse_of_free(to_dense(scene.M), scene.free_rows).has_value();
}

std::optional<EliminatedScene> eliminate_free(const Scene& given) {
  if (!given.dynamics->has_matrices())
    throw Error("free_rows", "is given with supplied dynamics", "eliminate the free unknowns, or give matrices");
  EliminatedScene e;
  const Index n = given.constraints(), m = given.states();
  if (Index(given.free_rows.size()) > largest_inverse) return std::nullopt;
  const Matrix M = to_dense(given.M);
  e.free = given.free_rows;
  e.kept = other_rows(e.free, n);
  const std::optional<Matrix> inverse = inverse_of_free(M, e.free);
  if (!inverse) return std::nullopt;
  e.R = *inverse;
  e.M_FC = M(e.free, e.kept);
  e.M_CF = M(e.kept, e.free);
  Dynamics written = given.dynamics;
  if (const auto* k = given.dynamics->modes())
    written = m <= largest_written_out ? Dynamics(to_dense(given.dynamics)) : Dynamics(to_sparse(*k));
  e.scene = given;
  e.scene.free_rows.clear();
  e.scene.exact = {};
  e.scene.port = {};
  // A Schur complement of a P- or PSD matrix is one; of other classes it is tested.
  if (!traits(given.lcp_class).in_schur_complement) e.scene.lcp_class = LcpClass::automatic;
  e.scene.M = Matrix(M(e.kept, e.kept) - e.M_CF * e.R * e.M_FC);
  if (const auto* d = written->small_state())
    e.scene.dynamics = eliminated(*d, M, e);
  else
    e.scene.dynamics = eliminated(*written->matrices(), M, e);
  e.N_F = SparseMatrix(selection(e.free, n).transpose() * written->outputs());
  for (Index i = 0; i < m; ++i)
    if (SparseMatrix::InnerIterator(e.N_F, i)) e.seen.push_back(i);
  eliminate_sources(given, written->inputs(), e);
  if (e.kept.empty()) {  // a constraint that does nothing takes the place of the free rows
    e.scene = with_idle_constraint(std::move(e.scene));
    e.scene.g = {};
  }
  return e;
}

namespace {

// The result of the scene without free rows, with the states `recorded`, as that of all rows.
void take_all_rows(const Scene& scene, const EliminatedScene& e, const InnerOptions& options,
                   const std::vector<Index>& recorded, Result& result) {
  const RowMatrix y_C = result.y.leftCols(Index(e.kept.size())), x = result.x,
                  g = sampled(scene.g, result.t, scene.constraints());
  const auto valid = [&](Index j) { return x.row(j).allFinite() && y_C.row(j).allFinite(); };
  const RowMatrix x_seen = x(Eigen::all, positions(e.seen, recorded));
  take_y(e, y_C, e.recover(y_C, x_seen, g(Eigen::all, e.free)), result);
  RowMatrix trace = whole_trace(e, result.trace.leftCols(y_C.cols()), x_seen),
            sizes = RowMatrix::Zero(1, x_seen.cols());
  for (Index j = 0; j < trace.rows(); ++j)
    if (valid(j))
      sizes = sizes.cwiseMax(x_seen.row(j).cwiseAbs());
    else
      trace.row(j).setConstant(NAN);
  if (const double residual = mixed_residual(result.y, trace + g, to_dense(scene.M), e); !std::isnan(residual))
    result.residual = residual;
  check_all_rows(result, options);
  result.trace = options.trace ? std::move(trace) : RowMatrix();
  result.x_components = recorded_components(scene, options);
  result.x = x(Eigen::all, positions(result.x_components, recorded));
  const Vector rounding_F = rounding_of_free(e, result, sizes);
  result.rounding_of_y = std::max(result.rounding_of_y, rounding_F.maxCoeff());
  check_digits(result.y(Eigen::all, e.free), rounding_F.maxCoeff(), result);
  result.kernel += "; free rows eliminated";
}

}  // namespace

Reduction without_free_rows(const Scene& scene, const std::shared_ptr<const EliminatedScene>& eliminated,
                            const InnerOptions& options) {
  const EliminatedScene& e = *eliminated;
  Reduction made{e.scene, options};
  made.options.trace = true;
  made.options.states = StateSelection::list;
  made.options.components = with_seen(scene, options, e.seen);
  if (options.tuning.first_iterate && options.tuning.first_iterate->cols() == scene.constraints() && !e.kept.empty()) {
    made.first_iterate = std::make_shared<RowMatrix>((*options.tuning.first_iterate)(Eigen::all, e.kept));
    made.options.tuning.first_iterate = made.first_iterate.get();
  }
  made.finish = [&scene, eliminated, &options, recorded = made.options.components](Result& result) {
    take_all_rows(scene, *eliminated, options, recorded, result);
  };
  return made;
}

}  // namespace bromwich
