#include "core/solve/symmetric_form.hpp"

#include "core/dynamics/grid_system.hpp"
#include "core/lcp/class_traits.hpp"
#include "core/lcp/lcp_class.hpp"
#include "core/solve/prepared.hpp"
#include "core/solve/scaling.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace bromwich {

namespace {

bool takes_modes(Method method) {
  return method != Method::galerkin && method != Method::goal && !locates_switches(method);
}

bool is_diagonal(const LcpMatrix& M) {
  bool found = true;
  const auto look = [&found](Index i, Index j, double entry) { found = found && (i == j || entry == 0); };
  if (const auto* t = std::get_if<Tridiagonal>(&M)) {
    each_entry(*t, look);
    return found;
  }
  const SparseMatrix* sparse = sparse_of(M);
  const SparseMatrix entries = sparse ? *sparse : SparseMatrix(std::get<Matrix>(M).sparseView(0, 0));
  for (Index j = 0; j < entries.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(entries, j); a; ++a) look(a.row(), a.col(), a.value());
  return found;
}

const SymmetricForm* form_of(const Scene& scene, const InnerOptions& options) {
  const auto* grid = dynamic_cast<const GridSystem*>(&*scene.dynamics);
  if (!grid || !grid->symmetric_form()) return nullptr;
  const bool of_states = scene.f && scene.f_entry != SourceEntry::through_B;
  if (of_states || scene.boundary || !scene.free_rows.empty() || controls_error(options)) return nullptr;
  if (!takes_modes(options.method) || options.event_location) return nullptr;
  const LcpClass c = known_class(scene.M, scene.lcp_class);
  if (!is_diagonal(scene.M) && !has_one_solution(c) && !selects_least(c)) return nullptr;
  return grid->symmetric_form().get();
}

TimeFunction times(const TimeFunction& function, const Vector& factors) {
  if (!function) return function;
  if (const auto* separable = function.separable()) {
    SeparableSource scaled = *separable;
    scaled.shapes = factors.asDiagonal() * scaled.shapes;
    return scaled;
  }
  return [function, factors](double t, Eigen::Ref<Vector> value) {
    function(t, value);
    value.array() *= factors.array();
  };
}

LcpMatrix similar(const LcpMatrix& M, const Vector& y) {
  const Vector inverse = y.cwiseInverse();
  if (const auto* dense = std::get_if<Matrix>(&M)) return Matrix(inverse.asDiagonal() * *dense * y.asDiagonal());
  if (const auto* sparse = sparse_of(M))
    return SparseLcpMatrix(SparseMatrix(inverse.asDiagonal() * *sparse * y.asDiagonal()));
  Tridiagonal t = std::get<Tridiagonal>(M);
  each_entry(t, [&](Index i, Index j, double& entry) {
    if (i != j) entry *= y[j] / y[i];
  });
  return t;
}

Scene in_form(const Scene& scene, const SymmetricForm& form) {
  Scene symmetric = scene;
  symmetric.port = {};
  symmetric.exact = {};
  symmetric.dynamics = form.modes;
  symmetric.M = similar(scene.M, form.y);
  symmetric.f = times(scene.f, form.y.cwiseInverse());
  symmetric.g = times(scene.g, form.y.cwiseInverse());
  symmetric.x0 = scene.x0.cwiseQuotient(form.x);
  return symmetric;
}

void scale(const SymmetricForm& form, int sign, Result& result) {
  const Vector y = sign > 0 ? form.y : Vector(form.y.cwiseInverse()),
               x = sign > 0 ? form.x : Vector(form.x.cwiseInverse());
  for (RowMatrix* table : {&result.y, &result.y_left, &result.y_integral, &result.trace})
    if (table->size() > 0) *table = *table * y.asDiagonal();
  for (std::size_t c = 0; c < result.x_components.size() && result.x.size() > 0; ++c)
    result.x.col(Index(c)) *= x[result.x_components[c]];
}

}  // namespace

std::optional<Reduction> symmetric_form(const Scene& scene, const InnerOptions& options) {
  const SymmetricForm* form = form_of(scene, options);
  if (!form) return std::nullopt;
  Reduction made{in_form(scene, *form), options};
  made.options.trace = true;
  if (options.prepared)
    made.scene.dynamics = options.prepared->reduced(ReducedDynamics::symmetric, scene.dynamics, made.scene.dynamics);
  if (options.tuning.first_iterate && options.tuning.first_iterate->cols() == scene.constraints()) {
    made.first_iterate =
        std::make_shared<RowMatrix>(*options.tuning.first_iterate * form->y.cwiseInverse().asDiagonal());
    made.options.tuning.first_iterate = made.first_iterate.get();
  }
  made.there = [form](Result& result) { scale(*form, -1, result); };
  made.back = [form](Result& result) { scale(*form, 1, result); };
  made.finish = [form, &scene, &options](Result& result) {
    result.rounding_of_y *= form->y.maxCoeff();
    result.kernel_error *= form->y.maxCoeff() / form->y.minCoeff();
    result.kernel += "; in the symmetric form of constant advection";
    take_stated_residual(scene, result);
    if (!options.trace) result.trace.resize(0, 0);
  };
  return made;
}

}  // namespace bromwich
