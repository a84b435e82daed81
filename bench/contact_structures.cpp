// Random planar structures with 1 to 8 contacts, rigid and compliant, with e from 0 to 0.9 and mu from 0 to 1.5, solved
// as users solve them and compared with located events of the tests, which share no code with the solver.
// bromwich_contact_structures --help says how.
//
// The error is that of q at 8 times, beside the largest q. Verdicts: right, missed (up to three tolerances), wrong,
// refused, slow (stopped after --seconds of CPU time), crashed, undecided (the reference gives none, or two of its step
// lengths differ). They are counted by whether the forces determine the motion (mechanics/uniqueness.hpp). The exit
// code is 1 if a result is wrong or crashed.

#include "app/machine.hpp"
#include "bench/arguments.hpp"
#include "bench/processes.hpp"
#include "core/build_info.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "mechanics/uniqueness.hpp"
#include "tests/mechanics/contact_flow.hpp"
#include "tests/mechanics/structures.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;

constexpr Index samples = 8;

struct Arguments {
  std::uint32_t count = 2000, first = 0, contacts = 8;
  Method method = Method::automatic;
  double tolerance = 1e-3, seconds = 20, until = INFINITY;
  std::uint32_t jobs = 1;
  std::string list = "bad", out;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  std::string method = to_string(a.method);
  CLI::App app("Random planar structures with contacts, beside located events of the tests.");
  app.add_option("--count", a.count, "structures");
  app.add_option("--first-seed", a.first, "that of the first structure");
  app.add_option("--contacts", a.contacts, "at most")->check(CLI::PositiveNumber);
  app.add_option("--method", method, "of solve");
  app.add_option("--tol", a.tolerance, "the tolerance, also of the judgement");
  app.add_option("--seconds", a.seconds, "of CPU time that a solve may take");
  app.add_option("--jobs", a.jobs, "structures at a time")->check(CLI::PositiveNumber);
  app.add_option("--until", a.until, "no structure is begun after so many seconds; the first seeds are judged");
  app.add_option("--list", a.list, "which structures are printed")->check(CLI::IsMember({"bad", "all", "none"}));
  app.add_option("--out", a.out, "a JSON file");
  parse_or_exit(app, argc, argv);
  a.method = method_from_string(method);
  return a;
}

double largest(const oracle::ContactFlow& flow) {
  double size = 1e-3;
  for (const Vector& q : flow.q) size = std::max(size, q.cwiseAbs().maxCoeff());
  return size;
}

// The reference, or why there is none: two step lengths have to agree to a tenth of the tolerance.
oracle::ContactFlow reference(const Mechanism& m, double tolerance) {
  oracle::ContactFlow flow = oracle::contact_flow(m, samples, 2e-3);
  if (!flow.decided) return flow;
  const oracle::ContactFlow fine = oracle::contact_flow(m, samples, 1e-3);
  if (!fine.decided) return fine;
  double apart = 0;
  for (std::size_t k = 0; k < flow.q.size(); ++k)
    apart = std::max(apart, (flow.q[k] - fine.q[k]).cwiseAbs().maxCoeff());
  flow.decided = apart <= 0.1 * tolerance * largest(fine);
  if (!flow.decided) flow.reason = "its step lengths differ";
  return flow;
}

double error_of(const Result& r, const oracle::ContactFlow& exact) {
  double error = 0;
  for (Index k = 1; k <= samples; ++k) {
    const Vector& q = exact.q[std::size_t(k - 1)];
    const Vector x = r.x.row(k * (r.x.rows() - 1) / samples).transpose();
    error = std::max(error, (x.head(q.size()) - q).cwiseAbs().maxCoeff());
  }
  return error / largest(exact);
}

constexpr double patience = 120;  ///< seconds of the reference

ordered_json judge(const Arguments& a, std::uint32_t seed, int channel) {
  const Index contacts = 1 + Index(seed % a.contacts);
  const DrawnStructure drawn = random_structure(seed, contacts, 3, true, {0, 0.1, 0.3, 0.6, 1, 1.5});
  const Mechanism m = make_mechanism(drawn.structure, drawn.contacts);
  ordered_json json{{"seed", seed}, {"contacts", contacts}, {"uniqueness", to_string(uniqueness(m))}};
  limit_cpu(patience);
  const oracle::ContactFlow exact = reference(m, a.tolerance);
  json["verdict"] = "undecided";
  if (!exact.decided) {
    json["reason"] = exact.reason;
    return json;
  }
  json["impacts"] = exact.impacts;
  if (!write_whole(channel, json.dump() + '\n')) throw std::runtime_error("no channel");
  limit_cpu(a.seconds);
  Options options;
  options.method = a.method;
  options.tolerance = a.tolerance;
  options.states = StateSelection::all;
  const double begin = cpu_seconds();
  const Result r = solve(m.scene, *make_cpu_backend(1), options);
  json["seconds"] = cpu_seconds() - begin;
  json["method"] = to_string(r.method);
  json["status"] = to_string(r.status);
  if (!r.reason.empty()) json["reason"] = r.reason;
  if (!r.warning.empty()) json["warning"] = r.warning;
  if (r.status != Status::solved) {
    json["verdict"] = "refused";
    return json;
  }
  const double error = error_of(r, exact);
  json["error"] = error;
  json["energy"] = contact_report(m, r).energy.error;
  json["verdict"] = error <= a.tolerance ? "right" : error <= 3 * a.tolerance ? "missed" : "wrong";
  return json;
}

/// One structure in a process of its own. It says what it knows before the solve, and then its judgement.
ordered_json judged(const Arguments& a, std::uint32_t seed) {
  int status = 0;
  const std::string text = in_process(
      [&](int channel) {
        try {
          return write_whole(channel, judge(a, seed, channel).dump());
        } catch (const std::exception& error) {
          return write_whole(channel,
                             ordered_json{{"seed", seed}, {"verdict", "crashed"}, {"reason", error.what()}}.dump());
        }
      },
      status);
  const std::size_t line = text.find('\n');
  const bool begun = line != std::string::npos, late = is_out_of_time(status);
  if (status == 0) return ordered_json::parse(begun ? text.substr(line + 1) : text);
  if (!begun && late) return {{"seed", seed}, {"verdict", "undecided"}, {"reason", "the reference takes too long"}};
  ordered_json json = begun ? ordered_json::parse(text.substr(0, line)) : ordered_json{{"seed", seed}};
  json["verdict"] = late ? "slow" : "crashed";
  return json;
}

struct Tally {
  std::map<std::string, std::map<std::string, long>> verdicts;  ///< by uniqueness
  ordered_json rows = ordered_json::array();
  double largest_error = 0, largest_energy = 0, longest = 0;
  long failures = 0;

  void add(const ordered_json& json) {
    const std::string verdict = json["verdict"];
    ++verdicts[json.value("uniqueness", "unknown")][verdict];
    failures += verdict == "wrong" || verdict == "crashed";
    longest = std::max(longest, json.value("seconds", 0.0));
    if (verdict != "right") return rows.push_back(json);
    largest_error = std::max(largest_error, json.value("error", 0.0));
    if (json["method"] == "events") largest_energy = std::max(largest_energy, json.value("energy", 0.0));
  }
};

/// Seed k in process k % jobs. The first seeds up to one that was not begun.
std::vector<ordered_json> run_all(const Arguments& a) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  std::vector<ordered_json> all(a.count);
  in_jobs(
      a.jobs,
      [&](std::size_t job, std::FILE* file) {
        for (std::uint32_t k = std::uint32_t(job); k < a.count; k += a.jobs) {
          if (std::chrono::duration<double>(Clock::now() - start).count() > a.until) return;
          const ordered_json json = judged(a, a.first + k);
          const std::string verdict = json["verdict"];
          if (a.list == "all" || (a.list == "bad" && verdict != "right" && verdict != "undecided"))
            std::cout << json.dump() << std::endl;
          write_line(json, file);
        }
      },
      [&](const ordered_json& json) { all[json["seed"].get<std::uint32_t>() - a.first] = json; });
  all.erase(std::find(all.begin(), all.end(), ordered_json()), all.end());
  return all;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  const std::vector<ordered_json> all = run_all(a);
  Tally tally;
  for (const ordered_json& one : all) tally.add(one);
  const ordered_json json{{"bench", "contact-structures"},
                          {"commit", build_info::commit},
                          {"compiler", build_info::compiler},
                          {"machine", {{"cpu", app::cpu_model()}, {"cores", app::cpu_cores()}}},
                          {"threads", 1},
                          {"jobs", a.jobs},
                          {"method", to_string(a.method)},
                          {"tolerance", a.tolerance},
                          {"count", all.size()},
                          {"first_seed", a.first},
                          {"most_contacts", a.contacts},
                          {"most_seconds", a.seconds},
                          {"verdicts", tally.verdicts},
                          {"largest_error", tally.largest_error},
                          {"largest_energy_of_events", tally.largest_energy},
                          {"longest_seconds", tally.longest},
                          {"not_right", tally.rows}};
  std::printf("%s\n", ordered_json(tally.verdicts).dump().c_str());
  if (!a.out.empty()) std::ofstream(a.out) << json.dump(1) << '\n';
  return tally.failures == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_contact_structures: %s\n", error.what());
  return 2;
}
