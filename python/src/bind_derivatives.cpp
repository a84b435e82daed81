// Derivatives of results: tables in, tables out.

#include "answer.hpp"
#include "arrays.hpp"
#include "core/base/error.hpp"
#include "derivatives/parameter_derivative.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace bromwich::python {
namespace {

RowMatrix table(const std::optional<Array2>& a) { return a ? RowMatrix(as_matrix(*a)) : RowMatrix(); }

/// Owned by NumPy.
nb::object handed_over(RowMatrix values) {
  auto* kept = new RowMatrix(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<RowMatrix*>(p); });
  return nb::cast(view(*kept, owner));
}

nb::object handed_over(Vector values) {
  auto* kept = new Vector(std::move(values));
  const nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<Vector*>(p); });
  return nb::cast(view(*kept, owner));
}

nb::object or_none(const Matrix& m) { return m.size() > 0 ? handed_over(RowMatrix(m)) : nb::none(); }

std::unique_lock<std::mutex> locked(Machine& machine, const ResultDerivative& d) {
  return d.on_backend() ? std::unique_lock(machine.busy) : std::unique_lock<std::mutex>();
}

/// While a derivative is made that may use the backend.
std::unique_lock<std::mutex> locked(const Answer& answer, bool all_times = false) {
  const bool large = all_times || answer.model->scene.states() > ResultDerivative::largest_written_out;
  return large ? std::unique_lock(answer.machine->busy) : std::unique_lock<std::mutex>();
}

/// With the backend of the result, which is used by one caller at a time.
class AnyDerivative {
 public:
  AnyDerivative(const Answer& answer, std::optional<bool> located, bool all_times)
      : model_(answer.model), machine_(answer.machine), derivative_(made(answer, located, all_times)) {}

  SolutionChange jvp(const DataChange& c, bool states) const {
    const auto lock = locked(*machine_, *derivative_);
    return derivative_->jvp(c, states);
  }
  DataChange vjp(const SolutionChange& c, bool by_x0) const {
    const auto lock = locked(*machine_, *derivative_);
    return derivative_->vjp(c, by_x0);
  }
  /// Of `quantity`; null: that of the scene file.
  QuantityChange quantity(const QuantityOfInterest* quantity) const {
    if (!quantity) quantity = model_->quantity.get();
    if (!quantity) throw Error("quantity", "the scene states none", "give W, c, end_W or end_c");
    return derivative_->quantity(*quantity);
  }
  DerivativeError error(const Answer& answer) const {
    const std::unique_lock lock(machine_->busy);
    return DerivativeError(model_->scene, answer.result, *machine_->backend, *derivative_);
  }
  Machine& machine() const { return *machine_; }
  const ResultDerivative& of_result() const { return *derivative_; }
  const ModalDerivative& of_sum() const { return derivative_->of_sum(); }
  Index states() const { return model_->scene.states(); }
  const SwitchedDerivative* switched() const { return derivative_->switched(); }

 private:
  static std::unique_ptr<ResultDerivative> made(const Answer& answer, std::optional<bool> located, bool all_times) {
    const auto lock = locked(answer, all_times);
    return std::make_unique<ResultDerivative>(answer.model->scene, answer.result, *answer.machine->backend,
                                              DerivativeChoice{.located = located, .all_times = all_times});
  }

  std::shared_ptr<const Model> model_;
  std::shared_ptr<Machine> machine_;
  std::unique_ptr<ResultDerivative> derivative_;
};

/// The estimated errors of an AnyDerivative, which Python keeps alive.
class AnyError {
 public:
  AnyError(const AnyDerivative& of, const Answer& answer) : machine_(of.machine()), error_(of.error(answer)) {}

  SolutionChange jvp(const DataChange& c, bool states) const {
    const std::unique_lock lock(machine_.busy);
    return error_.of_jvp(c, states);
  }
  DataChange vjp(const SolutionChange& c, bool by_x0) const {
    const std::unique_lock lock(machine_.busy);
    return error_.of_vjp(c, by_x0);
  }

 private:
  Machine& machine_;
  DerivativeError error_;
};

/// With respect to parameters. `scene_of` is a function of Python: (name, value) to a model.
class ByParameters {
 public:
  ByParameters(const Answer& answer, const std::vector<std::string>& names, const std::vector<double>& values,
               const nb::callable& scene_of, std::optional<bool> located)
      : model_(answer.model), machine_(answer.machine) {
    std::vector<VariedParameter> parameters;
    for (std::size_t i = 0; i < names.size(); ++i)
      parameters.push_back({names[i], values.at(i), [&scene_of, name = names[i]](double value) {
                              const auto model = nb::cast<std::shared_ptr<Model>>(scene_of(name, value));
                              return ParameterScene{model->scene, model->quantity};
                            }});
    const auto lock = locked(answer);
    derivative_ =
        std::make_unique<ParameterDerivative>(model_->scene, answer.result, *machine_->backend, parameters, located);
  }

  SolutionChange jvp(const Vector& by, bool states) const {
    const auto lock = locked(*machine_, derivative_->of_data());
    return derivative_->jvp(by, states);
  }
  Vector vjp(const SolutionChange& c) const {
    const auto lock = locked(*machine_, derivative_->of_data());
    return derivative_->vjp(c);
  }
  const ParameterDerivative& derivative() const { return *derivative_; }
  const ResultDerivative& of_result() const { return derivative_->of_data(); }
  Index states() const { return model_->scene.states(); }

 private:
  std::shared_ptr<const Model> model_;
  std::shared_ptr<Machine> machine_;
  std::unique_ptr<ParameterDerivative> derivative_;
};

nb::tuple tables_of(SolutionChange c) {
  return nb::make_tuple(handed_over(std::move(c.y)), handed_over(std::move(c.x)), handed_over(std::move(c.w)),
                        handed_over(std::move(c.integral)));
}

template <class D>
nb::tuple forward(const D& d, const std::optional<Array1>& x0, const std::optional<Array2>& f,
                  const std::optional<Array2>& g, const std::optional<Array2>& A, const std::optional<Array2>& B,
                  const std::optional<Array2>& N, const std::optional<Array2>& M, const std::optional<Array2>& E,
                  const std::optional<Array1>& b, const std::optional<Array2>& E0, const std::optional<Array2>& ET,
                  const std::optional<Array1>& restitution, bool states) {
  const auto values = [](const std::optional<Array1>& v) { return v ? Vector(as_vector(*v)) : Vector(); };
  return tables_of(d.jvp({values(x0), table(f), table(g), table(A), table(B), table(N), table(M), table(E), values(b),
                          table(E0), table(ET), values(restitution)},
                         states));
}

template <class D>
nb::tuple backward(const D& d, const std::optional<Array2>& y, const std::optional<Array2>& x,
                   const std::optional<Array2>& w, const std::optional<Array2>& integral, bool x0) {
  DataChange g = d.vjp({table(y), table(x), table(w), table(integral)}, x0);
  const auto values = [](Vector& v) { return v.size() > 0 ? handed_over(std::move(v)) : nb::none(); };
  const auto rows = [](RowMatrix& m) { return m.rows() > 0 ? handed_over(std::move(m)) : nb::none(); };
  return nb::make_tuple(values(g.x0), rows(g.f), rows(g.g), or_none(g.A), or_none(g.B), or_none(g.N), or_none(g.M),
                        or_none(g.E), values(g.b), or_none(g.E0), or_none(g.ET), values(g.restitution));
}

nb::tuple forward_by_sum(const AnyDerivative& d, double face, double across, double decay, double input, double output,
                         bool states) {
  return tables_of(d.of_sum().jvp(KroneckerChange{face, across, decay, input, output}, states));
}

/// By face, across, decay, B and N.
std::vector<double> backward_by_sum(const AnyDerivative& d, const std::optional<Array2>& y,
                                    const std::optional<Array2>& x, const std::optional<Array2>& w,
                                    const std::optional<Array2>& integral) {
  const SolutionChange of{table(y), table(x), table(w), table(integral)};
  const ModalDerivative& sum = d.of_sum();
  const DataChange gradient = sum.vjp(of);
  std::vector<double> found;
  for (const auto parameter : {&KroneckerChange::face, &KroneckerChange::across, &KroneckerChange::decay,
                               &KroneckerChange::input, &KroneckerChange::output}) {
    KroneckerChange c;
    c.*parameter = 1;
    found.push_back(sum.along(c, of, gradient));
  }
  return found;
}

/// The quantity with these members; null without any.
std::shared_ptr<const QuantityOfInterest> quantity_of(const std::optional<Array2>& W, const Source* c,
                                                      const std::optional<Array2>& end_W,
                                                      const std::optional<Array1>& end_c, Index states) {
  if (!W && !c && !end_W && !end_c) return nullptr;
  QuadraticQuantity q;
  if (W) q.W = as_matrix(*W).sparseView();
  if (end_W) q.end_W = as_matrix(*end_W).sparseView();
  if (end_c) q.end_c = as_vector(*end_c);
  if (c) q.c = c->function;
  return quadratic_quantity(q, states);
}

/// (value, x weights) of the quantity of the scene file, or of one with these members.
nb::tuple quantity(const AnyDerivative& d, const std::optional<Array2>& W, const Source* c,
                   const std::optional<Array2>& end_W, const std::optional<Array1>& end_c) {
  QuantityChange found = d.quantity(quantity_of(W, c, end_W, end_c, d.states()).get());
  return nb::make_tuple(found.value, handed_over(std::move(found.weights.x)));
}

/// (value, gradient), likewise.
nb::tuple quantity_by_parameters(const ByParameters& d, const std::optional<Array2>& W, const Source* c,
                                 const std::optional<Array2>& end_W, const std::optional<Array1>& end_c) {
  const auto given = quantity_of(W, c, end_W, end_c, d.states());
  const QuantityByParameters q = given ? d.derivative().quantity(*given) : d.derivative().quantity();
  return nb::make_tuple(q.value, std::vector<double>(q.gradient.begin(), q.gradient.end()));
}

nb::tuple margin_of(const ResultDerivative& d) {
  const DerivativeMargin& at = d.margin();
  return nb::make_tuple(at.margin, at.time, at.constraint, at.transversality, at.grazing_time);
}

nb::object times_of_switches(const ResultDerivative& d) {
  return d.switched() ? nb::cast(d.switched()->switches()) : nb::none();
}

/// What a derivative has of that of the result, with respect to data or to parameters.
template <class D>
nb::class_<D> bind_result_derivative(nb::module_& m, const char* name) {
  return nb::class_<D>(m, name)
      .def_prop_ro("margin", [](const D& d) { return margin_of(d.of_result()); })
      .def_prop_ro("form", [](const D& d) { return to_string(d.of_result().form()); })
      .def_prop_ro("switches", [](const D& d) { return times_of_switches(d.of_result()); })
      .def_prop_ro("states", &D::states);
}

/// jvp and vjp.
template <class D>
void bind_passes(nb::class_<D>& c) {
  c.def("jvp", &forward<D>, nb::arg("x0").none(), nb::arg("f").none(), nb::arg("g").none(), nb::arg("A").none(),
        nb::arg("B").none(), nb::arg("N").none(), nb::arg("M").none(), nb::arg("E").none(), nb::arg("b").none(),
        nb::arg("E0").none(), nb::arg("ET").none(), nb::arg("restitution").none(), nb::arg("states"))
      .def("vjp", &backward<D>, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(),
           nb::arg("integral").none(), nb::arg("x0"));
}

void bind_parameters(nb::module_& m) {
  bind_result_derivative<ByParameters>(m, "ParameterDerivative")
      .def(nb::init<const Answer&, const std::vector<std::string>&, const std::vector<double>&, const nb::callable&,
                    std::optional<bool>>(),
           nb::arg("answer"), nb::arg("names"), nb::arg("values"), nb::arg("scene_of"), nb::arg("located").none())
      .def_prop_ro("words", [](const ByParameters& d) { return d.derivative().in_words(); })
      .def_prop_ro("one_sided", [](const ByParameters& d) { return d.derivative().one_sided(); })
      .def(
          "jvp",
          [](const ByParameters& d, const Array1& by, bool states) { return tables_of(d.jvp(as_vector(by), states)); },
          nb::arg("by"), nb::arg("states"))
      .def(
          "vjp",
          [](const ByParameters& d, const std::optional<Array2>& y, const std::optional<Array2>& x,
             const std::optional<Array2>& w, const std::optional<Array2>& integral) {
            const Vector by = d.vjp({table(y), table(x), table(w), table(integral)});
            return std::vector<double>(by.begin(), by.end());
          },
          nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(), nb::arg("integral").none())
      .def("quantity", &quantity_by_parameters, nb::arg("W").none(), nb::arg("c").none(), nb::arg("end_W").none(),
           nb::arg("end_c").none());
}

}  // namespace

void bind_derivatives(nb::module_& m) {
  auto derivative = bind_result_derivative<AnyDerivative>(m, "Derivative");
  derivative
      .def(nb::init<const Answer&, std::optional<bool>, bool>(), nb::arg("answer"), nb::arg("located").none(),
           nb::arg("all_times"))
      .def_prop_ro(
          "one_sided",
          [](const AnyDerivative& d) { return d.switched() ? d.switched()->one_sided() : std::vector<Index>(); })
      .def_prop_ro("without_M",
                   [](const AnyDerivative& d) { return d.switched() ? d.switched()->without_M() : std::string(); })
      .def("jvp_parameters", &forward_by_sum, nb::arg("face"), nb::arg("across"), nb::arg("decay"), nb::arg("B"),
           nb::arg("N"), nb::arg("states"))
      .def("vjp_parameters", &backward_by_sum, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(),
           nb::arg("integral").none())
      .def("quantity", &quantity, nb::arg("W").none(), nb::arg("c").none(), nb::arg("end_W").none(),
           nb::arg("end_c").none())
      .def(
          "error", [](const AnyDerivative& d, const Answer& answer) { return new AnyError(d, answer); },
          nb::arg("answer"), nb::rv_policy::take_ownership, nb::keep_alive<0, 1>());
  bind_passes(derivative);
  nb::class_<AnyError> error(m, "DerivativeError");
  bind_passes(error);
  bind_parameters(m);
}

}  // namespace bromwich::python
