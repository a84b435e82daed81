// Many random small scenes by every method, each result judged by the oracle of the tests.
//
//     bromwich_random_scenes [--count 10000] [--first-seed 0] [--out FILE.json]
//
// Prints how often each family of scenes ended with which status, and the silent failures: results that contradict
// their status. The exit code is 1 if there is one. The numbers depend on the seeds only, up to rounding.

#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/verdict.hpp"

#include <nlohmann/json.hpp>

#include <array>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;

constexpr std::array methods{Method::automatic, Method::march, Method::contour, Method::euler};

struct Arguments {
  std::uint32_t count = 10000, first_seed = 0;
  std::string out;
};

Arguments parse(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc) throw std::invalid_argument(name + ": no value");
    if (name == "--count")
      arguments.count = std::uint32_t(std::stoul(argv[i + 1]));
    else if (name == "--first-seed")
      arguments.first_seed = std::uint32_t(std::stoul(argv[i + 1]));
    else if (name == "--out")
      arguments.out = argv[i + 1];
    else
      throw std::invalid_argument(name + ": unknown; use --count, --first-seed, --out");
  }
  return arguments;
}

struct Row {
  std::map<std::string, long> statuses;
  long missed = 0, failures = 0;

  void add(const oracle::Trial& trial) {
    ++statuses[trial.status];
    missed += trial.missed;
    failures += !trial.failure.empty();
  }
};

struct Tally {
  std::map<std::pair<Index, Method>, Row> rows;
  std::map<Method, Row> totals;
  ordered_json failures = ordered_json::array(), missed = ordered_json::array();

  void add(std::uint32_t seed, oracle::Family family, Method method, const oracle::Trial& trial) {
    rows[{Index(family), method}].add(trial);
    totals[method].add(trial);
    if (trial.failure.empty() && !trial.missed) return;
    ordered_json entry{{"seed", seed},
                       {"method", to_string(method)},
                       {"family", oracle::to_string(family)},
                       {"status", trial.status},
                       {"reason", trial.reason}};
    if (!trial.failure.empty()) {
      entry["failure"] = trial.failure;
      failures.push_back(entry);
    } else {
      missed.push_back(entry);
    }
  }
};

Tally judge_all(const Arguments& arguments) {
  const auto backend = make_cpu_backend(1);
  Tally tally;
  for (std::uint32_t i = 0; i < arguments.count; ++i) {
    const std::uint32_t seed = arguments.first_seed + i;
    const oracle::RandomScene random = oracle::any_scene(seed);
    const oracle::DenseScene dense = oracle::write_out(random.scene);
    for (const Method method : methods)
      tally.add(seed, random.family, method, oracle::try_method(random, dense, method, *backend));
  }
  return tally;
}

void print(const char* family, Method method, const Row& row) {
  long all = 0;
  for (const auto& [status, count] : row.statuses) all += count;
  const auto of = [&](const char* status) { return row.statuses.contains(status) ? row.statuses.at(status) : 0; };
  const long solved = of("solved"), infeasible = of("infeasible"), not_met = of("tolerance_not_met"),
             unsupported = of("unsupported");
  std::printf("%-16s %-8s %7ld %7ld %10ld %8ld %11ld %6ld %7ld %7ld\n", family, to_string(method), all, solved,
              infeasible, not_met, unsupported, all - solved - infeasible - not_met - unsupported, row.missed,
              row.failures);
}

void print(const Tally& tally) {
  std::printf("%-16s %-8s %7s %7s %10s %8s %11s %6s %7s %7s\n", "family", "method", "scenes", "solved", "infeasible",
              "not met", "unsupported", "other", "missed", "silent");
  for (const auto& [key, row] : tally.rows) print(oracle::to_string(oracle::Family(key.first)), key.second, row);
  for (const auto& [method, row] : tally.totals) print("all", method, row);
  std::printf("missed: tolerance_not_met, though the oracle solves the steps; silent: not what the status says\n");
  for (const ordered_json& failure : tally.failures) std::cout << failure.dump() << '\n';
}

ordered_json as_json(const Arguments& arguments, const Tally& tally) {
  const auto counts = [](const Row& row) {
    ordered_json json(row.statuses);
    json["missed"] = row.missed;
    json["silent_failures"] = row.failures;
    return json;
  };
  ordered_json json{{"commit", build_info::commit}, {"first_seed", arguments.first_seed}, {"count", arguments.count}};
  for (const auto& [method, row] : tally.totals) json["all"][to_string(method)] = counts(row);
  for (const auto& [key, row] : tally.rows)
    json["families"][oracle::to_string(oracle::Family(key.first))][to_string(key.second)] = counts(row);
  json["silent_failures"] = tally.failures;
  json["missed"] = tally.missed;
  return json;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments arguments = parse(argc, argv);
  const Tally tally = judge_all(arguments);
  print(tally);
  if (!arguments.out.empty()) {
    std::ofstream file(arguments.out);
    file << as_json(arguments, tally).dump(2) << '\n';
    if (!file.flush()) throw std::runtime_error("--out: could not write " + arguments.out);
  }
  return tally.failures.empty() ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_random_scenes: %s\n", error.what());
  return 2;
}
