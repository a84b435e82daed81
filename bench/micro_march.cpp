// Marching the signorini scene (T = 4, 400 steps): the recurrence's state, two sine transforms and one complementarity
// problem per step.
//
// Only the work on the state is counted, K exponentials in each of n modes: decay and output read, the state read and
// written once per block of 16 steps, 32 bytes, and 4 operations per exponential, mode and step. K is the number of
// eigenvalues Q (modal, Euler) or that of the compressed kernel.

#include "bench/micro.hpp"

#include "catalogue/catalogue.hpp"
#include "core/kernel/compression.hpp"
#include "core/kernel/discretise.hpp"
#include "core/march/outcome.hpp"

#include <map>
#include <string>
#include <utility>

namespace bromwich::micro {

namespace {

constexpr Index steps = 400, block = 16;

enum class Kind { modal, compressed, euler };

constexpr std::pair<Kind, const char*> kinds[] = {
    {Kind::modal, "modal"}, {Kind::compressed, "compressed"}, {Kind::euler, "euler"}};

struct Prepared {
  Scene scene;
  DiscreteProblem problem;
  Recurrence recurrence;
  std::unique_ptr<Array> r, drive, y, v;
  std::unique_ptr<March> plan;

  Prepared(Kind kind, Index Q)
      : scene(make_scene("signorini", {{"Q", double(Q)}})), problem(discretise(scene, backend(), steps)) {
    const KroneckerDynamics& d = *problem.modes();
    RowMatrix free = problem.g.table();
    if (kind == Kind::compressed) {
      recurrence = compressed_recurrence(backend(), d, compress_line_kernel(d, problem.h, scene.T), problem.h);
      const auto response = device(kronecker_initial_response(problem)), g = device(free);
      backend().sine_transform(Q, steps + 1)->apply(*response, g.get(), *g, 0);
      free = host(*g);
    } else {
      const Rule rule = kind == Kind::euler ? Rule::implicit_euler : Rule::exponential;
      recurrence = modal_recurrence(d, rule, problem.h, x0_in_modes(backend(), d, scene.x0, true));
    }
    Result result;
    solve_at_zero(problem, result);
    free.row(0) = problem.start.transpose();
    r = device(free);
    drive = device(problem.drive()->table());
    y = device(result.y);
    v = backend().array(steps + 1, Q);
    MarchProblem march;
    march.M = &scene.M;
    march.lcp_class = problem.lcp_class;
    march.recurrence = &recurrence;
    march.r = r.get();
    march.drive = drive.get();
    plan = backend().march(march, steps + 1);
  }
  Prepared(const Prepared&) = delete;
  Prepared& operator=(const Prepared&) = delete;

  bool run() {
    const MarchReport report = plan->run(*y, *v);
    return report.stopped < 0 && report.finite && report.count.unsolved == 0;
  }
};

void march(benchmark::State& state, Kind kind) {
  static std::map<std::pair<Kind, Index>, Prepared> made;  // repetitions share them
  const Index Q = state.range(0);
  Prepared& prepared = made.try_emplace({kind, Q}, kind, Q).first->second;
  if (!prepared.run()) return state.SkipWithError("the march stopped");
  for (auto _ : state) prepared.run();
  const double exponentials = double(std::get<ModalRecurrence>(prepared.recurrence).exponentials());
  const double values = exponentials * double(Q);
  state.counters["steps"] = rate(double(steps));
  state.counters["exponentials"] = exponentials;
  count(state, {.bytes = 32 * values * steps / double(block), .flops = 4 * values * steps, .footprint = 24 * values});
}

}  // namespace

void register_marches() {
  for (const auto& [kind, word] : kinds)
    benchmark::RegisterBenchmark((std::string("march/recurrence:") + word).c_str(),
                                 [kind = kind](benchmark::State& state) { march(state, kind); })
        ->Arg(39)
        ->Arg(511)
        ->ArgName("Q")
        ->UseRealTime();
}

}  // namespace bromwich::micro
