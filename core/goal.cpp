#include "core/goal.hpp"

#include "core/error.hpp"

namespace bromwich {

Result solve_for_goal(const Scene& scene, Backend&, const Options&) {
  throw Error("method", "goal cannot solve scene " + scene.name, "use another method");
}

}  // namespace bromwich
