// Results: arrays are views of what the solve has computed, and keep it alive.

#include "answer.hpp"
#include "arrays.hpp"
#include "calls.hpp"
#include "core/base/error.hpp"
#include "core/result/estimated_quantity.hpp"
#include "core/result/located_solution.hpp"
#include "core/result/slack.hpp"
#include "core/result/switching.hpp"
#include "core/solve/dense_output.hpp"
#include "core/solve/switch_errors.hpp"

#include <nanobind/stl/complex.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>

namespace bromwich::python {
namespace {

std::optional<View> slack_of(nb::handle_t<Answer> self) {
  auto& answer = nb::cast<Answer&>(self);
  if (!answer.slack) answer.slack = slack(answer.model->scene, answer.result);
  if (answer.slack->rows() == 0) return std::nullopt;
  return view(*answer.slack, self);
}

std::shared_ptr<Answer> at(const Answer& answer, const std::vector<double>& times) {
  return interruptible([&] {
    const std::lock_guard lock(answer.machine->busy);
    return std::make_shared<Answer>(
        Answer{answer.model,
               answer.machine,
               answer.options,
               at_times(answer.model->scene, *answer.machine->backend, answer.result, times),
               false,
               {}});
  });
}

nb::list in_list(const std::vector<Switch>& found, const std::vector<Index>& free) {
  nb::list all;
  for (const Switch& s : found)  // y of free rows has a sign but no switches
    if (!std::binary_search(free.begin(), free.end(), s.component))
      all.append(nb::make_tuple(s.t, s.component, s.on, s.error));
  return all;
}

nb::list switches_of(const Answer& answer, bool with_errors) {
  std::vector<Switch> found = [&] {
    const nb::gil_scoped_release unlocked;
    if (!with_errors) {
      std::vector<Switch> of_rows = switches(answer.result);
      if (answer.result.y_left.size() > 0)  // by how much the grid moves them is not known
        for (Switch& s : of_rows) s.error = NAN;
      return of_rows;
    }
    const std::lock_guard lock(answer.machine->busy);
    return switches_with_errors(answer.model->scene, *answer.machine->backend, answer.options, answer.result);
  }();
  return in_list(found, answer.model->scene.free_rows);
}

/// Of rows without the rest of a result. `lines`: y is linear between rows of equal distance; otherwise only the step
/// is known.
nb::list switches_of_rows(const Array1& t, const Array2& y, bool lines, const std::vector<Index>& free) {
  Result rows;
  rows.t = as_vector(t);
  rows.y = as_matrix(y);
  if (!lines) rows.goal = std::make_shared<const GoalReport>();
  return in_list(switches(rows), free);
}

nb::dict seconds_of(const Answer& answer) {
  const Seconds& s = answer.result.seconds;
  nb::dict d;
  d["total"] = s.total;
  d["setup"] = s.setup;
  d["solve"] = s.solve;
  d["lcp"] = s.lcp;
  d["convolution"] = s.convolution;
  d["transform"] = s.transform;
  d["other"] = s.other;
  d["certification"] = s.certification;
  return d;
}

std::optional<nb::dict> errors_of(const Answer& answer) {
  if (!answer.result.errors) return std::nullopt;
  const ErrorEstimate& e = *answer.result.errors;
  nb::dict d;
  d["y"] = e.total();
  d["states"] = e.states;
  d["discretisation"] = e.discretisation;
  d["kernel"] = e.kernel;
  d["iteration"] = e.iteration;
  d["rounding"] = e.rounding;
  d["interior"] = e.interior;
  d["order"] = e.order;
  d["tolerance"] = e.tolerance;
  d["of_integral"] = e.of_integral;
  d["grids"] = e.grids;
  d["estimates"] = e.estimates;
  return d;
}

std::optional<nb::dict> certificate_of(const Answer& answer) {
  if (!answer.result.certificate) return std::nullopt;
  return dict_of(*answer.result.certificate);
}

std::optional<nb::dict> goal_of(const Answer& answer) {
  if (!answer.result.goal) return std::nullopt;
  const GoalReport& goal = *answer.result.goal;
  nb::dict d;
  d["quantity"] = goal.quantity;
  d["scheme"] = goal.scheme;
  d["adjoint"] = goal.adjoint;
  d["weights"] = goal.weights;
  d["exact"] = goal.exact;
  nb::list history;
  for (const GoalCycle& cycle : goal.history) {
    nb::dict c;
    c["cells"] = cycle.cells;
    c["quantity"] = cycle.quantity;
    c["estimate"] = cycle.estimate;
    c["absolute"] = cycle.absolute;
    c["effectivity"] = cycle.effectivity;
    c["seconds"] = cycle.seconds;
    history.append(c);
  }
  d["history"] = history;
  return d;
}

template <auto Member>
auto array_of() {
  return [](nb::handle_t<Answer> self) { return view(nb::cast<const Answer&>(self).result.*Member, self); };
}

template <auto Member>
auto value_of() {
  return [](const Answer& answer) { return answer.result.*Member; };
}

}  // namespace

void bind_results(nb::module_& m) {
  nb::class_<Answer>(m, "Answer", "What a solve has computed. Arrays are read-only views.")
      .def_prop_ro("status", [](const Answer& a) { return to_string(a.result.status); })
      .def_prop_ro("reason", value_of<&Result::reason>())
      .def_prop_ro("warning", value_of<&Result::warning>())
      .def_prop_ro("t", array_of<&Result::t>())
      .def_prop_ro("y", array_of<&Result::y>())
      .def_prop_ro("y_left", array_of<&Result::y_left>())
      .def_prop_ro("x", array_of<&Result::x>())
      .def_prop_ro("trace", array_of<&Result::trace>())
      .def_prop_ro("w", &slack_of)
      .def_prop_ro("x_components", value_of<&Result::x_components>())
      .def("y_integral",
           [](const Answer& a) {
             auto* values = new RowMatrix(integral_of_y(a.result));
             const nb::capsule owner(values, [](void* p) noexcept { delete static_cast<RowMatrix*>(p); });
             return view(*values, owner);
           })
      .def("piece_begins",
           [](const Answer& a) {
             std::vector<double> begins;
             if (a.result.located)
               for (const EventPiece& piece : a.result.located->pieces) begins.push_back(piece.begin);
             return begins;
           })
      .def_prop_ro("residual", value_of<&Result::residual>())
      .def_prop_ro("boundary_residual", value_of<&Result::boundary_residual>())
      .def_prop_ro("multipliers", value_of<&Result::multipliers>())
      .def_prop_ro("error_estimate", value_of<&Result::error_estimate>())
      .def_prop_ro("error_estimate_of", [](const Answer& a) { return estimated_quantity(a.result); })
      .def_prop_ro("errors", &errors_of)
      .def_prop_ro("certificate", &certificate_of)
      .def_prop_ro("kernel_error", value_of<&Result::kernel_error>())
      .def_prop_ro("infeasible_at", value_of<&Result::infeasible_at>())
      .def_prop_ro("method", [](const Answer& a) { return to_string(a.result.method); })
      .def_prop_ro("backend", value_of<&Result::backend>())
      .def_prop_ro("kernel", value_of<&Result::kernel>())
      .def_prop_ro("continuous", value_of<&Result::continuous>())
      .def_prop_ro("starts_with_impulse", value_of<&Result::starts_with_impulse>())
      .def_prop_ro("steps", value_of<&Result::steps>())
      .def_prop_ro("iterations", value_of<&Result::iterations>())
      .def_prop_ro("cycles", value_of<&Result::cycles>())
      .def_prop_ro("history", value_of<&Result::history>())
      .def_prop_ro("bytes", value_of<&Result::bytes>())
      .def_prop_ro("seconds", &seconds_of)
      .def_prop_ro("goal", &goal_of)
      .def_ro("by_keyboard", &Answer::by_keyboard)
      .def("at", &at, nb::arg("times"))
      .def("switches", &switches_of, nb::arg("with_errors"));
  m.def("switches_of_rows", &switches_of_rows, nb::arg("t"), nb::arg("y"), nb::arg("lines"), nb::arg("free"));
}

}  // namespace bromwich::python
