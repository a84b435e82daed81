// `bromwich bench`: selects the benchmark, checks the request, and adds the provenance to the report.

#include "app/arguments.hpp"
#include "app/commands.hpp"
#include "app/machine.hpp"
#include "app/output_file.hpp"
#include "app/ranks.hpp"
#include "app/text.hpp"
#include "bench/studies/nonlinear.hpp"
#include "bench/studies/scale.hpp"
#include "bench/studies/streams.hpp"
#include "bench/studies/study.hpp"
#include "core/base/error.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <iterator>

namespace bromwich::app {

namespace {

constexpr auto benchmarks = std::to_array<Benchmark>({
    {"speed-vs-error", "every method with more and more steps: error and time, one thread and all",
     bench_speed_vs_error},
    {"baselines", "the iteration compared with time stepping: error and time", bench_baselines},
    {"adjoints", "all ways to solve the adjoint of a chain of steps, from 16 to 3001 states", bench_adjoints},
    {"auto", "the choice of auto compared with the best method by name", bench_auto},
    {"batch", "many scenes at once: time of a scene and step, compared with a loop of prepared solves", bench_batch},
    {"derivatives", "derivatives of all scenes compared with central differences of solves", bench_derivatives},
    {"fields", "sparse dynamics with contact on one side, compared with a sparse implicit Euler", bench_fields},
    {"galerkin", "boundary values and initial values by Galerkin in time, compared with implicit Euler",
     bench_galerkin},
    {"goal", "goal-oriented grids of port-Hamiltonian scenes: violation of the energy balance over steps and time",
     bench_goal},
    {"gpu", "the CUDA backend on signorini: one sweep in parts, whole solves, compared with the CPU", bench_gpu},
    {"contours", "the paper's contours for other spectra and for x0, against dense exponentials", bench_contours},
    {"convolution", "the two ways to apply the kernel: exponential scan and FFT", bench_convolution},
    {"literal", "the paper to the letter, on one core, all cores and a device, compared with marching", bench_literal},
    {"dual", "cycles in w on contact: contraction, and time compared with marching on one core", bench_dual, true},
    {"multigrid", "cycles on signorini: contraction, and cost to reach a tenth of the discretisation error",
     bench_multigrid, true},
    {"nonlinear", "reaction and diffusion at large sizes: error and time, compared with marching on one core",
     bench_nonlinear},
    {"paper", "the experiments of the paper on Laplace inversion, compared with its numbers", bench_paper},
    {"scale", "time points of a Kronecker scene divided among the ranks of mpirun, and a model for more of them",
     bench_scale, true},
    {"scenes", "all scene files of a folder: class, spectrum, method, error and time", bench_scenes},
    {"signorini3d", "contact on a face: cycles, marching and implicit Euler, times and work", bench_signorini3d, true},
    {"solver", "a prepared scene solved again with another x0, compared with whole solves", bench_solver},
    {"sparse", "heat on a square with 1e5 states and ten contacts", bench_sparse},
    {"sparse-shifts", "shifted solves of sparse dynamics, on one core, all cores and a device with cuDSS",
     bench_sparse_shifts},
    {"streams", "scenes with matrices of their own on one device, several at a time", bench_streams},
    {"stability", "hard cases with known solutions: error, estimate and status, compared with implicit Euler",
     bench_stability},
    {"tol", "error control: tolerance, estimated error, true error and work", bench_tol},
});

/// A reference on a grid at least four times finer must fit below max_steps.
constexpr long long max_bench_steps = max_steps / 4;

const Benchmark& find_benchmark(const std::vector<std::string>& names) {
  std::vector<std::string> known;
  known.reserve(benchmarks.size());
  for (const Benchmark& benchmark : benchmarks) known.emplace_back(benchmark.name);
  if (names.empty()) throw Error("NAME", "found none", "use one of " + join(known));
  for (const Benchmark& benchmark : benchmarks)
    if (names.front() == benchmark.name) return benchmark;
  throw Error("NAME", fmt::format("found '{}'", names.front()) + suggestion(names.front(), known),
              "use one of " + join(known));
}

BenchRequest make_request(const BenchArguments& arguments, const Words& words, const Benchmark& benchmark) {
  if (words.names.size() > 2)
    throw Error("SCENE", "found " + join({words.names.begin() + 1, words.names.end()}), "name one scene");
  BenchRequest request;
  if (words.names.size() == 2) request.scene = words.names[1];
  request.settings = parse_settings(words.settings, request.scene.value_or(""));
  request.quick = arguments.quick;
  request.backend = arguments.backend;
  if (!request.backend.empty() && !benchmark.each_backend)
    throw Error("--backend", fmt::format("found with '{}'", benchmark.name),
                "leave it out: this benchmark has its own");
  if (!request.backend.empty() && request.backend != "cpu" && request.backend != "cuda")
    throw Error("--backend", "found '" + request.backend + "'" + suggestion(request.backend, {"cpu", "cuda"}),
                "use cpu or cuda, or leave it out to measure both");
  request.siconos = arguments.siconos;
  if (!request.siconos.empty() && access(request.siconos.c_str(), X_OK) != 0)
    throw Error("--siconos", fmt::format("no program '{}'", request.siconos),
                "compile bench/peers/siconos_loop.cpp, as scripts/bench_stability does");
  if (!arguments.steps.empty()) request.steps = parse_steps(arguments.steps, max_bench_steps);
  return request;
}

Json envelope(const Benchmark& benchmark, const BenchRequest& request, const BenchReport& report, int threads) {
  Json json;
  json["schema"] = "bromwich-bench/1";
  json["bench"] = benchmark.name;
  json["scene"] = report.scene;
  json["parameters"] = report.parameters;
  json["machine"] = {{"cpu", cpu_model()}, {"cores", cpu_cores()}, {"memory", memory_bytes()}};
  json["compiler"] = build_info::compiler;
  json["build_type"] = build_info::build_type;
  json["flags"] = build_info::flags;
  json["commit"] = build_info::commit;
  json["version"] = build_info::version;
  json["threads"] = threads;
  json["repeats"] = request.repeats();
  json["quick"] = request.quick;
  json["date"] = utc_now();
  json["details"] = report.details;
  json["rows"] = report.rows;
  json["notes"] = report.notes;
  return json;
}

}  // namespace

std::string bench_list() {
  std::string text;
  for (const Benchmark& benchmark : benchmarks)
    fmt::format_to(std::back_inserter(text), "  {:<15} {}\n", benchmark.name, benchmark.summary);
  return text;
}

int run_bench(const BenchArguments& arguments) {
  const Words words = split_words(arguments.words, arguments.settings);
  const Benchmark& benchmark = find_benchmark(words.names);
  const BenchRequest request = make_request(arguments, words, benchmark);
  const int threads = threads_of_rank(arguments.threads.empty() ? 0 : parse_threads(arguments.threads));
  std::optional<OutputFile> out;
  if (!arguments.out.empty()) out.emplace("--out", arguments.out, ".json");

  const auto backend = make_cpu_backend(threads);
  const BenchReport report = benchmark.run(request, *backend);
  if (!out) return exit_solved;
  const std::string text = dump(envelope(benchmark, request, report, backend->device().threads));
  out->write([&text](std::FILE* file) { std::fwrite(text.data(), 1, text.size(), file); });
  return exit_solved;
}

}  // namespace bromwich::app
