// bromwich._core: the library for the Python package in python/bromwich, which has the interface that people use.

#include "module.hpp"

NB_MODULE(_core, m) {
  using namespace bromwich::python;
  nanobind::set_leak_warnings(false);  // a function of a module that holds its own scene outlives the interpreter
  m.doc() = "The compiled part of bromwich. Its interface is private: use the package.";
  bind_errors(m);
  bind_sources(m);
  bind_scenes(m);
  bind_results(m);
  bind_solving(m);
}
