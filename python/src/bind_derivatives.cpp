// Derivatives of results: tables in, tables out.

#include "answer.hpp"
#include "arrays.hpp"
#include "core/base/error.hpp"
#include "core/derivatives/switched_derivative.hpp"
#include "module.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <memory>
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

/// Of the discrete solution, or with located switches where y may jump.
class AnyDerivative {
 public:
  AnyDerivative(const Answer& answer, std::optional<bool> located) {
    const Scene& scene = answer.model->scene;
    const Result& result = answer.result;
    const bool jumps = y_may_jump(result) || result.method == Method::events;
    if (located.value_or(result.status == Status::solved && jumps)) {
      if (result.status != Status::solved)
        throw Error("derivative", "the result is not solved", "differentiate a result with status solved");
      switched_.emplace(scene, result.t);
    } else {
      discrete_.emplace(scene, result);
    }
  }

  SolutionChange jvp(const DataChange& c) const { return switched_ ? switched_->jvp(c) : discrete_->jvp(c); }
  DataChange vjp(const SolutionChange& c) const { return switched_ ? switched_->vjp(c) : discrete_->vjp(c); }
  const DerivativeMargin& margin() const { return switched_ ? switched_->margin() : discrete_->margin(); }
  const SwitchedDerivative* switched() const { return switched_ ? &*switched_ : nullptr; }

 private:
  std::optional<SolutionDerivative> discrete_;
  std::optional<SwitchedDerivative> switched_;
};

nb::tuple forward(const AnyDerivative& d, const std::optional<Array1>& x0, const std::optional<Array2>& f,
                  const std::optional<Array2>& g, const std::optional<Array2>& A, const std::optional<Array2>& B,
                  const std::optional<Array2>& N, const std::optional<Array2>& M, const std::optional<Array2>& E) {
  SolutionChange c = d.jvp(
      {x0 ? Vector(as_vector(*x0)) : Vector(), table(f), table(g), table(A), table(B), table(N), table(M), table(E)});
  return nb::make_tuple(handed_over(std::move(c.y)), handed_over(std::move(c.x)), handed_over(std::move(c.w)),
                        handed_over(std::move(c.integral)));
}

nb::tuple backward(const AnyDerivative& d, const std::optional<Array2>& y, const std::optional<Array2>& x,
                   const std::optional<Array2>& w, const std::optional<Array2>& integral) {
  DataChange g = d.vjp({table(y), table(x), table(w), table(integral)});
  return nb::make_tuple(handed_over(std::move(g.x0)), handed_over(std::move(g.f)), handed_over(std::move(g.g)),
                        handed_over(RowMatrix(g.A)), handed_over(RowMatrix(g.B)), handed_over(RowMatrix(g.N)),
                        or_none(g.M), or_none(g.E));
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
      .def_prop_ro(
          "switches",
          [](const AnyDerivative& d) { return d.switched() ? nb::cast(d.switched()->switches()) : nb::none(); })
      .def_prop_ro(
          "one_sided",
          [](const AnyDerivative& d) { return d.switched() ? d.switched()->one_sided() : std::vector<Index>(); })
      .def_prop_ro("without_M",
                   [](const AnyDerivative& d) { return d.switched() ? d.switched()->without_M() : std::string(); })
      .def("jvp", &forward, nb::arg("x0").none(), nb::arg("f").none(), nb::arg("g").none(), nb::arg("A").none(),
           nb::arg("B").none(), nb::arg("N").none(), nb::arg("M").none(), nb::arg("E").none())
      .def("vjp", &backward, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none(), nb::arg("integral").none());
}

}  // namespace bromwich::python
