// bromwich._core: the library for the Python package in python/bromwich, which has the interface that people use.

#include "module.hpp"

#include "app/commands.hpp"
#include "cpu/cpu_backend.hpp"
#include "cpu/real_fft.hpp"
#include "kernels/cuda_plugin.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <string>
#include <vector>

namespace bromwich::python {
namespace {

int command(std::vector<std::string> words) {
  const nb::gil_scoped_release released;
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  return app::command(int(words.size()), argv.data());
}

void bind_machine(nb::module_& m) {
  m.def("command", &command, nb::arg("words"), "The command line; the exit code. Once a process.");
  m.def(
      "threads", [] { return make_cpu_backend()->device().threads; }, "Threads of a solve with threads=0.");
  m.def("set_cuda_plugin", &set_cuda_plugin, nb::arg("file"), "Where the CUDA backend is; empty: nowhere.");
  m.def("cuda_missing", &cuda_plugin_missing, "Why there is no CUDA backend; empty if it is loaded.");
  m.def("cuda_devices", &cuda_devices, "Names of the CUDA devices that can be used.");
  m.attr("transform") = cpu::transform_library();
  m.attr("built_for") = BROMWICH_BUILT_FOR;
}

}  // namespace
}  // namespace bromwich::python

NB_MODULE(_core, m) {
  using namespace bromwich::python;
  nanobind::set_leak_warnings(false);  // a function of a module that holds its own scene outlives the interpreter
  m.doc() = "The compiled part of bromwich. Its interface is private: use the package.";
  bind_errors(m);
  bind_sources(m);
  bind_scenes(m);
  bind_results(m);
  bind_arrays(m);
  bind_batch(m);
  bind_circuits(m);
  bind_scene_arrays(m);
  bind_ranks(m);
  bind_solving(m);
  bind_derivatives(m);
  bind_continuation(m);
  bind_inversion(m);
  bind_lcp(m);
  bind_mechanics(m);
  bind_memories(m);
  bind_nonlinear(m);
  bind_report(m);
  bind_state(m);
  bind_machine(m);
}
