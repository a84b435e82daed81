// Slabs of time over R ranks: what a sweep costs on the ranks of this run, and a model of it for more of them.
//
//     sweep(J, R) = point n J (1 + carry) / R + messages (1 + log2 R) latency + bytes / bandwidth
//     cycle(J, R) = sum over the grids J, J/2, .., of 2 sweeps each, those below fewest R steps as on one
//         rank; fewest = Communicator::fewest_steps()
//
// n J points, R > 1 for what is behind the first term, bytes 8 n (K + 1) to the next rank and 8 (R - 1) P to all
// (ranks/slab_convolution.hpp). Measured: point, latency, bandwidth, and carry, the work of a rank on the state at
// the ends of its slab relative to its sweep. Any of them may be given by --set instead, for another machine. Whole
// solves by cycles are measured beside the model: with J steps on one rank and on all, and with J steps for each rank.

#include "bench/studies/scale.hpp"

#include "app/commands.hpp"
#include "app/ranks.hpp"
#include "app/text.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "ranks/slab_array.hpp"
#include "ranks/slab_backend.hpp"
#include "ranks/slab_states.hpp"
#include "ranks/slabs.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

namespace bromwich::app {

namespace {

constexpr Index sweeps_of_a_run = 10;
constexpr double algebraic_share = 0.05;  ///< error that cycles leave, relative to the discretisation error
const std::vector<std::string> term_names{"point", "carry", "latency", "bandwidth"};

/// What the weights say: n, K and the decay of all modes.
struct Carries {
  Index n = 0, K = 0, state = 0;  ///< state: values of it that travel
  double fewest = 0;              ///< steps of a rank in grids that are divided
  RowMatrix decay;

  double lasting(double steps) const {
    double count = 0;
    for (Index i = 0; i < decay.size(); ++i) count += std::pow(std::abs(decay.data()[i]), steps) > forgotten;
    return count;
  }
  /// That one rank sends in a sweep.
  double bytes(double J, double R) const { return 8 * (double(state + n) + (R > 2 ? (R - 1) * lasting(J / R) : 0)); }
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
  for (double steps = J; steps >= c.fewest; steps /= 2)
    sum += 2 * sweep(terms, c, steps, steps >= c.fewest * R ? R : 1);
  return sum;
}

Carries carries_of(const Scene& scene, Backend& backend, Index J, double fewest) {
  const DiscreteProblem p = discretise(scene, backend, J);
  const SharedWeights weights = make_time_operator(p)->weights(J, nullptr, 0);
  const ModalRecurrence* modal = modal_recurrence_of(*weights);
  if (!modal) throw Error("SCENE", fmt::format("'{}' has no sine modes", scene.name), "use signorini or signorini3d");
  Carries carries{modal->modes(), modal->exponentials(), modal->modes() * modal->exponentials(), fewest, modal->decay};
  if (const SlabOperations& slabs = backend.fused().slabs)  // groups of modes send what they have
    carries.state = slabs.carried_convolution(*modal, {0, J / 2, J}, 0)->state;
  return carries;
}

/// The backend of this rank, and the ranks whose rows it may have on a device.
struct Place {
  std::unique_ptr<Backend> own;
  std::unique_ptr<Communicator> devices;

  Communicator& communicator() const { return devices ? *devices : ranks(); }
};

Place place_of(const BenchRequest& request, int threads) {
  Place place;
  if (request.backend != "cuda") {
    place.own = make_cpu_backend(threads);
    return place;
  }
  const int devices = int(cuda_devices().size());
  if (devices == 0) throw Error("--backend", "found 'cuda' but no CUDA device", "use --backend cpu");
  place.own = make_cuda_backend(make_cpu_backend(threads), job().number_here % devices);
  if (ranks().size() == 1) return place;
  if (const std::string apart = devices_apart(); !apart.empty())
    throw Error("--backend", "found 'cuda' on several ranks, and " + apart, "use --backend cpu");
  place.devices = job().between_devices(dynamic_cast<const SharedMemory&>(*place.own).place());
  return place;
}

double slowest_of_ranks(double seconds) {
  Vector slowest = Vector::Constant(1, seconds);
  ranks().maximum(slowest);
  return slowest[0];
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
  return slowest_of_ranks(least);
}

/// A solve by cycles that stops where its error is a small part of that of the grid.
struct Cycles {
  std::vector<double> seconds, whole;  ///< of the nested start and the cycles; of the solve
  Result last;
};
Cycles cycles_of(const Scene& scene, Backend& backend, Index J, int repeats) {
  Options options;
  options.method = Method::multigrid;
  options.steps = J;
  options.tuning.algebraic_share = algebraic_share;
  Solver solver(scene, backend, options);
  Cycles cycles;
  for (int i = 0; i <= repeats; ++i) {
    ranks().gather(Vector::Zero(1));  // all begin together
    Timer timer;
    cycles.last = solver.solve();
    const double whole = slowest_of_ranks(timer.lap()), sweeps = slowest_of_ranks(cycles.last.seconds.sweeps);
    if (i == 0) continue;
    cycles.seconds.push_back(sweeps);
    cycles.whole.push_back(whole);
  }
  return cycles;
}

/// Of a shift of one row with this many values, the least of many.
double seconds_of_shift(const Place& place, Index values) {
  const auto right = place.own->array(1, values), left = place.own->array(1, values);
  const RankedBackend ranked{*place.own, place.communicator()};
  Vector least = Vector::Constant(1, -INFINITY);
  for (int i = 0; i < 200; ++i) {
    place.own->wait();
    ranks().gather(Vector::Zero(1));
    Timer timer;
    ranked.shift({{right.get(), 0, left.get(), 0, 1}});
    place.own->wait();
    if (ranks().rank() > 0) least[0] = std::max(least[0], -timer.lap());
  }
  ranks().maximum(least);
  return -least[0];
}

Json row_of(Index J, int on, const Cycles& cycles) {
  return {{"kind", "cycles"},
          {"ranks", on},
          {"steps", J},
          {"status", to_string(cycles.last.status)},
          {"cycles", cycles.last.cycles},
          {"convolutions", cycles.last.convolutions},
          {"residual", cycles.last.residual},
          {"bytes", cycles.last.bytes},
          {"seconds", spread(cycles.seconds)},
          {"prepared", spread(cycles.whole)}};
}

// With J steps on all ranks, and with J for each.
void measure_divided_cycles(const Scene& scene, const Place& place, Backend& divided, Index J, const Cycles& one,
                            int repeats, BenchReport& report) {
  const int R = ranks().size();
  for (const Index steps : {J, J * R}) {
    const Traffic before = place.communicator().sent();
    const Cycles many = cycles_of(scene, divided, steps, repeats);
    Json row = row_of(steps, R, many);
    row["bytes_shifted"] = place.communicator().sent().shifted - before.shifted;
    row["efficiency"] = median(one.seconds) * double(steps) / double(J) / (median(many.seconds) * R);
    if (steps == J) row["apart"] = (many.last.y - one.last.y).cwiseAbs().maxCoeff() / one.last.y.cwiseAbs().maxCoeff();
    report.rows.push_back(std::move(row));
  }
}

// One rank alone first: it needs no other.
void measure(const Scene& scene, Place& place, const Carries& c, Index J, int repeats, Terms& terms,
             BenchReport& report) {
  const int R = ranks().size();
  const double one = seconds_of_sweep(scene, *place.own, J, repeats);
  const Cycles cycles = cycles_of(scene, *place.own, J, repeats);
  terms.emplace("point", one / double(c.n * J));
  report.rows.push_back(row_of(J, 1, cycles));
  if (R == 1) return;
  const Index large = std::max<Index>(c.state + c.n, 1 << 16);
  const double latency = seconds_of_shift(place, 1), transfer = seconds_of_shift(place, large);
  terms.emplace("latency", latency);
  terms.emplace("bandwidth", 8 * double(large) / std::max(transfer - latency, 1e-9));
  const auto divided = make_slab_backend(std::move(place.own), place.communicator());
  const Traffic before = place.communicator().sent();
  const double many = seconds_of_sweep(scene, *divided, J, repeats);
  Terms without = terms;
  without.insert_or_assign("carry", 0.);
  terms.emplace("carry", std::max(0., (many - sweep(without, c, double(J), R)) * R / one));
  report.rows.push_back({{"kind", "measured"},
                         {"ranks", R},
                         {"steps", J},
                         {"sweep_on_one", one},
                         {"sweep", many},
                         {"efficiency", one / (many * R)},
                         {"bytes_shifted", (place.communicator().sent().shifted - before.shifted)}});
  measure_divided_cycles(scene, place, *divided, J, cycles, repeats, report);
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

namespace {

constexpr std::array predicted_ranks{1., 2., 4., 8., 64., 512.};

std::string predictions(const Terms& terms, const Carries& c, Index J, BenchReport& report) {
  std::vector<std::vector<std::string>> lines{
      {"ranks", "steps", "sweep", "cycle", "efficiency, same J", "efficiency, J a rank", "bytes a rank"}};
  const double steps = double(J), alone = cycle(terms, c, steps, 1);
  for (const double R : predicted_ranks) {
    const double strong = alone / (R * cycle(terms, c, steps, R)), weak = alone / cycle(terms, c, steps * R, R);
    const double bytes = R > 1 ? c.bytes(steps, R) : 0;
    lines.push_back({fmt::format("{}", int(R)), fmt::format("{}", J), format_seconds(sweep(terms, c, steps, R)),
                     format_seconds(cycle(terms, c, steps, R)), fmt::format("{:.2f}", strong),
                     fmt::format("{:.2f}", weak), format_bytes(bytes)});
    report.rows.push_back({{"kind", "predicted"},
                           {"ranks", int(R)},
                           {"steps", J},
                           {"sweep", sweep(terms, c, steps, R)},
                           {"cycle", cycle(terms, c, steps, R)},
                           {"strong", strong},
                           {"weak", weak},
                           {"bytes", bytes}});
  }
  return table(lines);
}

void take_notes(BenchReport& report) {
  report.notes.push_back(
      "predicted from the terms; every grid of a cycle has two sweeps, and a message is never hidden "
      "behind work");
  for (const Json& row : report.rows) {
    if (row["kind"] == "measured")
      report.notes.push_back(fmt::format("measured on {} ranks: a sweep takes {}, on one {}", row["ranks"].get<int>(),
                                         format_seconds(row["sweep"].get<double>()),
                                         format_seconds(row["sweep_on_one"].get<double>())));
    if (row["kind"] == "cycles")
      report.notes.push_back(fmt::format(
          "measured on {} ranks, {} steps: {} of cycles ({})", row["ranks"].get<int>(), row["steps"].get<Index>(),
          format_seconds(row["seconds"]["median"].get<double>()), row["status"].get<std::string>()));
  }
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
  Place place = place_of(request, backend.threads());
  const Carries c = carries_of(choice.scene, *place.own, J, double(place.communicator().fewest_steps()));
  report.details["device"] = place.own->device().name;
  const bool all_given = terms.size() == term_names.size();
  if (!all_given) measure(choice.scene, place, c, J, request.repeats(), terms, report);
  if (terms.size() < term_names.size())
    throw Error("mpirun", "did not start several ranks, whose messages would be measured",
                "use mpirun -n 2, or --set latency=, bandwidth= (bytes a second) and carry=");
  report.parameters = to_json(choice.parameters);
  report.details["terms"] = terms;
  report.details["exponentials"] = c.K;
  report.details["state"] = c.state;
  report.details["given"] = asked.settings.size() > request.settings.size();
  std::string text = predictions(terms, c, J, report);
  for (const auto& [name, value] : terms) text += fmt::format("{} {:.3g}\n", name, value);
  take_notes(report);
  print_with_notes(text, report);
  return report;
}

}  // namespace bromwich::app
