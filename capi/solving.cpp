// One scene: once, or many times.

#include "capi/failures.hpp"
#include "capi/handles.hpp"
#include "capi/settings.hpp"

#include <utility>

struct bromwich_solver {
  std::shared_ptr<bromwich::Backend> backend;
  std::shared_ptr<const bromwich::Circuit> circuit;
  bromwich::Options options;  ///< without functions of the caller
  std::unique_ptr<bromwich::Solver> solver;
};

using namespace bromwich;
using namespace bromwich::capi;

namespace {

Options listened(Options options, const bromwich_hooks* hooks) {
  listen(options, hooks_of(hooks));
  return options;
}

std::unique_ptr<bromwich_result> solved(const bromwich_scene& handle, const char* text, const bromwich_hooks* hooks) {
  const Scene& scene = handle.complete();
  scene.validate();
  const Settings settings = settings_of(text, scene, handle.circuit != nullptr);
  auto made = std::make_unique<bromwich_result>();
  made->scene = scene;
  made->circuit = handle.circuit;
  made->options = settings.options;
  made->backend = backend_of(settings, scene);
  made->result = solve(scene, *made->backend, listened(settings.options, hooks));
  return made;
}

std::unique_ptr<bromwich_solver> solver_of(const bromwich_scene& handle, const char* text,
                                           const bromwich_hooks* hooks) {
  const Scene& scene = handle.complete();
  scene.validate();
  const Settings settings = settings_of(text, scene, handle.circuit != nullptr);
  auto made = std::make_unique<bromwich_solver>();
  made->backend = backend_of(settings, scene);
  made->circuit = handle.circuit;
  made->options = settings.options;
  made->solver = std::make_unique<Solver>(scene, *made->backend, listened(settings.options, hooks));
  return made;
}

std::unique_ptr<bromwich_result> solved(bromwich_solver& s) {
  auto made = std::make_unique<bromwich_result>();
  made->result = s.solver->solve();
  made->scene = s.solver->scene();
  made->circuit = s.circuit;
  made->options = s.options;
  made->backend = s.backend;
  return made;
}

}  // namespace

int bromwich_solve(const bromwich_scene* scene, const char* options, const bromwich_hooks* hooks,
                   bromwich_result** result) {
  return guarded([&] { given(result, "result") = solved(given(scene, "scene"), options, hooks).release(); });
}

int bromwich_solver_new(const bromwich_scene* scene, const char* options, const bromwich_hooks* hooks,
                        bromwich_solver** solver) {
  return guarded([&] { given(solver, "solver") = solver_of(given(scene, "scene"), options, hooks).release(); });
}

int bromwich_solver_set_x0(bromwich_solver* solver, const double* x0, int64_t states) {
  return guarded([&] {
    Solver& changed = *given(solver, "solver").solver;
    given_array(x0, states, "x0");
    changed.set_x0(Vector(Eigen::Map<const Vector>(x0, states)));
  });
}

int bromwich_solver_set_sources(bromwich_solver* solver, const bromwich_scene* scene) {
  return guarded([&] {
    Solver& changed = *given(solver, "solver").solver;
    const Scene &old = changed.scene(), &other = given(scene, "scene").scene;
    if (solver->circuit) throw Error("solver", "is that of a netlist", "make another solver of the changed netlist");
    if (other.states() != old.states() || other.constraints() != old.constraints() || other.sources() != old.sources())
      throw Error("scene", "has other sizes than the solver", "give one with as many states, constraints and sources");
    changed.set_sources(other.f, other.g, other.breakpoints, other.breakpoints_are_all);
  });
}

int bromwich_solver_solve(bromwich_solver* solver, bromwich_result** result) {
  return guarded([&] { given(result, "result") = solved(given(solver, "solver")).release(); });
}

void bromwich_solver_free(bromwich_solver* solver) { delete solver; }
