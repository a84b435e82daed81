// A batch of rattling gears with the derivatives of their motion by the coefficients of friction and restitution, some
// of them beside differences of located events of the tests, which share no code with the solver. bromwich_gears --help
// says how.
//
// mu is drawn from 0 to 0.6 and e from 0 to 1; a hundredth has e = 0, where bounces begin with e and there is no
// derivative. The error of a derivative is that of x(T), beside 1 and the largest entry. Where differences with two
// steps do not agree they say nothing. Times are those of the processors, of all threads.

#include "app/machine.hpp"
#include "batch/batch_parameters.hpp"
#include "bench/arguments.hpp"
#include "bench/processes.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/mechanics/contact_flow.hpp"
#include "tests/mechanics/structures.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <fstream>
#include <map>
#include <optional>
#include <random>
#include <string>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;

struct Arguments {
  Index count = 10000, compared = 100;
  double end = 4;
  int threads = 0;
  std::string out;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  CLI::App app("Rattling gears with derivatives by mu and e.");
  app.add_option("--count", a.count, "gears");
  app.add_option("--compared", a.compared, "gears whose derivatives are compared with differences");
  app.add_option("--end", a.end, "T");
  app.add_option("--threads", a.threads, "0: all");
  app.add_option("--out", a.out, "a JSON file");
  parse_or_exit(app, argc, argv);
  return a;
}

constexpr double tolerance = 1e-6;

struct Gears {
  std::vector<double> mu, e;
  double T;

  Gears(Index count, double end) : T(end) {
    std::mt19937 random(53);
    const auto draw = [&] { return std::uniform_real_distribution<double>(0, 1)(random); };
    for (Index k = 0; k < count; ++k) {
      mu.push_back(0.6 * draw());
      e.push_back(draw());
      if (k % 100 == 99) e.back() = 0;
    }
  }
  std::pair<double, double> of(Index k) const { return {mu[std::size_t(k)], e[std::size_t(k)]}; }
  Scene scene(double of_mu, double of_e) const { return rattling_gear(of_mu, of_e, T).scene; }
  Batch batch() const {
    Batch b;
    for (std::size_t k = 0; k < mu.size(); ++k) b.own.push_back(scene(mu[k], e[k]));
    b.common = b.own.front();
    b.scenes = Index(mu.size());
    b.times = {0, T / 2, T};
    return b;
  }
  std::vector<VariedParameter> parameters(Index k) const {
    const auto [m, r] = of(k);
    return {{"mu", m,
             [this, r = r](double value) {
               return ParameterScene{scene(value, r), nullptr};
             }},
            {"e", r, [this, m = m](double value) {
               return ParameterScene{scene(m, value), nullptr};
             }}};
  }
  std::optional<Vector> end_of(double of_mu, double of_e) const {
    const oracle::ContactFlow flow = oracle::contact_flow(rattling_gear(of_mu, of_e, T), 1, 2e-3);
    if (!flow.decided) return std::nullopt;
    return Vector((Vector(4) << flow.q[0], flow.v[0]).finished());
  }
  /// x(T) by one of them, 0: mu; nothing where differences do not tell.
  std::optional<Vector> difference(Index k, int parameter) const {
    const auto [m, r] = of(k);
    std::optional<Vector> found;
    for (const double step : {1e-4, 5e-5}) {
      const double by_mu = parameter == 0 ? step : 0, by_e = step - by_mu;
      const auto up = end_of(m + by_mu, r + by_e), down = end_of(m - by_mu, r - by_e);
      if (!up || !down) return std::nullopt;
      const Vector next = (*up - *down) / (2 * step);
      const double size = 1 + next.cwiseAbs().maxCoeff();
      if (found && (next - *found).cwiseAbs().maxCoeff() > 1e-3 * size) return std::nullopt;
      found = next;
    }
    return found;
  }
};

// The reason without its numbers.
std::string kind_of(const std::string& reason) {
  std::string kind;
  for (const char c : reason)
    if (!(c >= '0' && c <= '9') && c != '.') kind += c;
  return kind.substr(0, 90);
}

struct Comparison {
  long compared = 0, undecided = 0, off = 0, masked_but_smooth = 0;
  double largest = 0;
};

// Every so many gears.
Comparison compare(const Gears& gears, const BatchJacobian& found, Index count) {
  Comparison c;
  const Index K = Index(gears.mu.size()), every = std::max<Index>(1, K / std::max<Index>(1, count));
  for (Index k = 0; k < K && c.compared + c.undecided < 2 * count; k += every)
    for (int p = 0; p < 2; ++p) {
      const std::optional<Vector> difference = gears.difference(k, p);
      const bool masked = !found.reason[std::size_t(k)].empty();
      if (!difference) {
        ++c.undecided;
        continue;
      }
      if (masked) {
        ++c.masked_but_smooth;
        continue;
      }
      const Vector by = found.by[std::size_t(p)][std::size_t(k)].x.bottomRows(1).transpose();
      const double error = (by - *difference).cwiseAbs().maxCoeff() / (1 + difference->cwiseAbs().maxCoeff());
      ++c.compared;
      c.off += error > 1e-3;
      c.largest = std::max(c.largest, error);
    }
  return c;
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  const Gears gears(a.count, a.end);
  const Batch batch = gears.batch();
  const auto backend = make_cpu_backend(a.threads);
  Options options;
  options.tolerance = tolerance;
  options.states = StateSelection::all;
  double begin = cpu_seconds();
  const BatchResult r = solve_batch(batch, *backend, options, [] { return make_cpu_backend(1); });
  const double of_solves = cpu_seconds() - begin;
  begin = cpu_seconds();
  const BatchJacobian found = jacobian_of(
      batch, r, [&](Index k) { return gears.parameters(k); }, *backend, std::nullopt, *backend);
  const double of_derivatives = cpu_seconds() - begin;
  std::map<std::string, long> methods, masked, unsolved;
  long with = 0;
  for (std::size_t k = 0; k < found.reason.size(); ++k) {
    ++methods[to_string(r.method[k])];
    if (r.status[k] != Status::solved) ++unsolved[kind_of(r.reason[k])];
    if (found.reason[k].empty())
      ++with;
    else
      ++masked[kind_of(found.reason[k])];
  }
  const Comparison c = compare(gears, found, a.compared);
  const ordered_json json{{"bench", "gears"},
                          {"commit", build_info::commit},
                          {"compiler", build_info::compiler},
                          {"machine", {{"cpu", app::cpu_model()}, {"cores", app::cpu_cores()}}},
                          {"threads", backend->threads()},
                          {"count", a.count},
                          {"end", a.end},
                          {"tolerance", tolerance},
                          {"solved", r.solved()},
                          {"methods", methods},
                          {"unsolved", unsolved},
                          {"with_derivatives", with},
                          {"masked", masked},
                          {"cpu_seconds", {{"solves", of_solves}, {"derivatives", of_derivatives}}},
                          {"differences",
                           {{"compared", c.compared},
                            {"off", c.off},
                            {"largest_error", c.largest},
                            {"undecided", c.undecided},
                            {"masked_but_smooth", c.masked_but_smooth}}}};
  std::printf("%s\n", json.dump(1).c_str());
  if (!a.out.empty()) std::ofstream(a.out) << json.dump(1) << '\n';
  return c.off == 0 ? 0 : 1;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_gears: %s\n", error.what());
  return 2;
}
