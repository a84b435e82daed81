// Scenes with matrices of their own on one device, several at a time: each thread of the host has a backend, and so a
// stream, of its own. signorini with 64 diffusivities and sources; whole solves, and solves prepared with another x0.

#include "bench/studies/streams.hpp"

#include "app/backend_choice.hpp"
#include "app/commands.hpp"
#include "app/text.hpp"
#include "catalogue/catalogue.hpp"
#include "core/base/error.hpp"
#include "core/base/timer.hpp"
#include "core/scene/separable.hpp"
#include "core/solve/solver.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <barrier>
#include <cmath>
#include <exception>
#include <memory>
#include <thread>
#include <vector>

namespace bromwich::app {

namespace {

struct StreamRun {
  std::vector<double> whole, prepared;  ///< seconds a scene, of each round
  std::vector<RowMatrix> y;             ///< of the last prepared solves
  Index solved = 0, solves = 0;
};

std::vector<Scene> scenes_of_streams(double Q, Index count) {
  std::vector<Scene> scenes;
  for (Index k = 0; k < count; ++k) {
    const double part = double(k) / double(count);
    scenes.push_back(make_scene("signorini", {{"Q", Q}, {"c", 0.02 * std::pow(10, part)}}));
    TimeFunction& g = scenes.back().g;
    g = SeparableSource{(1 + 0.5 * part) * g.separable()->shapes, g.separable()->time};
  }
  return scenes;
}

// Scenes k = thread, thread + threads, ... of one thread, in rounds that all threads begin together.
class Streams {
 public:
  Streams(const std::vector<Scene>& scenes, Index steps, int threads, int rounds)
      : scenes_(scenes), threads_(threads), rounds_(rounds), together_(threads) {
    options_.steps = steps;
    options_.method = Method::multigrid;
    run_.y.resize(scenes.size());
    failures_.resize(std::size_t(threads));
  }

  StreamRun run(int host_threads) {
    std::vector<std::thread> threads;
    for (int i = 0; i < threads_; ++i)
      threads.emplace_back([this, i, host_threads] {
        try {
          work(i, host_threads);
        } catch (...) {  // the others wait for this thread
          failures_[std::size_t(i)] = std::current_exception();
          together_.arrive_and_drop();
        }
      });
    for (std::thread& thread : threads) thread.join();
    for (const std::exception_ptr& failure : failures_)
      if (failure) std::rethrow_exception(failure);
    run_.solved = solved_, run_.solves = solves_;
    return std::move(run_);
  }

 private:
  void work(int thread, int host_threads) {
    const auto backend = make_cuda_backend(make_cpu_backend(host_threads));
    const auto each = [&](const auto& use) {
      for (std::size_t k = std::size_t(thread); k < scenes_.size(); k += std::size_t(threads_)) use(k);
    };
    std::vector<std::unique_ptr<Solver>> solvers(scenes_.size());
    each([&](std::size_t k) { solvers[k] = std::make_unique<Solver>(scenes_[k], *backend, options_); });
    for (int round = 0; round <= rounds_; ++round)  // the first one warms up
      timed(thread, round, run_.whole,
            [&] { each([&](std::size_t k) { count(solve(scenes_[k], *backend, options_)); }); });
    for (int round = 0; round <= rounds_; ++round)
      timed(thread, round, run_.prepared, [&] {
        each([&](std::size_t k) {
          solvers[k]->set_x0((1 + 0.01 * round) * scenes_[k].x0);
          Result result = solvers[k]->solve();
          count(result);
          run_.y[k] = std::move(result.y);
        });
      });
  }

  template <class Solves>
  void timed(int thread, int round, std::vector<double>& seconds, const Solves& solves) {
    together_.arrive_and_wait();
    Timer timer;
    solves();
    together_.arrive_and_wait();
    if (thread == 0 && round > 0) seconds.push_back(timer.lap() / double(scenes_.size()));
  }

  void count(const Result& result) {
    ++solves_;
    solved_ += result.status == Status::solved;
  }

  const std::vector<Scene>& scenes_;
  int threads_, rounds_;
  std::barrier<> together_;
  Options options_;
  StreamRun run_;
  std::atomic<Index> solved_ = 0, solves_ = 0;
  std::vector<std::exception_ptr> failures_;
};

}  // namespace

// The same scenes by one call of solve_batch, against single solves of some.
nlohmann::json by_solve_batch(const std::vector<Scene>& scenes, Index steps, int rounds, int threads) {
  Options options;
  options.steps = steps;
  options.method = Method::multigrid;
  const auto backend = make_cuda_backend(make_cpu_backend(threads));
  const MakeBackend beside = backends_beside(*backend);
  const Batch batch = batch_of(scenes);
  std::vector<double> whole;
  BatchResult result;
  Index solved = 0;
  for (int round = 0; round <= rounds; ++round) {  // the first one warms up
    Timer timer;
    result = solve_batch(batch, *backend, options, beside);
    if (round > 0) whole.push_back(timer.lap() / double(scenes.size()));
    solved += result.solved();
  }
  double apart = 0;
  for (std::size_t k = 0; k < scenes.size(); k += 7) {
    const Result one = solve(scenes[k], *backend, options);
    apart =
        std::max(apart, (result.of(result.y, Index(k)) - one.y).cwiseAbs().maxCoeff() / one.y.cwiseAbs().maxCoeff());
  }
  return {{"threads", threads},
          {"by", "solve_batch"},
          {"whole", median(whole)},
          {"solved", solved},
          {"solves", Index(scenes.size()) * (rounds + 1)},
          {"difference", apart}};
}

BenchReport bench_streams(const BenchRequest& request, Backend& backend) {
  refuse_scene(request);
  if (cuda_devices().empty()) throw Error("streams", "no CUDA device was found", "run it on a machine with one");
  BenchReport report;
  report.scene = "signorini";
  report.details["threads"] = "of the host, each with a CUDA backend of its own on the same device";
  report.details["by"] = "solve_batch: all scenes by one call with as many threads, and not by threads of the study";
  report.details["whole"] = "seconds a scene of solve, set-up included";
  report.details["prepared"] = "seconds a scene of Solver::set_x0 and Solver::solve";
  report.details["difference"] = "largest |y - y of one thread| / max |y|, prepared solves; of solve_batch: whole ones";
  report.parameters = {{"device", cuda_devices().front()}};
  const double Q = request.quick ? 15 : 127;
  const Index steps = request.quick ? 64 : 1024;
  const std::vector<Scene> scenes = scenes_of_streams(Q, request.quick ? 4 : 64);
  std::vector<std::vector<std::string>> lines{{"threads", "whole", "prepared", "solved", "difference"}};
  std::vector<RowMatrix> one;
  for (const int threads : {1, 2, 4, 8, 16}) {
    const int of_each = threads == 1 ? backend.device().threads : 1;
    StreamRun run = Streams(scenes, steps, threads, request.repeats()).run(of_each);
    if (one.empty()) one = run.y;
    double apart = 0;
    for (std::size_t k = 0; k < scenes.size(); ++k)
      apart = std::max(apart, (run.y[k] - one[k]).cwiseAbs().maxCoeff() / one[k].cwiseAbs().maxCoeff());
    report.rows.push_back({{"threads", threads},
                           {"scenes", scenes.size()},
                           {"Q", Q},
                           {"steps", steps},
                           {"whole", median(run.whole)},
                           {"prepared", median(run.prepared)},
                           {"solved", run.solved},
                           {"solves", run.solves},
                           {"difference", apart}});
    lines.push_back({fmt::format("{}", threads), format_seconds(median(run.whole)),
                     format_seconds(median(run.prepared)), fmt::format("{} of {}", run.solved, run.solves),
                     scientific(apart)});
  }
  const nlohmann::json batch = by_solve_batch(scenes, steps, request.repeats(), backend.device().threads);
  report.rows.emplace_back(batch);
  lines.push_back({"solve_batch", format_seconds(batch["whole"].get<double>()), "-",
                   fmt::format("{} of {}", batch["solved"].get<Index>(), batch["solves"].get<Index>()),
                   scientific(batch["difference"].get<double>())});
  print(fmt::format("a scene of {}, Q = {}, {} steps\n{}", scenes.size(), Q, steps, table(lines)));
  return report;
}

}  // namespace bromwich::app
