// Random circuits, chains of masses and tanks, solved as users solve them and compared with an oracle of the tests that
// shares no code with the solver.
//
//     bromwich_engineering_scenes [--kinds circuits,masses,tanks:100] [--count 200] [--first-seed 0] [--method auto]
//         [--tol 1e-3 | --steps J] [--problems transient,periodic] [--tellings original,mirrored,permuted,units]
//         [--seconds 20] [--jobs 1] [--list bad|all|none] [--files DIR] [--out FILE.json]
//
// A kind may have a count of its own. Verdicts: right, missed (an error of up to three tolerances), wrong, refused,
// none (refused, and no state repeats: each period moves it as the one before did), slow (a solve stopped after
// --seconds of CPU time), crashed, undecided (the oracle's two answers differ, or take too long). With --steps errors
// are compared with --tol as well, for information. --files: writes the scene files of what is listed. The exit code is
// 1 if a result is wrong or crashed.

#include "app/machine.hpp"
#include "bench/processes.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/engineering_trial.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using namespace bromwich;
using namespace bromwich::oracle;
using nlohmann::ordered_json;

std::vector<std::string> words(const std::string& list) {
  std::vector<std::string> all;
  std::istringstream stream(list);
  for (std::string word; std::getline(stream, word, ',');) all.push_back(word);
  return all;
}

struct Arguments {
  std::vector<std::string> kinds{"circuits", "masses", "tanks:100"}, problems{"transient"}, tellings{"original"};
  std::uint32_t count = 200, first = 0;
  Method method = Method::automatic;
  double tolerance = 1e-3, seconds = 20;
  Index steps = 0;
  std::size_t jobs = 1;
  std::string list = "bad", files, out;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc) throw std::invalid_argument(name + ": no value");
    const std::string value = argv[i + 1];
    if (name == "--kinds")
      a.kinds = words(value);
    else if (name == "--count")
      a.count = std::uint32_t(std::stoul(value));
    else if (name == "--first-seed")
      a.first = std::uint32_t(std::stoul(value));
    else if (name == "--method")
      a.method = method_from_string(value);
    else if (name == "--tol")
      a.tolerance = std::stod(value);
    else if (name == "--steps")
      a.steps = std::stol(value);
    else if (name == "--problems")
      a.problems = words(value);
    else if (name == "--tellings")
      a.tellings = words(value);
    else if (name == "--seconds")
      a.seconds = std::stod(value);
    else if (name == "--jobs")
      a.jobs = std::stoul(value);
    else if (name == "--list")
      a.list = value;
    else if (name == "--files")
      a.files = value;
    else if (name == "--out")
      a.out = value;
    else
      throw std::invalid_argument(name + ": unknown; see the head of bench/engineering_scenes.cpp");
  }
  return a;
}

// NAME or NAME:COUNT.
std::string name_of(const std::string& kind) { return kind.substr(0, kind.find(':')); }
std::uint32_t count_of(const std::string& kind, std::uint32_t otherwise) {
  const std::size_t colon = kind.find(':');
  return colon == std::string::npos ? otherwise : std::uint32_t(std::stoul(kind.substr(colon + 1)));
}

EngineeringScene made(const std::string& kind, std::uint32_t seed) {
  if (kind == "circuits") return random_circuit(seed);
  if (kind == "masses") return random_masses(seed);
  if (kind == "tanks") return random_tanks(seed);
  throw std::invalid_argument("--kinds: no '" + kind + "'");
}

Telling telling_of(const std::string& name) {
  for (const Telling t : {Telling::original, Telling::mirrored, Telling::permuted, Telling::other_units})
    if (std::string(to_string(t)).ends_with(name)) return t;
  throw std::invalid_argument("--tellings: no '" + name + "'");
}

constexpr double patience = 60;  ///< seconds for each thing that the oracle integrates

/// What a scene's process has done so far; its name on the channel is one byte.
enum class Stage : char { oracle = 'o', solve = 's', judgement = 'j' };

ordered_json judge(const Arguments& a, const EngineeringScene& s, bool periodic, Telling telling, std::uint32_t seed,
                   const std::function<void(Stage)>& enter) {
  enter(Stage::oracle);
  // The oracle's own error has to be far below what is judged. A periodic state is integrated after the solve.
  const double begin = cpu_seconds();
  const KnownFlow known = periodic ? KnownFlow() : known_flow(s, s.x0, s.T, 0.1 * a.tolerance);
  const ordered_json oracle{{"oracle_seconds", cpu_seconds() - begin}, {"oracle_events", known.flow.events}};
  ordered_json json{{"verdict", "undecided"}, {"reason", known.reason}};
  json.update(oracle);
  if (!periodic && !known.decided) return json;
  Options options;
  options.method = a.method, options.steps = a.steps, options.states = StateSelection::all;
  if (a.steps == 0) options.tolerance = a.tolerance;
  const auto backend = make_cpu_backend(1);
  const Retold told = retold(s, telling, seed);
  enter(Stage::solve);
  const auto solved = [&enter] { enter(Stage::judgement); };
  const EngineeringTrial t = periodic ? try_periodic(s, told, options, *backend, a.tolerance, solved)
                                      : try_engineering(s, known, told, options, *backend, a.tolerance, solved);
  json = {{"verdict", t.verdict},   {"status", t.status},     {"method", t.method},
          {"steps", t.steps},       {"error", t.error},       {"at", t.at},
          {"estimate", t.estimate}, {"residual", t.residual}, {"residual_at", t.residual_at},
          {"seconds", t.seconds}};
  json.update(oracle);
  if (!t.reason.empty()) json["reason"] = t.reason;
  if (!t.warning.empty()) json["warning"] = t.warning;
  return json;
}

/// One scene in a process of its own, which names each stage that it enters and then gives its judgement.
ordered_json judged_apart(const Arguments& a, const EngineeringScene& s, bool periodic, Telling telling,
                          std::uint32_t seed) {
  int status = 0;
  const std::string text = in_process(
      [&](int channel) {
        const rlim_t memory = rlim_t(4) << 30;
        const rlimit space{memory, memory};
        setrlimit(RLIMIT_AS, &space);
        const auto enter = [&](Stage stage) {
          limit_cpu(stage == Stage::solve ? a.seconds : patience);
          if (write(channel, &stage, 1) != 1) _exit(3);
        };
        try {
          return write_whole(channel, judge(a, s, periodic, telling, seed, enter).dump());
        } catch (const std::exception& error) {
          return write_whole(channel, ordered_json{{"verdict", "crashed"}, {"reason", error.what()}}.dump());
        }
      },
      status);
  const std::size_t judged = text.find('{');
  if (judged != std::string::npos) {
    ordered_json json = ordered_json::parse(text.substr(judged));
    if (json.value("seconds", 0.0) > a.seconds && json["verdict"] != "wrong") json["verdict"] = "slow";
    return json;
  }
  if (!is_out_of_time(status)) return {{"verdict", "crashed"}, {"seconds", 0.0}};
  if (!text.empty() && text.back() == char(Stage::solve)) return {{"verdict", "slow"}, {"seconds", a.seconds}};
  return {{"verdict", "undecided"}, {"reason", "the oracle takes too long"}};
}

void judge_scene(const Arguments& a, const std::string& kind, std::uint32_t seed, std::FILE* out) {
  const EngineeringScene s = made(kind, seed);
  for (const std::string& problem : a.problems) {
    const bool periodic = problem == "periodic";
    for (const std::string& word : a.tellings) {
      const Telling telling = telling_of(word);
      ordered_json json{{"kind", kind},         {"seed", seed},
                        {"problem", problem},   {"telling", to_string(telling)},
                        {"states", s.states()}, {"constraints", s.constraints()}};
      json.update(judged_apart(a, s, periodic, telling, seed));
      const bool bad = json["verdict"] != "right" && json["verdict"] != "none" && json["verdict"] != "undecided";
      if (!a.files.empty() && (bad || a.list == "all"))
        std::ofstream(a.files + "/" + s.name + "-" + problem + (telling == Telling::original ? "" : "-" + word) +
                      ".toml")
            << scene_file(retold(s, telling, seed).scene, periodic);
      if (a.list == "all" || (a.list == "bad" && bad)) std::cout << json.dump() << std::endl;
      write_line(json, out);
    }
  }
}

struct Tally {
  struct Class {
    std::map<std::string, long> verdicts;
    std::vector<double> seconds;

    ordered_json json() const {
      std::vector<double> sorted = seconds;
      std::sort(sorted.begin(), sorted.end());
      return {{"verdicts", verdicts}, {"median_seconds", sorted[sorted.size() / 2]}, {"most_seconds", sorted.back()}};
    }
  };
  std::map<std::string, Class> classes;  ///< by kind, problem and telling
  ordered_json rows = ordered_json::array();
  long failures = 0;

  void add(const ordered_json& json) {
    const std::string verdict = json["verdict"];
    Class& of = classes[json["kind"].get<std::string>() + ", " + json["problem"].get<std::string>() + ", " +
                        json["telling"].get<std::string>()];
    ++of.verdicts[verdict];
    of.seconds.push_back(json.value("seconds", 0.0));
    failures += verdict == "wrong" || verdict == "crashed";
    if (verdict != "right") rows.push_back(json);
  }
};

/// Scene k in process k % jobs.
Tally run(const Arguments& a) {
  Tally tally;
  in_jobs(
      a.jobs,
      [&](std::size_t job, std::FILE* file) {
        std::size_t k = 0;
        for (const std::string& kind : a.kinds)
          for (std::uint32_t i = 0; i < count_of(kind, a.count); ++i)
            if (k++ % a.jobs == job) judge_scene(a, name_of(kind), a.first + i, file);
      },
      [&](const ordered_json& json) { tally.add(json); });
  return tally;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  const Tally tally = run(a);
  ordered_json classes;
  for (const auto& [name, of] : tally.classes) {
    classes[name] = of.json();
    std::printf("%s: %s\n", name.c_str(), classes[name].dump().c_str());
  }
  if (!a.out.empty()) {
    ordered_json json{{"commit", build_info::commit},
                      {"compiler", build_info::compiler},
                      {"machine", {{"cpu", app::cpu_model()}, {"cores", app::cpu_cores()}}},
                      {"threads", 1},
                      {"jobs", a.jobs},
                      {"method", to_string(a.method)},
                      {"tolerance", a.tolerance},
                      {"steps", a.steps},
                      {"first_seed", a.first},
                      {"most_seconds", a.seconds},
                      {"classes", classes},
                      {"not_right", tally.rows}};
    std::ofstream(a.out) << json.dump(1) << '\n';
  }
  return tally.failures == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_engineering_scenes: %s\n", error.what());
  return 2;
}
