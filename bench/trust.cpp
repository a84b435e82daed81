// Many random small scenes with every kind of source, solved to a tolerance and compared with the oracle with event
// location.
//
//     bromwich_trust [--count 300] [--first-seed 0] [--seed K] [--method auto] [--tol 1e-3] [--steps J]
//                    [--seconds 3] [--list all|wrong|refused|none] [--out FILE.json] [--rows all|bad]
//                    [--jobs 1] [--until SECONDS] [--undecided solve|skip] [--states M]
//
// Counts scenes solved correctly, solved wrong (an error above three times the tolerance), refused although a change of
// the data by 1e-10 moves the solution by less than a tenth of the tolerance, and refused otherwise. Scenes that the
// oracle cannot decide are counted separately. --seed K: one scene in detail. --steps J: fixed steps instead of a
// tolerance, with --tol for the judgement. --jobs K: K scenes at a time. --until S: no scene is begun after S seconds;
// the seeds that were judged are the first ones. --undecided skip: scenes that the oracle cannot decide are not solved.
// With --steps, estimates of certificates (core/certificate) are compared with the true errors of x and y.
// --states M: each scene among M sparse states (M > 512 stays sparse). The exit code is 1 if a result is wrong.

#include "tests/support/trust.hpp"
#include "core/base/error.hpp"
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
#include <exception>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;

struct Arguments {
  std::uint32_t count = 300, first_seed = 0;
  bool one = false, skip_undecided = false;
  Method method = Method::automatic;
  double tolerance = 1e-3, seconds = 3, until = INFINITY;
  Index steps = 0, states = 0;
  int jobs = 1;
  std::string list = "wrong", out, rows = "bad";
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; i += 2) {
    const std::string name = argv[i];
    if (i + 1 == argc) throw std::invalid_argument(name + ": no value");
    const std::string value = argv[i + 1];
    if (name == "--count")
      a.count = std::uint32_t(std::stoul(value));
    else if (name == "--first-seed")
      a.first_seed = std::uint32_t(std::stoul(value));
    else if (name == "--seed")
      a.first_seed = std::uint32_t(std::stoul(value)), a.count = 1, a.one = true, a.list = "all";
    else if (name == "--method")
      a.method = method_from_string(value);
    else if (name == "--tol")
      a.tolerance = std::stod(value);
    else if (name == "--steps")
      a.steps = std::stol(value);
    else if (name == "--seconds")
      a.seconds = std::stod(value);
    else if (name == "--list")
      a.list = value;
    else if (name == "--out")
      a.out = value;
    else if (name == "--rows")
      a.rows = value;
    else if (name == "--jobs")
      a.jobs = std::max(1, std::stoi(value));
    else if (name == "--states")
      a.states = std::stol(value);
    else if (name == "--undecided")
      a.skip_undecided = value == "skip";
    else if (name == "--until")
      a.until = std::stod(value);
    else
      throw std::invalid_argument(name + ": unknown; see the head of bench/trust.cpp");
  }
  return a;
}

/// Time of the processor in this thread: others do not change what a scene may take.
double now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}
double since(double start) { return now() - start; }

/// Replaces digits by one '#', to group reasons of one kind.
std::string kind_of(const std::string& reason) {
  std::string kind;
  for (const char c : reason) {
    const bool digit = (c >= '0' && c <= '9') || ((c == '.' || c == '-' || c == '+') && kind.ends_with('#'));
    if (!digit)
      kind += c;
    else if (!kind.ends_with('#'))
      kind += '#';
  }
  return kind.substr(0, 150);
}

struct Outcome {
  std::uint32_t seed = 0;
  std::string verdict;  ///< right, missed, wrong, refused, ill-conditioned, or undecided (by the oracle)
  std::string status, reason, warning, method, family, sources, why_undecided;
  bool told = false, units = false;
  oracle::TrueError error;
  oracle::Apart moved{NAN, NAN, NAN};
  std::optional<ErrorEstimate> errors = {};
  double estimate = NAN, seconds = 0, oracle_seconds = 0;
  double estimate_x = NAN, estimate_y = NAN;  ///< of the certificate
  bool y_counts = true;                       ///< y is unique
  Index steps = 0;
  long events = 0, jumps = 0;
};

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
  if (a.one) print_scene(s);
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

void print(const Outcome& o) {
  std::printf("%-15s seed %u  %s by %s, %ld steps, %s, %s%s [%s]%s\n", o.verdict.c_str(), o.seed, o.status.c_str(),
              o.method.c_str(), long(o.steps), o.family.c_str(), o.told ? "told" : "not told", o.units ? ", units" : "",
              o.sources.c_str(), o.jumps > 0 ? ", state jumps" : "");
  if (o.status == "solved")
    std::printf("    x %.2e at %g, %s %.2e at %g, estimate %.2e\n", o.error.x, o.error.x_at,
                o.error.of_mean ? "mean of y" : "y", o.error.y, o.error.y_at, o.estimate);
  if (!std::isnan(o.moved.x))
    std::printf("    1e-10 in the data moves x by %.1e, y by %.1e, its mean by %.1e\n", o.moved.x, o.moved.y,
                o.moved.mean);
  if (!o.reason.empty()) std::printf("    reason: %s\n", o.reason.c_str());
  if (!o.warning.empty()) std::printf("    warning: %s\n", o.warning.c_str());
  if (!o.why_undecided.empty()) std::printf("    oracle: %s\n", o.why_undecided.c_str());
}

ordered_json as_json(const Outcome& o) {
  const ErrorEstimate e = o.errors.value_or(ErrorEstimate());
  return {{"seed", o.seed},
          {"verdict", o.verdict},
          {"status", o.status},
          {"reason", o.reason},
          {"warning", o.warning},
          {"method", o.method},
          {"family", o.family},
          {"sources", o.sources},
          {"told", o.told},
          {"units", o.units},
          {"error_x", o.error.x},
          {"error_y", o.error.y},
          {"of_mean", o.error.of_mean},
          {"estimate", o.estimate},
          {"estimate_y", e.discretisation},
          {"estimate_x", e.states},
          {"rounding", e.rounding},
          {"order", e.order},
          {"estimates", e.estimates},
          {"steps", o.steps},
          {"moved_x", o.moved.x},
          {"moved_mean", o.moved.mean},
          {"seconds", o.seconds},
          {"oracle", o.why_undecided},
          {"events", o.events},
          {"jumps", o.jumps}};
}

/// Estimates of certificates beside true errors. An error is that of x, or of y where y is unique and that is larger.
struct OfCertificates {
  static constexpr double off = 0.05, right = 0.01;
  static constexpr double seen = 0.5;       ///< of an error: at least so much is estimated
  static constexpr double compared = 1e-5;  ///< smaller errors are those of the times to which breakpoints are moved
  long above = 0, above_unseen = 0, below = 0, below_doubted = 0;
  std::vector<double> ratios_x, ratios_y;  ///< estimate / error

  void add(const Outcome& o) {
    const double error = o.y_counts ? o.error.largest() : o.error.x;
    above += error > off;
    above_unseen += error > off && o.estimate < seen * off;
    below += error <= right;
    below_doubted += error <= right && o.estimate > off;
    if (o.error.x > compared) ratios_x.push_back(o.estimate_x / o.error.x);
    if (o.y_counts && o.error.y > compared) ratios_y.push_back(o.estimate_y / o.error.y);
  }
};

struct Summary {
  std::map<std::string, long> verdicts, told, not_told, reasons, undecided;
  std::vector<double> effectivity;
  OfCertificates certificates;
  double seconds = 0, oracle_seconds = 0;
  long right_with_warning = 0;
};

Summary summarise(const std::vector<Outcome>& all, double tolerance) {
  Summary s;
  for (const Outcome& o : all) {
    ++s.verdicts[o.verdict];
    s.right_with_warning += o.verdict == "right" && !o.warning.empty();
    ++(o.told ? s.told : s.not_told)[o.verdict];
    if (o.verdict == "refused") ++s.reasons[o.status + ": " + kind_of(o.reason)];
    if (o.verdict == "undecided") ++s.undecided[o.why_undecided.substr(0, o.why_undecided.find(" at t"))];
    // Smaller errors are dominated by rounding and the comparison itself.
    if (o.status == "solved" && o.verdict != "undecided" && !std::isnan(o.estimate) &&
        o.error.largest() > 1e-6 * tolerance)
      s.effectivity.push_back(o.estimate / o.error.largest());
    if (!std::isnan(o.estimate_x)) s.certificates.add(o);
    s.seconds += o.seconds, s.oracle_seconds += o.oracle_seconds;
  }
  for (std::vector<double>* ratios : {&s.effectivity, &s.certificates.ratios_x, &s.certificates.ratios_y})
    std::sort(ratios->begin(), ratios->end());
  return s;
}

double quantile(const std::vector<double>& sorted, double q) {
  return sorted.empty() ? NAN : sorted[std::size_t(q * double(sorted.size() - 1))];
}

double within(const std::vector<double>& v) {
  const auto good = std::count_if(v.begin(), v.end(), [](double e) { return e >= 0.3 && e <= 3; });
  return v.empty() ? NAN : double(good) / double(v.size());
}

void print(const Summary& s, std::size_t count) {
  std::printf("\n%zu scenes; solves %.1f s, oracle %.1f s\n", count, s.seconds, s.oracle_seconds);
  std::printf("%-17s %7s %7s %9s\n", "", "all", "told", "not told");
  for (const auto& [verdict, all] : s.verdicts)
    std::printf("%-17s %7ld %7ld %9ld\n", verdict.c_str(), all, s.told.contains(verdict) ? s.told.at(verdict) : 0,
                s.not_told.contains(verdict) ? s.not_told.at(verdict) : 0);
  std::printf(
      "right: error <= tol; missed: <= 3 tol; wrong: above; refused: data changed by 1e-10 move it by < tol / 10\n");
  const auto& e = s.effectivity;
  std::printf(
      "effectivity (estimate / error): 2.5 %% %.2g, 25 %% %.2g, median %.2g, 75 %% %.2g, 97.5 %% %.2g; in [0.3, 3]: "
      "%.0f %%\n",
      quantile(e, 0.025), quantile(e, 0.25), quantile(e, 0.5), quantile(e, 0.75), quantile(e, 0.975), 100 * within(e));
  const auto histogram = [](const char* title, const std::map<std::string, long>& counts) {
    std::vector<std::pair<long, std::string>> rows;
    for (const auto& [name, n] : counts) rows.emplace_back(n, name);
    std::sort(rows.rbegin(), rows.rend());
    std::printf("%s\n", title);
    for (const auto& [n, name] : rows) std::printf("%6ld  %s\n", n, name.c_str());
  };
  histogram("refused though well-conditioned:", s.reasons);
  histogram("undecided by the oracle:", s.undecided);
}

ordered_json as_json(const OfCertificates& c) {
  return {{"off", c.off},
          {"above", c.above},
          {"above_unseen", c.above_unseen},
          {"right", c.right},
          {"below", c.below},
          {"below_doubted", c.below_doubted},
          {"x_compared", c.ratios_x.size()},
          {"x_in_0.3_to_3", within(c.ratios_x)},
          {"x_median", quantile(c.ratios_x, 0.5)},
          {"y_compared", c.ratios_y.size()},
          {"y_in_0.3_to_3", within(c.ratios_y)},
          {"y_median", quantile(c.ratios_y, 0.5)}};
}

void write(const Arguments& a, const std::vector<Outcome>& all, const Summary& s) {
  ordered_json rows = ordered_json::array();
  for (const Outcome& o : all)
    if (a.rows == "all" || (o.verdict != "right" && o.verdict != "undecided")) rows.push_back(as_json(o));
  ordered_json quantiles;
  for (const auto& [name, q] :
       {std::pair{"2.5 %", 0.025}, {"25 %", .25}, {"50 %", .5}, {"75 %", .75}, {"97.5 %", 0.975}})
    quantiles[name] = quantile(s.effectivity, q);
  ordered_json json{{"commit", build_info::commit},
                    {"compiler", build_info::compiler},
                    {"jobs", a.jobs},
                    {"first_seed", a.first_seed},
                    {"count", all.size()},
                    {"method", to_string(a.method)},
                    {"tolerance", a.tolerance},
                    {"seconds", a.seconds},
                    {"steps", a.steps},
                    {"right_with_warning", s.right_with_warning},
                    {"verdicts", s.verdicts},
                    {"told", s.told},
                    {"not_told", s.not_told},
                    {"refused", s.reasons},
                    {"undecided", s.undecided},
                    {"effectivity", quantiles},
                    {"effectivity_in_0.3_to_3", within(s.effectivity)},
                    {"scenes", rows}};
  if (a.steps > 0) json["certificates"] = as_json(s.certificates);
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
