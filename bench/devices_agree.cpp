// Random small scenes by every method on two backends: the CPU with one thread, and the device; without a device the
// CPU with two threads, as a dry run. Both have to end with the same status, and with x and y that differ by less than
// --limit of the largest value. bromwich_devices_agree --help says how.
//
// The exit code is 1 if any differs.

#include "bench/arguments.hpp"
#include "bench/pairs.hpp"
#include "core/build_info.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "tests/support/random_scenes.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iostream>
#include <map>
#include <string>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;
using study::apart;
using study::Ended;

constexpr std::array methods{Method::automatic, Method::march, Method::euler,  Method::contour, Method::contour_literal,
                             Method::multigrid, Method::dual,  Method::events, Method::galerkin};

struct Arguments {
  std::uint32_t count = 200, first = 0;
  double seconds = 20, limit = 1e-8;
  std::string out;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  CLI::App app("Random small scenes by every method, on the CPU and on a device.");
  app.add_option("--count", a.count, "scenes");
  app.add_option("--first-seed", a.first, "that of the first scene");
  app.add_option("--seconds", a.seconds, "that a solve may take");
  app.add_option("--limit", a.limit, "of differences, relative to the largest value");
  app.add_option("--out", a.out, "a JSON file");
  parse_or_exit(app, argc, argv);
  return a;
}

Ended ended(const oracle::RandomScene& random, Method method, Backend& backend, double seconds) {
  using Clock = std::chrono::steady_clock;
  const auto begin = Clock::now();
  Options options;
  options.method = method, options.steps = random.steps, options.states = StateSelection::all;
  options.interrupted = [=] { return std::chrono::duration<double>(Clock::now() - begin).count() > seconds; };
  return study::ended([&] { return solve(random.scene, backend, options); });
}

struct Row {
  std::map<std::string, long> statuses;
  long other_status = 0, other_values = 0;
  double largest = 0;
};

ordered_json compare_all(const Arguments& a, long& failures) {
  const bool device = !cuda_devices().empty();
  const auto first = make_cpu_backend(1);
  const auto second = device ? make_cuda_backend(make_cpu_backend(2)) : make_cpu_backend(2);
  std::map<std::string, Row> rows;
  ordered_json differing = ordered_json::array();
  for (std::uint32_t i = 0; i < a.count; ++i) {
    const oracle::RandomScene random = oracle::any_scene(a.first + i);
    for (const Method method : methods) {
      const Ended one = ended(random, method, *first, a.seconds), two = ended(random, method, *second, a.seconds);
      Row& row = rows[to_string(method)];
      ++row.statuses[one.status];
      const bool solved = one.status == "solved" && two.status == "solved";
      const double x = solved ? apart(one.result.x, two.result.x) : 0,
                   y = solved ? apart(one.result.y, two.result.y) : 0;
      row.largest = std::max(row.largest, x);
      row.other_status += one.status != two.status;
      row.other_values += solved && !(x <= a.limit);
      if (one.status == two.status && x <= a.limit) continue;
      differing.push_back({{"seed", a.first + i},
                           {"method", to_string(method)},
                           {"family", oracle::to_string(random.family)},
                           {"status", {one.status, two.status}},
                           {"reason", {one.reason, two.reason}},
                           {"method_taken", {to_string(one.result.method), to_string(two.result.method)}},
                           {"x", x},
                           {"y", y}});
      std::cout << differing.back().dump() << std::endl;
    }
  }
  ordered_json json{{"commit", build_info::commit},
                    {"second", device ? "cuda" : "cpu, two threads (dry run)"},
                    {"first_seed", a.first},
                    {"count", a.count},
                    {"limit", a.limit}};
  for (const auto& [name, row] : rows) {
    json["methods"][name] = {{"statuses", row.statuses},
                             {"other_status", row.other_status},
                             {"other_values", row.other_values},
                             {"largest_difference_of_x", row.largest}};
    failures += row.other_status + row.other_values;
  }
  json["differing"] = differing;
  return json;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  long failures = 0;
  const ordered_json json = compare_all(a, failures);
  std::cout << json["second"] << '\n';
  for (const auto& [name, row] : json["methods"].items()) std::cout << name << ": " << row.dump() << '\n';
  if (!a.out.empty()) std::ofstream(a.out) << json.dump(1) << '\n';
  return failures == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_devices_agree: %s\n", error.what());
  return 2;
}
