// Nonlinear complementarity systems: functions of t, x and y, and their results.

#include "arrays.hpp"
#include "calls.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/result/switching.hpp"
#include "files/nonlinear_file.hpp"
#include "machine.hpp"
#include "module.hpp"
#include "nonlinear/nonlinear_output.hpp"

#include <nanobind/eigen/dense.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <string>
#include <utility>

namespace bromwich::python {
namespace {

struct NonlinearAnswer {
  NonlinearResult result;
  std::string backend;
  double seconds = 0;
  bool by_keyboard = false;
  std::shared_ptr<const NonlinearScene> scene = {};
  std::shared_ptr<Machine> machine = {};
};

/// phi and gamma of a file; the linear part is a Model.
struct NonlinearTerms {
  NonlinearScene scene;
};

/// (Model, NonlinearTerms, facts) of a file with a section [nonlinear].
nb::tuple read_nonlinear(const std::string& file, const ParameterValues& settings) {
  NonlinearFile read = [&] {
    const nb::gil_scoped_release unlocked;
    return read_nonlinear_file(std::filesystem::path(file), settings);
  }();
  if (!read.system) throw Error("scene", file + " has no section [nonlinear]", "use Scene.from_toml and solve");
  nb::dict facts;
  facts["description"] = read.file.description;
  facts["parameters"] = read.file.parameters;
  facts["warning"] = read.file.warning;
  return nb::make_tuple(std::make_shared<Model>(std::move(read.file.scene)),
                        std::make_shared<NonlinearTerms>(NonlinearTerms{std::move(*read.system)}), facts);
}

std::shared_ptr<NonlinearAnswer> at_other_times(const NonlinearAnswer& answer, const std::vector<double>& times) {
  return interruptible([&] {
    const std::lock_guard lock(answer.machine->busy);
    auto rows = std::make_shared<NonlinearAnswer>(answer);
    rows->result = nonlinear_at(*answer.scene, *answer.machine->backend, answer.result, times);
    return rows;
  });
}

nb::list nonlinear_switches(const NonlinearAnswer& answer) {
  nb::list all;
  for (const Switch& s : switches(as_result(*answer.scene, answer.result)))
    all.append(nb::make_tuple(s.t, s.component, s.on, s.error));
  return all;
}

/// What a function of t, x and y returns. The arrays are made one by one: where one of several fails, as by Ctrl-C,
/// nanobind goes on to the next one with an exception set.
nb::object called(const Kept& function, double t, const Eigen::Ref<const Vector>& x,
                  const Eigen::Ref<const Vector>& y) {
  const nb::object of_x = nb::cast(Vector(x)), of_y = nb::cast(Vector(y));
  return function.get()(t, of_x, of_y);
}

NonlinearFunction function_of(const std::string& name, nb::object given) {
  if (given.is_none()) return {};
  return [name, call = Kept(std::move(given))](double t, const Eigen::Ref<const Vector>& x,
                                               const Eigen::Ref<const Vector>& y, Eigen::Ref<Vector> value) {
    const nb::gil_scoped_acquire lock;
    const Vector found = as_vector(nb::cast<Array1>(called(call, t, x, y)));
    if (found.size() != value.size())
      throw Error(name, "returns " + std::to_string(found.size()) + " values",
                  "return " + std::to_string(value.size()));
    value = found;
  };
}

// A function that returns (by x, by y).
NonlinearDerivative derivative_of(const std::string& name, nb::object given) {
  if (given.is_none()) return {};
  return [name, call = Kept(std::move(given))](double t, const Eigen::Ref<const Vector>& x,
                                               const Eigen::Ref<const Vector>& y, Eigen::Ref<Matrix> by_x,
                                               Eigen::Ref<Matrix> by_y) {
    const nb::gil_scoped_acquire lock;
    const auto both = nb::cast<nb::tuple>(called(call, t, x, y));
    const auto take = [&](std::size_t k, Eigen::Ref<Matrix> to) {
      const Matrix found = as_matrix(nb::cast<Array2>(both[k]));
      if (found.rows() != to.rows() || found.cols() != to.cols())
        throw Error(name,
                    "returns a " + std::to_string(found.rows()) + " x " + std::to_string(found.cols()) + " matrix",
                    "return " + std::to_string(to.rows()) + " x " + std::to_string(to.cols()));
      to = found;
    };
    take(0, by_x);
    take(1, by_y);
  };
}

NonlinearMethod method_of(const std::string& word) {
  for (const NonlinearMethod m : {NonlinearMethod::automatic, NonlinearMethod::march, NonlinearMethod::iteration,
                                  NonlinearMethod::newton, NonlinearMethod::pointwise})
    if (word == to_string(m) || (word == "auto" && m == NonlinearMethod::automatic)) return m;
  throw Error("method", "\"" + word + "\" is not known", "use auto, march, iteration, newton or pointwise");
}

Method inner_of(const std::string& word) {
  for (const Method m : {Method::automatic, Method::march, Method::contour, Method::multigrid})
    if (word == to_string(m)) return m;
  throw Error("inner", "found '" + word + "'", "use auto, march, contour or multigrid");
}

std::shared_ptr<NonlinearAnswer> solve_one(const std::shared_ptr<const Model>& model, nb::object phi, nb::object gamma,
                                           nb::object dphi, nb::object dgamma,
                                           const std::shared_ptr<const NonlinearTerms>& terms, bool of_trace,
                                           const std::string& method, const std::string& inner, Index steps, double tol,
                                           Index max_steps, double iteration_tol, const Wanted& wanted,
                                           nb::object stop) {
  Calls calls(nb::none(), std::move(stop));
  NonlinearScene scene;
  if (terms) {
    scene = terms->scene;
  } else {
    scene.phi = function_of("phi", std::move(phi));
    scene.gamma = function_of("gamma", std::move(gamma));
    scene.dphi = derivative_of("dphi", std::move(dphi));
    scene.dgamma = derivative_of("dgamma", std::move(dgamma));
    scene.of_trace = of_trace;
  }
  NonlinearOptions options;
  options.method = method_of(method);
  options.inner = inner_of(inner);
  options.steps = steps;
  options.error = tol;
  if (max_steps > 0) options.max_steps = max_steps;
  if (iteration_tol > 0) options.tolerance = iteration_tol;
  options.interrupted = [&] { return calls.interrupted(); };
  return unlocked(calls, [&] {
    auto answer = std::make_shared<NonlinearAnswer>();
    for (const auto& forget : model->forget) forget();
    scene.linear = model->scene;
    const auto machine = machine_for(wanted, scene.linear, {});
    const std::lock_guard lock(machine->busy);
    answer->backend = machine->backend->name();
    Timer timer;
    answer->result = solve_nonlinear(scene, *machine->backend, options);
    answer->seconds = timer.lap();
    answer->scene = std::make_shared<const NonlinearScene>(std::move(scene));
    answer->machine = machine;
    return answer;
  });
}

}  // namespace

void bind_nonlinear(nb::module_& m) {
  using Self = nb::handle_t<NonlinearAnswer>;
  const auto of = [](Self self) -> const NonlinearResult& { return nb::cast<NonlinearAnswer&>(self).result; };
  nb::class_<NonlinearAnswer>(m, "NonlinearAnswer", "Result of a nonlinear system.")
      .def_prop_ro("status", [](const NonlinearAnswer& a) { return std::string(to_string(a.result.status)); })
      .def_prop_ro("reason", [](const NonlinearAnswer& a) { return a.result.reason; })
      .def_prop_ro("warning", [](const NonlinearAnswer& a) { return a.result.warning; })
      .def_prop_ro("t", [of](Self self) { return view(of(self).t, self); })
      .def_prop_ro("x", [of](Self self) { return view(of(self).x, self); })
      .def_prop_ro("y", [of](Self self) { return view(of(self).y, self); })
      .def_prop_ro("w", [of](Self self) { return view(of(self).w, self); })
      .def_prop_ro("trace", [of](Self self) { return view(of(self).trace, self); })
      .def("at", &at_other_times, nb::arg("times"))
      .def("switches", &nonlinear_switches)
      .def_prop_ro("method", [](const NonlinearAnswer& a) { return std::string(to_string(a.result.method)); })
      .def_prop_ro("continuous", [](const NonlinearAnswer& a) { return a.result.continuous; })
      .def_prop_ro("residual", [](const NonlinearAnswer& a) { return a.result.residual; })
      .def_prop_ro("defect", [](const NonlinearAnswer& a) { return a.result.defect; })
      .def_prop_ro("error_estimate", [](const NonlinearAnswer& a) { return a.result.error_estimate; })
      .def_prop_ro("error_estimate_of", [](const NonlinearAnswer& a) { return estimated_quantity(a.result); })
      .def_prop_ro("newton", [](const NonlinearAnswer& a) { return a.result.newton; })
      .def_prop_ro("solves", [](const NonlinearAnswer& a) { return a.result.solves; })
      .def_prop_ro("windows", [](const NonlinearAnswer& a) { return a.result.windows; })
      .def_prop_ro("marched", [](const NonlinearAnswer& a) { return a.result.marched; })
      .def_prop_ro("contraction", [](const NonlinearAnswer& a) { return a.result.contraction; })
      .def_prop_ro("backend", [](const NonlinearAnswer& a) { return a.backend; })
      .def_ro("seconds", &NonlinearAnswer::seconds)
      .def_ro("by_keyboard", &NonlinearAnswer::by_keyboard);
  nb::class_<NonlinearTerms>(m, "NonlinearTerms", "phi and gamma of a scene file.");
  m.def("read_nonlinear", &read_nonlinear, nb::arg("file"), nb::arg("settings"));
  m.def("solve_nonlinear", &solve_one, nb::arg("model"), nb::arg("phi").none(), nb::arg("gamma").none(),
        nb::arg("dphi").none(), nb::arg("dgamma").none(), nb::arg("terms").none(), nb::arg("of_trace"),
        nb::arg("method"), nb::arg("inner"), nb::arg("steps"), nb::arg("tol"), nb::arg("max_steps"),
        nb::arg("iteration_tol"), nb::arg("wanted"), nb::arg("stop").none());
}

}  // namespace bromwich::python
