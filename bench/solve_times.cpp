// Times whole solves of built-in scenes when it is asked to: lines "signorini 127 400 3" (scene, Q or 0, steps, how
// many) on standard input, seconds of each solve on standard output. scripts/bench_python asks, between the same solves
// from Python.

#include <bromwich/bromwich.hpp>
#include "cpu/cpu_backend.hpp"

#if defined(__GLIBC__)
#include <malloc.h>
#endif

#include <chrono>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <map>
#include <string>

using namespace bromwich;

namespace {

/// As Python solves by default: N x is recorded, and the state where it is small.
Options options_for(const Scene& scene, Index steps) {
  Options options;
  options.steps = steps;
  options.trace = true;
  options.states = scene.states() <= 1000 ? StateSelection::all : StateSelection::none;
  return options;
}

}  // namespace

int main(int argc, char** argv) {
#if defined(__GLIBC__)
  if (argc > 1 && std::strcmp(argv[1], "keep-pages") == 0) {  // as the command does
    mallopt(M_MMAP_MAX, 0);
    mallopt(M_TRIM_THRESHOLD, 1 << 30);
  }
#endif
  const auto backend = make_cpu_backend();
  std::map<std::string, Scene> scenes;
  std::string name;
  for (long Q, steps, count; std::cin >> name >> Q >> steps >> count;) {
    auto found = scenes.find(name);
    if (found == scenes.end())
      found =
          scenes.emplace(name, make_scene(name, Q > 0 ? ParameterValues{{"Q", double(Q)}} : ParameterValues{})).first;
    const Options options = options_for(found->second, steps);
    for (long i = 0; i < count; ++i) {
      const auto start = std::chrono::steady_clock::now();
      const Result result = solve(found->second, *backend, options);
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
      std::printf("%.9f ", result.status == Status::solved ? taken.count() : -1.0);
    }
    std::puts("");
    std::fflush(stdout);
  }
}
