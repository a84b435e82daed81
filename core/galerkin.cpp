#include "core/galerkin.hpp"

#include "core/error.hpp"

namespace bromwich {

Result solve_by_galerkin(const Scene& scene, Backend&, const Options&) {
  throw Error("method", "galerkin cannot solve scene " + scene.name, "use another method");
}

}  // namespace bromwich
