// Method shooting beside method march: random scenes of all classes, and scene files. Both have to end with the same
// status, and with x and y that differ by less than --limit of the largest value.
//
//     bromwich_chunks [--count 200] [--first-seed 0] [--chunks 16] [--threads 2] [--cold] [--limit 1e-11]
//                     [--device] [--out FILE.json] [--all] [SCENE.toml[:STEPS] ...]
//
// --device: the chunks are marched there. Prints how many scenes took how many passes; --all prints every one. The
// times of a scene file are CPU times of the solves alone, without confirmation. The exit code is 1 if any differs.

#include "bench/pairs.hpp"
#include "core/build_info.hpp"
#include "core/solve/engines.hpp"
#include "cpu/cpu_backend.hpp"
#include "files/scene_file.hpp"
#include "kernels/cuda_backend.hpp"
#include "tests/support/random_scenes.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;
using study::apart;
using study::Ended;

struct Arguments {
  std::uint32_t count = 200, first = 0;
  Index chunks = 16;
  int threads = 2;
  double limit = 1e-11;
  bool cold = false, all = false, device = false;
  std::string out;
  std::vector<std::string> files;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const auto value = [&]() -> std::string {
      if (i + 1 == argc) throw std::invalid_argument(name + ": no value");
      return argv[++i];
    };
    if (name == "--count")
      a.count = std::uint32_t(std::stoul(value()));
    else if (name == "--first-seed")
      a.first = std::uint32_t(std::stoul(value()));
    else if (name == "--chunks")
      a.chunks = std::stol(value());
    else if (name == "--threads")
      a.threads = std::stoi(value());
    else if (name == "--limit")
      a.limit = std::stod(value());
    else if (name == "--cold")
      a.cold = true;
    else if (name == "--all")
      a.all = true;
    else if (name == "--device")
      a.device = true;
    else if (name == "--out")
      a.out = value();
    else if (name.starts_with("--"))
      throw std::invalid_argument(name + ": unknown; see the head of bench/chunks.cpp");
    else
      a.files.push_back(name);
  }
  return a;
}

Ended ended(const Scene& scene, Method method, Index steps, Backend& backend, const Arguments& a) {
  InnerOptions options;
  options.method = method, options.steps = steps, options.states = StateSelection::all, options.confirm = false;
  options.chunks = a.chunks, options.coarse_start = !a.cold;
  options.by_pieces = method == Method::shooting;  // beside steps that are solved one by one
  return study::ended([&] { return solve_valid(scene, backend, options); });
}

/// What rounding of x0 does to march: its differences from marches with x0 changed in the last digits.
double effect_of_rounding(const Scene& scene, Index steps, const Ended& march, Backend& backend, const Arguments& a) {
  double largest = 0;
  for (const double factor : {1 + 1e-15, 1 - 1e-15}) {
    Scene other = scene;
    for (Index i = 0; i < other.x0.size(); ++i) other.x0[i] = scene.x0[i] * (i % 2 ? factor : 2 - factor);
    const Ended e = ended(other, Method::march, steps, backend, a);
    if (e.status == march.status)
      largest = std::max({largest, apart(march.result.x, e.result.x), apart(march.result.y, e.result.y)});
    else
      largest = INFINITY;
  }
  return largest;
}

bool by_pieces(const Result& r) { return r.kernel.find("affine pieces") != std::string::npos; }
bool in_turn(const Result& r) { return r.kernel.find("one after another") != std::string::npos; }

struct Totals {
  Index scenes = 0, differ = 0, by_pieces = 0, in_turn = 0, of_rounding = 0;
  double worst = 0;
  std::map<Index, Index> passes;
  ordered_json differing = ordered_json::array(), files = ordered_json::array();
};

ordered_json compare(const std::string& name, const Scene& scene, Index steps, Backend& backend, const Arguments& a,
                     Totals& totals) {
  const Ended march = ended(scene, Method::march, steps, backend, a);
  const Ended chunks = ended(scene, Method::shooting, steps, backend, a);
  const double x = apart(march.result.x, chunks.result.x), y = apart(march.result.y, chunks.result.y);
  bool same = march.status == chunks.status && std::max(x, y) <= a.limit;
  double rounding = 0;
  if (!same) {
    rounding = effect_of_rounding(scene, steps, march, backend, a);
    same = std::max(x, y) <= 100 * rounding;
    totals.of_rounding += same;
  }
  ++totals.scenes;
  totals.differ += !same;
  totals.in_turn += in_turn(chunks.result);
  totals.by_pieces += by_pieces(chunks.result);
  if (march.status == "solved") ++totals.passes[chunks.result.iterations];
  if (std::max(x, y) <= a.limit) totals.worst = std::max({totals.worst, x, y});
  ordered_json one{{"name", name},
                   {"steps", chunks.result.steps},
                   {"status", {march.status, chunks.status}},
                   {"x", x},
                   {"y", y},
                   {"rounding", rounding},
                   {"passes", chunks.result.iterations},
                   {"in_turn", in_turn(chunks.result)},
                   {"history", chunks.result.history},
                   {"seconds", {march.seconds, chunks.seconds}},
                   {"kernel", chunks.result.kernel}};
  if (!same) totals.differing.push_back(one);
  if (!same || a.all)
    std::cout << one.dump() << (same ? "" : "  DIFFERS: " + march.reason + " | " + chunks.reason) << "\n";
  return one;
}

void compare_file(const std::string& given, Backend& backend, const Arguments& a, Totals& totals) {
  const std::size_t colon = given.rfind(':');
  const std::string path = given.substr(0, colon);
  const Index steps = colon == std::string::npos ? 0 : std::stol(given.substr(colon + 1));
  const Scene scene = read_scene_file(path).scene;
  totals.files.push_back(compare(path, scene, steps, backend, a, totals));
}

int run(const Arguments& a) {
  const auto backend = a.device ? make_cuda_backend(make_cpu_backend(a.threads)) : make_cpu_backend(a.threads);
  Totals totals;
  for (std::uint32_t seed = a.first; a.files.empty() && seed < a.first + a.count; ++seed) {
    const oracle::RandomScene random = oracle::any_scene(seed);
    compare("seed " + std::to_string(seed) + " " + oracle::to_string(random.family), random.scene, random.steps,
            *backend, a, totals);
  }
  for (const std::string& file : a.files) compare_file(file, *backend, a, totals);
  ordered_json passes;
  for (const auto& [number, scenes] : totals.passes) passes[std::to_string(number)] = scenes;
  const ordered_json all{{"commit", std::string(build_info::commit)},
                         {"chunks", a.chunks},
                         {"coarse_start", !a.cold},
                         {"threads", a.threads},
                         {"scenes", totals.scenes},
                         {"differ", totals.differ},
                         {"differ_as_by_rounding", totals.of_rounding},
                         {"in_turn", totals.in_turn},
                         {"by_pieces", totals.by_pieces},
                         {"largest_difference", totals.worst},
                         {"scenes_by_passes", passes},
                         {"differing", totals.differing},
                         {"files", totals.files}};
  std::cout << totals.scenes << " scenes, " << totals.differ << " differ, " << totals.in_turn << " ended in turn, "
            << totals.by_pieces << " by pieces, " << totals.of_rounding << " differ as by rounding, largest difference "
            << totals.worst << ", by passes " << passes.dump() << "\n";
  if (!a.out.empty()) std::ofstream(a.out) << all.dump(1) << "\n";
  return totals.differ > 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(parse(argc, argv));
  } catch (const std::exception& e) {
    std::cerr << e.what() << "\n";
    return 2;
  }
}
