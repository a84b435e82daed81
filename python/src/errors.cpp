// Errors of the library become exceptions of the package bromwich, which are written in Python.

#include "core/base/error.hpp"
#include "module.hpp"

#include <nanobind/stl/string.h>

#include <exception>
#include <string>

namespace bromwich::python {

void bind_errors(nb::module_&) {
  nb::register_exception_translator(
      [](const std::exception_ptr& thrown, void*) {
        const auto raise = [](const char* kind, const std::string& argument, const std::string& rest) {
          const nb::object error = nb::module_::import_("bromwich._errors").attr("made")(kind, argument, rest);
          PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
        };
        try {
          std::rethrow_exception(thrown);
        } catch (const SingularShift& error) {
          raise("singular shift", error.argument(), error.found() + "; " + error.remedy());
        } catch (const Error& error) {
          raise(to_string(error.kind()), error.argument(), error.found() + "; " + error.remedy());
        } catch (const std::bad_alloc&) {
          raise("does not fit", "memory",
                "the problem does not fit into this machine's memory; use fewer steps, states or threads, or a smaller "
                "scene");
        }
      },
      nullptr);
}

}  // namespace bromwich::python
