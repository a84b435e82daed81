// Slabs of time over R ranks: what a sweep costs on the ranks of this run, and a model of it for more of them.
//
//     sweep(J, R) = point n J (1 + carry) / R + messages (1 + log2 R) latency + bytes / bandwidth
//     cycle(J, R) = sum over the grids J, J/2, .., of 2 sweeps each, those below 64 R steps as on one rank
//
// n J points, R > 1 for what is behind the first term, bytes 8 n (K + 1) to the next rank and 8 (R - 1) P to all
// (core/slabs/slab_convolution.hpp). Measured: point, latency, bandwidth, and carry, the work of a rank on the state at
// the ends of its slab relative to its sweep. Any of them may be given by --set instead, for another machine.

#include "bench/studies/scale.hpp"

#include "app/commands.hpp"
#include "app/ranks.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/slabs/slab_backend.hpp"
#include "core/slabs/slab_states.hpp"
#include "core/slabs/slabs.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

namespace bromwich::app {

namespace {

constexpr Index sweeps_of_a_run = 10;
const std::vector<std::string> term_names{"point", "carry", "latency", "bandwidth"};

/// What the weights say: n, K and the decay of all modes.
struct Carries {
  Index n = 0, K = 0;
  RowMatrix decay;

  double lasting(double steps) const {
    double count = 0;
    for (Index i = 0; i < decay.size(); ++i) count += std::pow(std::abs(decay.data()[i]), steps) > forgotten;
    return count;
  }
  /// That one rank sends in a sweep.
  double bytes(double J, double R) const {
    return 8 * (double(n) * double(K + 1) + (R > 2 ? (R - 1) * lasting(J / R) : 0));
  }
};

using Terms = std::map<std::string, double>;

double sweep(const Terms& terms, const Carries& c, double J, double R) {
  const double work = terms.at("point") * double(c.n) * J / R;
  if (R == 1) return work;
  return work * (1 + terms.at("carry")) + (1 + std::log2(R)) * terms.at("latency") +
         c.bytes(J, R) / terms.at("bandwidth");
}

double cycle(const Terms& terms, const Carries& c, double J, double R) {
  double sum = 0;
  for (double steps = J; steps >= double(fewest_steps_of_a_slab); steps /= 2)
    sum += 2 * sweep(terms, c, steps, steps >= double(fewest_steps_of_a_slab) * R ? R : 1);
  return sum;
}

Carries carries_of(const Scene& scene, Backend& backend, Index J) {
  const DiscreteProblem p = discretise(scene, backend, J);
  const SharedWeights weights = make_time_operator(p)->weights(J, nullptr, 0);
  const ModalRecurrence* modal = modal_recurrence_of(*weights);
  if (!modal) throw Error("SCENE", fmt::format("'{}' has no sine modes", scene.name), "use signorini or signorini3d");
  return {modal->modes(), modal->exponentials(), modal->decay};
}

/// Seconds of one sweep of the iteration over all points, the least of the repeats; rank by rank the slowest.
double seconds_of_sweep(const Scene& scene, Backend& backend, Index J, int repeats) {
  Options options;
  options.method = Method::contour;
  options.steps = J;
  options.max_iterations = sweeps_of_a_run;
  double least = INFINITY;
  for (int i = 0; i <= repeats; ++i) {
    const Result result = solve(scene, backend, options);
    if (i > 0) least = std::min(least, result.seconds.sweeps / double(result.iterations - 1));
  }
  Vector slowest = Vector::Constant(1, least);
  ranks().maximum(slowest);
  return slowest[0];
}

/// Of a shift of this many values, the least of many.
double seconds_of_shift(Index values) {
  const Vector right = Vector::Ones(values);
  Vector left = Vector::Zero(values), least = Vector::Constant(1, -INFINITY);
  for (int i = 0; i < 200; ++i) {
    ranks().gather(Vector::Zero(1));
    Timer timer;
    ranks().shift(right, left);
    if (ranks().rank() > 0) least[0] = std::max(least[0], -timer.lap());
  }
  ranks().maximum(least);
  return -least[0];
}

void measure(const Scene& scene, Backend& backend, const Carries& c, Index J, int repeats, Terms& terms,
             BenchReport& report) {
  const int R = ranks().size();
  const double one = seconds_of_sweep(scene, backend, J, repeats);
  terms.emplace("point", one / double(c.n * J));
  if (R == 1) return;
  const auto divided = make_slab_backend(make_cpu_backend(backend.threads()), ranks());
  const Traffic before = ranks().sent();
  const double many = seconds_of_sweep(scene, *divided, J, repeats);
  const Index large = std::max<Index>(c.n * (c.K + 1), 1 << 16);
  const double latency = seconds_of_shift(1), transfer = seconds_of_shift(large);
  terms.emplace("latency", latency);
  terms.emplace("bandwidth", 8 * double(large) / std::max(transfer - latency, 1e-9));
  Terms without = terms;
  without.insert_or_assign("carry", 0.);
  terms.emplace("carry", std::max(0., (many - sweep(without, c, double(J), R)) * R / one));
  report.rows.push_back({{"kind", "measured"},
                         {"ranks", R},
                         {"steps", J},
                         {"sweep_on_one", one},
                         {"sweep", many},
                         {"efficiency", one / (many * R)},
                         {"bytes_shifted", (ranks().sent().shifted - before.shifted)}});
}

BenchRequest without_terms(const BenchRequest& request, Terms& terms) {
  BenchRequest rest = request;
  for (const std::string& name : term_names) {
    const auto given = rest.settings.find(name);
    if (given == rest.settings.end()) continue;
    if (!(name == "bandwidth" ? given->second > 0 : given->second >= 0))
      throw Error("--set", fmt::format("{} is not positive", name), "give a positive number");
    terms[name] = given->second;
    rest.settings.erase(given);
  }
  return rest;
}

}  // namespace

BenchReport bench_scale(const BenchRequest& asked, Backend& backend) {
  Terms terms;
  const BenchRequest request = without_terms(asked, terms);
  BenchReport report;
  report.scene = request.scene.value_or("signorini3d");
  ParameterValues settings = request.settings;
  if (!settings.contains("Q")) settings["Q"] = request.quick ? 15 : 31;
  const SceneChoice choice = choose_scene(report.scene, settings);
  const Index J = request.steps > 0 ? request.steps : request.quick ? 512 : 2048;
  const Carries c = carries_of(choice.scene, backend, J);
  const bool all_given = terms.size() == term_names.size();
  if (!all_given) measure(choice.scene, backend, c, J, request.repeats(), terms, report);
  if (terms.size() < term_names.size())
    throw Error("mpirun", "did not start several ranks, whose messages would be measured",
                "use mpirun -n 2, or --set latency=, bandwidth= (bytes a second) and carry=");
  report.parameters = to_json(choice.parameters);
  report.details = {
      {"terms", terms}, {"exponentials", c.K}, {"given", asked.settings.size() > request.settings.size()}};

  std::vector<std::vector<std::string>> lines{
      {"ranks", "steps", "sweep", "cycle", "efficiency, same J", "efficiency, J a rank", "bytes a rank"}};
  for (const double R : {1., 2., 4., 8., 64., 512.}) {
    const double strong = cycle(terms, c, double(J), 1) / (R * cycle(terms, c, double(J), R)),
                 weak = cycle(terms, c, double(J), 1) / cycle(terms, c, double(J) * R, R);
    const double bytes = R > 1 ? c.bytes(double(J), R) : 0;
    lines.push_back({fmt::format("{}", int(R)), fmt::format("{}", J), format_seconds(sweep(terms, c, double(J), R)),
                     format_seconds(cycle(terms, c, double(J), R)), fmt::format("{:.2f}", strong),
                     fmt::format("{:.2f}", weak), format_bytes(bytes)});
    report.rows.push_back({{"kind", "predicted"},
                           {"ranks", int(R)},
                           {"steps", J},
                           {"sweep", sweep(terms, c, double(J), R)},
                           {"cycle", cycle(terms, c, double(J), R)},
                           {"strong", strong},
                           {"weak", weak},
                           {"bytes", bytes}});
  }
  std::string text = table(lines);
  for (const auto& [name, value] : terms) text += fmt::format("{} {:.3g}\n", name, value);
  report.notes.push_back(
      "predicted from the terms; every grid of a cycle has two sweeps, and a message is never hidden "
      "behind work");
  for (const Json& row : report.rows)
    if (row["kind"] == "measured")
      report.notes.push_back(fmt::format("measured on {} ranks: a sweep takes {}, on one {}", row["ranks"].get<int>(),
                                         format_seconds(row["sweep"].get<double>()),
                                         format_seconds(row["sweep_on_one"].get<double>())));
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
