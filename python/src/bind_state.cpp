// Scenes and results as values of Python and back, for pickle and copy.

#include "answer.hpp"
#include "core/base/error.hpp"
#include "core/goal/options.hpp"
#include "core/kernel/step_defects.hpp"
#include "core/result/located_solution.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/eigen/sparse.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <type_traits>

namespace bromwich::python {
namespace {

template <class T>
using Number = std::conditional_t<std::is_enum_v<T>, int, T>;

/// Writes members into a dict.
struct Writer {
  nb::dict& d;

  template <class T>
  void operator()(const char* name, const T& value) const {
    if constexpr (std::is_enum_v<T>)
      d[name] = int(value);
    else
      d[name] = nb::cast(value, nb::rv_policy::copy);
  }
};

/// Reads them back.
struct Reader {
  const nb::dict& d;

  template <class T>
  void operator()(const char* name, T& value) const {
    value = T(nb::cast<Number<T>>(d[name]));
  }
};

// ---- Results. Every member that a Result of Python, or looking between its time points, reads.

template <class Each, class E>
void members_of_estimate(const Each& each, E& e) {
  each("discretisation", e.discretisation), each("kernel", e.kernel), each("iteration", e.iteration);
  each("rounding", e.rounding), each("states", e.states), each("order", e.order), each("interior", e.interior);
  each("tolerance", e.tolerance), each("of_integral", e.of_integral), each("grids", e.grids),
      each("estimates", e.estimates);
}

template <class Each, class C>
void members_of_certificate(const Each& each, C& c) {
  each("error_of_x", c.error_of_x), each("error_of_y", c.error_of_y), each("error_of_mean_of_y", c.error_of_mean);
  each("typical_error_of_x", c.typical_error_of_x), each("mean_defect", c.mean_defect);
  each("largest_defect", c.largest_defect), each("defect_at", c.defect_at), each("defect_row", c.defect_row);
  each("impulses", c.impulses);
}

template <class Each, class S>
void members_of_seconds(const Each& each, S& s) {
  each("total", s.total), each("setup", s.setup), each("solve", s.solve), each("lcp", s.lcp);
  each("convolution", s.convolution), each("transform", s.transform), each("other", s.other), each("sweeps", s.sweeps),
      each("certification", s.certification);
}

template <class Each, class R>
void members_of_result(const Each& each, R& r) {
  each("status", r.status), each("reason", r.reason), each("t", r.t), each("y", r.y), each("y_left", r.y_left);
  each("y_integral", r.y_integral), each("x", r.x), each("x_components", r.x_components), each("trace", r.trace);
  each("alternates", r.alternates), each("continuous", r.continuous), each("rough_steps", r.rough_steps);
  each("well_posed", r.well_posed), each("infeasible_at", r.infeasible_at), each("warning", r.warning);
  each("residual", r.residual), each("boundary_residual", r.boundary_residual);
  each("multipliers", r.multipliers), each("start", r.start), each("modes", r.modes);
  each("error_estimate", r.error_estimate), each("algebraic_error", r.algebraic_error);
  each("kernel_error", r.kernel_error), each("magnification", r.magnification), each("rounding", r.rounding);
  each("rounding_of_y", r.rounding_of_y), each("unresolved_sources", r.unresolved_sources);
  each("jumps_inside", r.jumps_inside), each("method", r.method), each("backend", r.backend), each("kernel", r.kernel),
      each("form", r.form);
  each("starts_with_impulse", r.starts_with_impulse), each("euler_steps", r.euler_steps), each("steps", r.steps);
  each("iterations", r.iterations), each("cycles", r.cycles), each("history", r.history);
  each("convolutions", r.convolutions), each("passes", r.passes);
  each("lcp_solved", r.lcp.solved), each("lcp_newton", r.lcp.newton), each("lcp_fallbacks", r.lcp.fallbacks);
  each("lcp_unsolved", r.lcp.unsolved), each("bytes", r.bytes), each("bytes_predicted", r.bytes_predicted);
}

template <class Each, class P>
void members_of_piece(const Each& each, P& p) {
  each("begin", p.begin), each("length", p.length), each("end", p.end), each("x", p.x), each("y", p.y);
  each("integral", p.integral), each("active", p.active), each("event", p.event), each("passed", p.passed);
  each("modes", p.modes);
}

template <class Each, class C>
void members_of_cycle(const Each& each, C& c) {
  each("cells", c.cells), each("sizes", c.sizes), each("quantity", c.quantity), each("estimate", c.estimate);
  each("absolute", c.absolute), each("effectivity", c.effectivity), each("seconds", c.seconds);
}

/// Without the energies, which the package does not show.
template <class Each, class G>
void members_of_goal(const Each& each, G& g) {
  each("quantity", g.quantity), each("scheme", g.scheme), each("adjoint", g.adjoint), each("weights", g.weights);
  each("exact", g.exact);
}

template <class Each, class O>
void members_of_options(const Each& each, O& o) {
  each("method", o.method), each("steps", o.steps), each("tolerance", o.tolerance), each("tolerance_x", o.tolerance_x);
  each("tolerance_y", o.tolerance_y), each("absolute_tolerance", o.absolute_tolerance);
  each("control_states", o.control_states), each("max_steps", o.max_steps), each("max_seconds", o.max_seconds);
  each("iteration_tolerance", o.iteration_tolerance), each("max_iterations", o.max_iterations);
  each("states", o.states), each("components", o.components), each("trace", o.trace);
  each("event_location", o.event_location), each("confirm", o.confirm), each("memory_limit", o.memory_limit);
}

nb::dict state_of(const LocatedSolution& s) {
  nb::dict d;
  nb::list pieces, switches;
  for (const EventPiece& p : s.pieces) {
    nb::dict piece;
    nb::list impulses;
    members_of_piece(Writer{piece}, p);
    for (const EventImpulse& impulse : p.impulses)
      impulses.append(nb::make_tuple(impulse.active, impulse.p, impulse.e));
    piece["impulses"] = impulses;
    pieces.append(piece);
  }
  for (const Switch& w : s.switches) switches.append(nb::make_tuple(w.t, w.component, w.on, w.error));
  d["pieces"] = pieces;
  d["switches"] = switches;
  d["until"] = s.until;
  return d;
}

std::shared_ptr<const LocatedSolution> located_from(const nb::dict& d) {
  auto s = std::make_shared<LocatedSolution>();
  s->until = nb::cast<double>(d["until"]);
  for (const nb::handle entry : nb::cast<nb::list>(d["pieces"])) {
    const auto piece = nb::cast<nb::dict>(entry);
    EventPiece p{};
    members_of_piece(Reader{piece}, p);
    for (const nb::handle impulse : nb::cast<nb::list>(piece["impulses"]))
      p.impulses.push_back(
          {nb::cast<std::vector<Index>>(impulse[0]), nb::cast<Vector>(impulse[1]), nb::cast<Vector>(impulse[2])});
    s->pieces.push_back(std::move(p));
  }
  for (const nb::handle w : nb::cast<nb::list>(d["switches"]))
    s->switches.push_back(
        {nb::cast<double>(w[0]), nb::cast<Index>(w[1]), nb::cast<bool>(w[2]), nb::cast<double>(w[3])});
  return s;
}

nb::dict state_of(const Result& r) {
  nb::dict d, seconds;
  members_of_result(Writer{d}, r);
  members_of_seconds(Writer{seconds}, r.seconds);
  d["seconds"] = seconds;
  std::vector<int> rules;
  for (const IntervalRule rule : r.interval_rules) rules.push_back(int(rule));
  d["interval_rules"] = rules;
  if (r.errors) {
    nb::dict errors;
    members_of_estimate(Writer{errors}, *r.errors);
    d["errors"] = errors;
  }
  if (r.certificate) d["certificate"] = dict_of(*r.certificate);
  if (r.located) d["located"] = state_of(*r.located);
  if (r.defects) d["defects"] = nb::make_tuple(r.defects->steps, r.defects->values);
  if (r.goal) {
    nb::dict goal;
    members_of_goal(Writer{goal}, *r.goal);
    nb::list history;
    for (const GoalCycle& cycle : r.goal->history) {
      nb::dict c;
      members_of_cycle(Writer{c}, cycle);
      history.append(c);
    }
    goal["history"] = history;
    d["goal"] = goal;
  }
  return d;
}

std::shared_ptr<const GoalReport> goal_from(const nb::dict& d) {
  auto goal = std::make_shared<GoalReport>();
  members_of_goal(Reader{d}, *goal);
  for (const nb::handle entry : nb::cast<nb::list>(d["history"])) {
    GoalCycle cycle;
    members_of_cycle(Reader{nb::cast<nb::dict>(entry)}, cycle);
    goal->history.push_back(cycle);
  }
  return goal;
}

Result result_from(const nb::dict& d) {
  Result r;
  members_of_result(Reader{d}, r);
  members_of_seconds(Reader{nb::cast<nb::dict>(d["seconds"])}, r.seconds);
  for (const int rule : nb::cast<std::vector<int>>(d["interval_rules"])) r.interval_rules.push_back(IntervalRule(rule));
  if (d.contains("errors")) {
    r.errors.emplace();
    members_of_estimate(Reader{nb::cast<nb::dict>(d["errors"])}, *r.errors);
  }
  if (d.contains("certificate"))
    members_of_certificate(Reader{nb::cast<nb::dict>(d["certificate"])}, r.certificate.emplace());
  if (d.contains("located")) r.located = located_from(nb::cast<nb::dict>(d["located"]));
  if (r.located) r.mode_changes = mode_changes(*r.located);
  if (d.contains("defects")) {
    const auto parts = nb::cast<nb::tuple>(d["defects"]);
    r.defects = std::make_shared<const StepDefects>(
        StepDefects{nb::cast<std::vector<Index>>(parts[0]), nb::cast<RowMatrix>(parts[1])});
  }
  if (d.contains("goal")) r.goal = goal_from(nb::cast<nb::dict>(d["goal"]));
  return r;
}

nb::object source_of(const std::shared_ptr<const Source>& source) {
  return source ? source->state() : nb::object(nb::none());
}

nb::dict state_of(const Answer& answer) {
  nb::dict d, options;
  members_of_options(Writer{options}, answer.options);
  d["options"] = options;
  d["result"] = state_of(answer.result);
  d["by_keyboard"] = answer.by_keyboard;
  const Model& model = *answer.model;
  if (model.other_x0) d["x0"] = model.scene.x0;
  if (model.other_sources)
    d["sources"] = nb::make_tuple(source_of(model.f), source_of(model.g), model.scene.breakpoints,
                                  model.scene.breakpoints_are_all);
  return d;
}

/// The scene of a Solver whose x0 or sources are others.
std::shared_ptr<Model> changed_model(const Model& model, const std::optional<Vector>& x0, bool other_sources,
                                     const Source* f, const Source* g, std::vector<double> breakpoints, bool all) {
  auto changed = std::make_shared<Model>(model.scene, model.quantity);
  if (x0) changed->scene.x0 = *x0;
  changed->other_x0 = x0.has_value();
  if (!other_sources) return changed;
  changed->other_sources = true;
  changed->f = f ? std::make_shared<const Source>(*f) : nullptr;
  changed->g = g ? std::make_shared<const Source>(*g) : nullptr;
  changed->scene.f = f ? f->function : TimeFunction();
  changed->scene.g = g ? g->function : TimeFunction();
  changed->scene.breakpoints = std::move(breakpoints);
  changed->scene.breakpoints_are_all = all;
  return changed;
}

std::shared_ptr<Answer> answer_from(std::shared_ptr<const Model> model, const nb::dict& d) {
  Options options;
  members_of_options(Reader{nb::cast<nb::dict>(d["options"])}, options);
  Result result = result_from(nb::cast<nb::dict>(d["result"]));
  const auto machine = machine_for({"cpu", {}, 0, 0}, model->scene, options);
  return std::make_shared<Answer>(
      Answer{std::move(model), machine, options, std::move(result), nb::cast<bool>(d["by_keyboard"]), {}});
}

// ---- Scenes that were stated by arrays; the words are those of the setters of Model.

/// Rows, columns, values, row indices and starts of columns, as bind_scenes.cpp reads them.
nb::object compressed(SparseMatrix matrix) {
  matrix.makeCompressed();
  using Values = Eigen::Matrix<SparseMatrix::StorageIndex, Eigen::Dynamic, 1>;
  const Vector values = Eigen::Map<const Vector>(matrix.valuePtr(), matrix.nonZeros());
  const Values rows = Eigen::Map<const Values>(matrix.innerIndexPtr(), matrix.nonZeros());
  const Values starts = Eigen::Map<const Values>(matrix.outerIndexPtr(), matrix.outerSize() + 1);
  return nb::make_tuple(matrix.rows(), matrix.cols(), values, rows, starts);
}

nb::object compressed_or_none(const SparseMatrix& matrix) {
  return matrix.size() == 0 ? nb::object(nb::none()) : compressed(matrix);
}

/// In rows, as the setters take them.
nb::object array(const Matrix& matrix) { return nb::cast(RowMatrix(matrix), nb::rv_policy::copy); }

nb::object array_or_none(const Matrix& matrix) { return matrix.size() == 0 ? nb::object(nb::none()) : array(matrix); }

nb::object callable(const Kept& kept) { return kept ? kept.get() : nb::none(); }

nb::tuple dynamics_of(const Model& model) {
  const Dynamics& dynamics = model.scene.dynamics;
  if (const auto* d = get_if<DenseDynamics>(&dynamics))
    return nb::make_tuple("set_dense", array(d->A), array(d->B), array(d->N), array_or_none(d->E));
  if (const auto* d = get_if<SparseDynamics>(&dynamics))
    return nb::make_tuple("set_sparse", compressed(d->A), compressed(d->B), compressed(d->N), compressed_or_none(d->E));
  if (const auto* d = get_if<KroneckerDynamics>(&dynamics)) {
    const auto difference = [](const SecondDifference& s) {
      return nb::make_tuple(s.points, s.spacing, s.diffusivity, s.first, s.last, s.decay);
    };
    nb::list beside;
    for (const SecondDifference& direction : d->beside) beside.append(difference(direction));
    return nb::make_tuple("set_kronecker", difference(d->along), difference(d->across), d->b, d->n, beside,
                          d->both_faces);
  }
  const auto& d = get<SuppliedDynamics>(dynamics);
  const auto bound = d.bound ? std::optional(std::pair(d.bound->half_angle, d.bound->abscissa)) : std::nullopt;
  return nb::make_tuple("set_supplied", d.states, compressed(d.B), compressed(d.N), callable(model.shifted),
                        callable(model.mass), bound);
}

nb::tuple lcp_matrix_of(const Scene& scene) {
  if (const auto* M = std::get_if<Tridiagonal>(&scene.M))
    return nb::make_tuple("set_M_tridiagonal", M->lower, M->diagonal, M->upper);
  if (const SparseMatrix* M = sparse_of(scene.M)) return nb::make_tuple("set_M_sparse", compressed(*M));
  return nb::make_tuple("set_M", nb::cast(RowMatrix(std::get<Matrix>(scene.M)), nb::rv_policy::copy));
}

nb::dict state_of(const Model& model) {
  static constexpr const char* entries[] = {"x", "B", "F"};
  const Scene& scene = model.scene;
  nb::dict d;
  d["name"] = scene.name;
  d["T"] = scene.T;
  d["steps"] = scene.default_steps;
  d["tolerance"] = scene.default_tolerance;
  d["dynamics"] = dynamics_of(model);
  d["M"] = lcp_matrix_of(scene);
  d["lcp_class"] = to_string(lcp_class_named(to_string(scene.lcp_class)).value_or(LcpClass::automatic));
  d["free_rows"] = scene.free_rows;
  d["restitution"] = scene.restitution;
  d["f_entry"] = nb::make_tuple(entries[int(scene.f_entry)], compressed_or_none(scene.F));
  d["x0"] = scene.x0;
  if (scene.boundary)
    d["boundary"] = nb::make_tuple(RowMatrix(scene.boundary->E0), RowMatrix(scene.boundary->ET), scene.boundary->b);
  return d;
}

}  // namespace

nb::dict dict_of(const Certificate& certificate) {
  nb::dict d;
  members_of_certificate(Writer{d}, certificate);
  return d;
}

void bind_state(nb::module_& m) {
  m.def(
      "state_of_answer", [](const Answer& a) { return state_of(a); }, nb::arg("answer"));
  m.def("answer_from", &answer_from, nb::arg("model"), nb::arg("state"));
  m.def("changed_model", &changed_model, nb::arg("model"), nb::arg("x0").none(), nb::arg("other_sources"),
        nb::arg("f").none(), nb::arg("g").none(), nb::arg("breakpoints"), nb::arg("all"));
  m.def(
      "state_of_model", [](const Model& model) { return state_of(model); }, nb::arg("model"), "All but the sources.");
  m.def(
      "state_of_sources",
      [](const Model& model) { return nb::make_tuple(source_of(model.f), source_of(model.g), model.declared); },
      nb::arg("model"), "f, g and the breakpoints that were given.");
  m.def(
      "source_values",
      [](const Model& model, double t) {
        const Scene& scene = model.scene;
        Vector f = Vector::Zero(scene.sources()), g = Vector::Zero(scene.constraints());
        if (scene.f) scene.f(t, f);
        if (scene.g) scene.g(t, g);
        return std::pair(f, g);
      },
      nb::arg("model"), nb::arg("t"));
}

}  // namespace bromwich::python
