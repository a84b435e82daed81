// Sources f and g for the Python layer, which knows shapes and words.

#include "arrays.hpp"
#include "module.hpp"
#include "sources.hpp"

#include <nanobind/stl/map.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

namespace bromwich::python {

void bind_sources(nb::module_& m) {
  nb::class_<Source>(m, "Source", "A function of time with `width` values.")
      .def_ro("width", &Source::width)
      .def_ro("breakpoints", &Source::breakpoints, "Times at which it may jump or have a kink.")
      .def_static(
          "constant", [](const Array1& value) { return constant_source(as_vector(value)); }, nb::arg("value"))
      .def_static(
          "table",
          [](const Array1& times, const Array2& values, bool kinks) {
            return table_source(as_vector(times), as_matrix(values), kinks);
          },
          nb::arg("times"), nb::arg("values"), nb::arg("kinks"),
          "Linear between rows; two rows of equal time are a jump.")
      .def_static(
          "function",
          [](nb::object one, nb::object many, Index width, double T) {
            return python_source(Kept(std::move(one)), many.is_none() ? Kept() : Kept(std::move(many)), width, T);
          },
          nb::arg("one"), nb::arg("many").none(), nb::arg("width"), nb::arg("T"))
      .def_static("expressions", &expression_source, nb::arg("texts"), nb::arg("parameters"), nb::arg("T"),
                  nb::arg("name"))
      .def(
          "__call__",
          [](const Source& source, double t) {
            auto* value = new Vector(Vector::Zero(source.width));
            const nb::capsule owner(value, [](void* p) noexcept { delete static_cast<Vector*>(p); });
            source.function(t, *value);
            return view(*value, owner);
          },
          nb::arg("t"));
}

}  // namespace bromwich::python
