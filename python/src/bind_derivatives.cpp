// Derivatives of results: tables in, tables out.

#include "answer.hpp"
#include "arrays.hpp"
#include "core/base/error.hpp"
#include "core/derivatives/galerkin_derivative.hpp"
#include "core/derivatives/modal_derivative.hpp"
#include "core/derivatives/quantity_derivative.hpp"
#include "core/derivatives/space_time_derivative.hpp"
#include "core/derivatives/switched_derivative.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/optional.h>
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

constexpr Index largest_written_out = 1000;  ///< states that SolutionDerivative takes

/// Of the discrete solution, with located switches where y may jump. Scenes with many states have theirs over all time
/// points on the backend of the result, or in modes on the host; boundary-value problems that of method galerkin.
class AnyDerivative {
 public:
  AnyDerivative(const Answer& answer, std::optional<bool> located) : model_(answer.model), machine_(answer.machine) {
    const Scene& scene = answer.model->scene;
    const Result& result = answer.result;
    const bool jumps = y_may_jump(result) || result.method == Method::events;
    if (scene.boundary && !located.value_or(false)) {
      galerkin_.emplace(scene, result);
    } else if (located.value_or(result.status == Status::solved && jumps)) {
      if (result.status != Status::solved)
        throw Error("derivative", "the result is not solved", "differentiate a result with status solved");
      switched_.emplace(scene, result.t);
    } else if (scene.states() <= largest_written_out) {
      discrete_.emplace(scene, result);
    } else {
      const std::lock_guard lock(machine_->busy);
      const KroneckerDynamics* modes = scene.dynamics->modes();
      const bool in_modes = modes && !modes->both_faces;
      if (!in_modes || space_time_pays(*machine_->backend, scene, result))
        space_time_ = std::make_unique<SpaceTimeDerivative>(scene, result, *machine_->backend);
      else
        modal_.emplace(scene, result);
    }
    if (scene.dynamics->modes() && !modal_ && !switched_ && !galerkin_) {
      result_ = result;
      result_->x.resize(0, 0);
    }
  }

  /// Which of the derivatives of docs/derivatives.md it is.
  const char* form() const {
    if (space_time_) return "over all time points";
    if (galerkin_) return "boundary values";
    return switched_ ? "located switches" : modal_ ? "modes" : "discrete solution";
  }

  /// `states`: those of scenes with many states, too.
  SolutionChange jvp(const DataChange& c, bool states) const {
    if (space_time_) {
      const std::lock_guard lock(machine_->busy);
      return space_time_->jvp(c, states);
    }
    if (galerkin_) return galerkin_->jvp(c);
    return switched_ ? switched_->jvp(c) : modal_ ? modal_->jvp(c, states) : discrete_->jvp(c);
  }
  /// Without `by_x0`: without x0 where that costs more than all others.
  DataChange vjp(const SolutionChange& c, bool by_x0) const {
    if (space_time_) {
      const std::lock_guard lock(machine_->busy);
      return space_time_->vjp(c, by_x0);
    }
    if (galerkin_) return galerkin_->vjp(c);
    return switched_ ? switched_->vjp(c) : modal_ ? modal_->vjp(c) : discrete_->vjp(c);
  }
  const DerivativeMargin& margin() const {
    if (space_time_) return space_time_->margin();
    if (galerkin_) return galerkin_->margin();
    return switched_ ? switched_->margin() : modal_ ? modal_->margin() : discrete_->margin();
  }
  /// Of `quantity`; null: that of the scene file.
  QuantityChange quantity(const QuantityOfInterest* quantity) const {
    if (!quantity) quantity = model_->quantity.get();
    if (!quantity) throw Error("quantity", "the scene states none", "give W, c, end_W or end_c");
    if (modal_ || space_time_) throw Error("quantity", "states of large scenes are not kept", "weigh y, w or integral");
    if (galerkin_) return quantity_change(*quantity, model_->scene, galerkin_->times(), galerkin_->states());
    return switched_ ? quantity_change(*quantity, model_->scene, switched_->times(), switched_->values().x)
                     : quantity_change(*quantity, model_->scene, discrete_->times(), discrete_->states());
  }
  /// In modes of a Kronecker sum; made on the first call where another class has the rest.
  const ModalDerivative& of_sum() const {
    if (modal_) return *modal_;
    if (!result_) throw Error("parameters", "are those of a Kronecker sum with a continuous y", "change A, B and N");
    const std::lock_guard lock(of_sum_->made);
    if (!of_sum_->derivative) of_sum_->derivative.emplace(model_->scene, *result_);
    return *of_sum_->derivative;
  }
  Index states() const { return model_->scene.states(); }
  const SwitchedDerivative* switched() const { return switched_ ? &*switched_ : nullptr; }

 private:
  std::shared_ptr<const Model> model_;
  std::shared_ptr<Machine> machine_;
  std::optional<SolutionDerivative> discrete_;
  std::unique_ptr<SpaceTimeDerivative> space_time_;
  std::optional<ModalDerivative> modal_;
  std::optional<SwitchedDerivative> switched_;
  std::optional<GalerkinDerivative> galerkin_;
  struct OfSum {
    std::mutex made;
    std::optional<ModalDerivative> derivative;
  };
  std::optional<Result> result_;  ///< of a Kronecker sum, for of_sum_
  std::unique_ptr<OfSum> of_sum_ = std::make_unique<OfSum>();
};

nb::tuple forward(const AnyDerivative& d, const std::optional<Array1>& x0, const std::optional<Array2>& f,
                  const std::optional<Array2>& g, const std::optional<Array2>& A, const std::optional<Array2>& B,
                  const std::optional<Array2>& N, const std::optional<Array2>& M, const std::optional<Array2>& E,
                  const std::optional<Array1>& b, bool states) {
  const auto values = [](const std::optional<Array1>& v) { return v ? Vector(as_vector(*v)) : Vector(); };
  SolutionChange c =
      d.jvp({values(x0), table(f), table(g), table(A), table(B), table(N), table(M), table(E), values(b)}, states);
  return nb::make_tuple(handed_over(std::move(c.y)), handed_over(std::move(c.x)), handed_over(std::move(c.w)),
                        handed_over(std::move(c.integral)));
}

nb::tuple backward(const AnyDerivative& d, const std::optional<Array2>& y, const std::optional<Array2>& x,
                   const std::optional<Array2>& w, const std::optional<Array2>& integral, bool x0) {
  DataChange g = d.vjp({table(y), table(x), table(w), table(integral)}, x0);
  const auto values = [](Vector& v) { return v.size() > 0 ? handed_over(std::move(v)) : nb::none(); };
  return nb::make_tuple(values(g.x0), handed_over(std::move(g.f)), handed_over(std::move(g.g)), or_none(g.A),
                        or_none(g.B), or_none(g.N), or_none(g.M), or_none(g.E), values(g.b));
}

nb::tuple forward_by_sum(const AnyDerivative& d, double face, double across, double decay, double input, double output,
                         bool states) {
  SolutionChange c = d.of_sum().jvp(KroneckerChange{face, across, decay, input, output}, states);
  return nb::make_tuple(handed_over(std::move(c.y)), handed_over(std::move(c.x)), handed_over(std::move(c.w)),
                        handed_over(std::move(c.integral)));
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

/// (value, x weights) of the quantity of the scene file, or of one with these members.
nb::tuple quantity(const AnyDerivative& d, const std::optional<Array2>& W, const Source* c,
                   const std::optional<Array2>& end_W, const std::optional<Array1>& end_c) {
  QuadraticQuantity q;
  if (W) q.W = as_matrix(*W).sparseView();
  if (end_W) q.end_W = as_matrix(*end_W).sparseView();
  if (end_c) q.end_c = as_vector(*end_c);
  if (c) q.c = c->function;
  const bool own = W || c || end_W || end_c;
  QuantityChange found = d.quantity(own ? quadratic_quantity(q, d.states()).get() : nullptr);
  return nb::make_tuple(found.value, handed_over(std::move(found.weights.x)));
}

nb::tuple margin(const AnyDerivative& d) {
  const DerivativeMargin& at = d.margin();
  return nb::make_tuple(at.margin, at.time, at.constraint, at.transversality, at.grazing_time);
}

}  // namespace

void bind_derivatives(nb::module_& m) {
  nb::class_<AnyDerivative>(m, "Derivative")
      .def(nb::init<const Answer&, std::optional<bool>>(), nb::arg("answer"), nb::arg("located").none())
      .def_prop_ro("margin", &margin)
      .def_prop_ro("form", &AnyDerivative::form)
      .def_prop_ro("states", &AnyDerivative::states)
      .def_prop_ro(
          "switches",
          [](const AnyDerivative& d) { return d.switched() ? nb::cast(d.switched()->switches()) : nb::none(); })
      .def_prop_ro(
          "one_sided",
          [](const AnyDerivative& d) { return d.switched() ? d.switched()->one_sided() : std::vector<Index>(); })
      .def_prop_ro("without_M",
                   [](const AnyDerivative& d) { return d.switched() ? d.switched()->without_M() : std::string(); })
      .def("jvp", &forward, nb::arg("x0").none(), nb::arg("f").none(), nb::arg("g").none(), nb::arg("A").none(),
           nb::arg("B").none(), nb::arg("N").none(), nb::arg("M").none(), nb::arg("E").none(), nb::arg("b").none(),
           nb::arg("states"))
      .def("jvp_parameters", &forward_by_sum, nb::arg("face"), nb::arg("across"), nb::arg("decay"), nb::arg("B"),
           nb::arg("N"), nb::arg("states"))
      .def("vjp_parameters", &backward_by_sum, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(),
           nb::arg("integral").none())
      .def("quantity", &quantity, nb::arg("W").none(), nb::arg("c").none(), nb::arg("end_W").none(),
           nb::arg("end_c").none())
      .def("vjp", &backward, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(), nb::arg("integral").none(),
           nb::arg("x0"));
}

}  // namespace bromwich::python
