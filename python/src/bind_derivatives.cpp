// Derivatives of results: tables in, tables out.

#include "answer.hpp"
#include "arrays.hpp"
#include "core/derivatives/solution_derivative.hpp"
#include "module.hpp"

#include <nanobind/stl/optional.h>

#include <memory>
#include <optional>
#include <utility>

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

nb::tuple forward(const SolutionDerivative& d, const std::optional<Array1>& x0, const std::optional<Array2>& f,
                  const std::optional<Array2>& g, const std::optional<Array2>& A, const std::optional<Array2>& B,
                  const std::optional<Array2>& N, const std::optional<Array2>& M) {
  SolutionChange c =
      d.jvp({x0 ? Vector(as_vector(*x0)) : Vector(), table(f), table(g), table(A), table(B), table(N), table(M)});
  return nb::make_tuple(handed_over(std::move(c.y)), handed_over(std::move(c.x)), handed_over(std::move(c.w)));
}

nb::tuple backward(const SolutionDerivative& d, const std::optional<Array2>& y, const std::optional<Array2>& x,
                   const std::optional<Array2>& w) {
  DataChange g = d.vjp({table(y), table(x), table(w)});
  return nb::make_tuple(handed_over(std::move(g.x0)), handed_over(std::move(g.f)), handed_over(std::move(g.g)),
                        handed_over(RowMatrix(g.A)), handed_over(RowMatrix(g.B)), handed_over(RowMatrix(g.N)),
                        handed_over(RowMatrix(g.M)));
}

}  // namespace

void bind_derivatives(nb::module_& m) {
  nb::class_<SolutionDerivative>(m, "SolutionDerivative")
      .def("__init__", [](SolutionDerivative* d,
                          const Answer& answer) { new (d) SolutionDerivative(answer.model->scene, answer.result); })
      .def_prop_ro("margin",
                   [](const SolutionDerivative& d) {
                     const DerivativeMargin& at = d.margin();
                     return nb::make_tuple(at.margin, at.time, at.constraint);
                   })
      .def("jvp", &forward, nb::arg("x0").none(), nb::arg("f").none(), nb::arg("g").none(), nb::arg("A").none(),
           nb::arg("B").none(), nb::arg("N").none(), nb::arg("M").none())
      .def("vjp", &backward, nb::arg("y").none(), nb::arg("x").none(), nb::arg("w").none());
}

}  // namespace bromwich::python
