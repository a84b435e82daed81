// Many random small scenes with every kind of source, solved to a tolerance and compared with the oracle with event
// location: bromwich_trust --help says how.
//
// Counts scenes solved correctly, solved wrong (an error above three times the tolerance), refused although a change of
// the data by 1e-10 moves the solution by less than a tenth of the tolerance, and refused otherwise. Scenes that the
// oracle cannot decide are counted separately. With --steps, estimates of certificates (core/certificate) are compared
// with the true errors of x and y. The exit code is 1 if a result is wrong.

#include "bench/arguments.hpp"
#include "bench/trust_summary.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"

#include <Eigen/Dense>
#include <nlohmann/json.hpp>

#include <malloc.h>
#include <time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iostream>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

using namespace bromwich;
using namespace bromwich::trust;
using nlohmann::ordered_json;

struct Arguments {
  std::uint32_t count = 300, first_seed = 0;
  std::optional<std::uint32_t> seed;
  bool skip_undecided = false;
  Method method = Method::automatic;
  double tolerance = 1e-3, seconds = 3, until = INFINITY;
  Index steps = 0, states = 0;
  int jobs = 1;
  std::string list = "wrong", out, rows = "bad";
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  std::string method = "auto", undecided = "solve";
  CLI::App app("Random small scenes, solved to a tolerance and compared with an oracle with event location.");
  app.add_option("--count", a.count, "scenes");
  app.add_option("--first-seed", a.first_seed, "that of the first scene");
  app.add_option("--seed", a.seed, "one scene in detail");
  app.add_option("--method", method, "of solve");
  app.add_option("--tol", a.tolerance, "the tolerance, also of the judgement");
  app.add_option("--steps", a.steps, "fixed steps instead of a tolerance; certificates beside true errors");
  app.add_option("--seconds", a.seconds, "that a solve may take");
  app.add_option("--list", a.list, "which scenes are printed")
      ->check(CLI::IsMember({"all", "wrong", "missed", "refused", "none"}));
  app.add_option("--out", a.out, "a JSON file");
  app.add_option("--rows", a.rows, "scenes in the file")->check(CLI::IsMember({"all", "bad"}));
  app.add_option("--jobs", a.jobs, "scenes at a time")->check(CLI::PositiveNumber);
  app.add_option("--until", a.until, "no scene is begun after so many seconds; the first seeds are judged");
  app.add_option("--undecided", undecided, "what becomes of scenes that the oracle cannot decide")
      ->check(CLI::IsMember({"solve", "skip"}));
  app.add_option("--states", a.states, "each scene among so many sparse states (more than 512 stay sparse)");
  parse_or_exit(app, argc, argv);
  a.method = method_from_string(method);
  a.skip_undecided = undecided == "skip";
  if (a.seed) a.first_seed = *a.seed, a.count = 1, a.list = "all";
  return a;
}

/// Time of the processor in this thread: others do not change what a scene may take.
double now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
double since(double start) { return now() - start; }
Result solve_scene(const Scene& scene, Backend& backend, const Arguments& a) {
  Options options;
  options.method = a.method;
  options.states = StateSelection::all;
  options.steps = a.steps;
  if (a.steps == 0) options.tolerance = a.tolerance;
  const double start = now();
  options.interrupted = [start, &a] { return since(start) > a.seconds; };
  if (a.states <= scene.states()) return solve(scene, backend, options);
  options.states = StateSelection::list;
  for (Index i = 0; i < scene.states(); ++i) options.components.push_back(i);
  return solve(oracle::among_sparse_states(scene, a.states), backend, options);
}

void print_scene(const oracle::SourceScene& s) {
  const oracle::DenseScene& d = s.base.scene;
  std::cout << "in natural units (times " << s.unit_x << " for x, " << s.unit_y << " for y, " << s.unit_t
            << " for t): T = " << d.T << "\nA\n"
            << d.A << "\nB\n"
            << d.B << "\nN\n"
            << d.N << "\nM\n"
            << d.M << "\nx0 " << d.x0.transpose() << "\nbreakpoints (" << (s.told ? "told" : "not told") << ")";
  for (const double t : s.base.breaks) std::cout << ' ' << t;
  std::cout << "\nsources " << s.sources << "\nt: f, g\n";
  const auto print_sources = [&](double t) {
    std::cout << t << ": " << oracle::value(d.f, t, d.A.rows()).transpose() << ", "
              << oracle::value(d.g, t, d.M.rows()).transpose() << "\n";
  };
  print_sources(0);
  for (const double t : s.base.breaks) {
    print_sources(t * (1 - 1e-12));
    print_sources(t * (1 + 1e-12));
  }
  print_sources(d.T);
}

void take_certificate(const Certificate& c, bool y_unique, Outcome& o) {
  o.estimate_x = c.error_of_x;
  o.estimate_y = o.error.of_mean ? c.error_of_mean : c.error_of_y;
  o.y_counts = y_unique;
  o.estimate = y_unique ? std::max(o.estimate_x, o.estimate_y) : o.estimate_x;
}

Outcome run(std::uint32_t seed, Backend& backend, const Arguments& a) {
  const oracle::SourceScene s = oracle::source_scene(seed);
  if (a.seed) print_scene(s);
  Outcome o;
  o.seed = seed;
  o.family = to_string(s.family);
  o.sources = s.sources;
  o.told = s.told;
  o.units = s.unit_x != 1 || s.unit_y != 1 || s.unit_t != 1;
  const double start = now();
  const oracle::EventSolution truth = oracle::locate_events(s.base);
  o.oracle_seconds = since(start);
  o.events = truth.events;
  o.jumps = truth.jumps;
  o.why_undecided = truth.reason;
  if (!truth.decided && a.skip_undecided) {
    o.verdict = "undecided";
    return o;
  }
  const double begin = now();
  try {
    const Result r = solve_scene(s.scene, backend, a);
    o.status = to_string(r.status);
    o.reason = r.reason;
    o.warning = r.warning;
    o.method = to_string(r.method);
    o.steps = r.steps;
    o.errors = r.errors;
    // The error of x only, if y is not unique, or if y has impulses and its mean was not controlled.
    const bool same_y = truth.y_unique && (truth.jumps == 0 || (r.errors && r.errors->of_integral));
    o.estimate = same_y || !r.errors ? r.error_estimate.value_or(NAN) : r.errors->states;
    if (r.status == Status::solved && truth.decided) o.error = oracle::true_error(s, truth, r);
    if (r.certificate && r.status == Status::solved && truth.decided)
      take_certificate(*r.certificate, truth.y_unique, o);
  } catch (const std::exception& error) {
    o.status = "error";
    o.reason = error.what();
  }
  o.seconds = since(begin);
  if (!truth.decided) {
    o.verdict = "undecided";
    return o;
  }
  const bool solved = o.status == "solved";
  if (solved && o.error.largest() <= a.tolerance) {
    o.verdict = "right";
    return o;
  }
  o.moved = oracle::apart(truth, oracle::locate_events(oracle::perturbed(s.base, 1e-10, 1)), s.base.scene.T, 400);
  const bool well = o.moved.x <= 0.1 * a.tolerance && o.moved.mean <= 0.1 * a.tolerance;
  o.verdict = solved ? (o.error.largest() <= 3 * a.tolerance ? "missed" : "wrong")
              : well ? "refused"
                     : "ill-conditioned";
  return o;
}
void write(const Arguments& a, const std::vector<Outcome>& all, const Summary& s) {
  ordered_json rows = ordered_json::array();
  for (const Outcome& o : all)
    if (a.rows == "all" || (o.verdict != "right" && o.verdict != "undecided")) rows.push_back(as_json(o));
  ordered_json json{{"commit", build_info::commit},
                    {"compiler", build_info::compiler},
                    {"jobs", a.jobs},
                    {"first_seed", a.first_seed},
                    {"count", all.size()},
                    {"method", to_string(a.method)},
                    {"tolerance", a.tolerance},
                    {"seconds", a.seconds},
                    {"steps", a.steps}};
  json.update(as_json(s));
  if (a.steps == 0) json.erase("certificates");
  json["scenes"] = rows;
  std::ofstream file(a.out);
  file << json.dump(1) << '\n';
  if (!file.flush()) throw std::runtime_error("--out: could not write " + a.out);
}

// All scenes, `jobs` at a time; those before the first one that was not begun.
std::vector<Outcome> run_all(const Arguments& a) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  std::vector<Outcome> all(a.count);
  std::atomic<std::uint32_t> next{0};
  const auto work = [&] {
    const auto backend = make_cpu_backend(1);
    while (std::chrono::duration<double>(Clock::now() - start).count() < a.until) {
      const std::uint32_t i = next++;
      if (i >= a.count) return;
      all[i] = run(a.first_seed + i, *backend, a);
      if (all[i].seconds + all[i].oracle_seconds > a.seconds)
        std::fprintf(stderr, "seed %u: solve %.1f s, oracle %.1f s\n", all[i].seed, all[i].seconds,
                     all[i].oracle_seconds);
    }
  };
  std::vector<std::thread> threads;
  for (int k = 1; k < a.jobs; ++k) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  all.resize(std::min(next.load(), a.count));
  return all;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  // Memory of one scene serves the next: threads that map and unmap pages wait for each other.
  mallopt(M_MMAP_THRESHOLD, 1 << 30);
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  const std::vector<Outcome> all = run_all(a);
  std::vector<const Outcome*> listed;
  for (const Outcome& o : all)
    if (a.list == "all" || (a.list != "none" && (o.verdict == "wrong" || o.verdict == a.list))) listed.push_back(&o);
  std::stable_sort(listed.begin(), listed.end(),
                   [](auto* p, auto* q) { return p->error.largest() > q->error.largest(); });
  for (const Outcome* o : listed) print(*o);
  const Summary s = summarise(all, a.tolerance);
  print(s, all.size());
  if (!a.out.empty()) write(a, all, s);
  return s.verdicts.contains("wrong") ? 1 : 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_trust: %s\n", error.what());
  return 2;
}
