// `bromwich bench` where the studies are not built: preset `first`, and the Python package that pip compiles.

#include "app/commands.hpp"
#include "core/base/error.hpp"

namespace bromwich::app {

std::string bench_list() {
  return "  none in this build; 'scripts/build' in the source makes a command that has them\n";
}

int run_bench(const BenchArguments&) {
  throw Error("command", "found 'bench', whose studies are not in this build",
              "'scripts/build' in the source makes build/cpu/bromwich, which has them");
}

}  // namespace bromwich::app
