// Micro-benchmarks of the backend's operations and of the limits of the machine, measured in the same run (Google
// Benchmark). scripts/bench_micro runs them and writes bench/results/micro.json.
//
//   bench_micro --benchmark_filter=lcp
//   OMP_NUM_THREADS=1 bench_micro --benchmark_format=json

#include "bench/micro.hpp"

#include "app/machine.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"

#include <cmath>
#include <string>

namespace bromwich::micro {

Backend& backend() {
  static const auto made = make_cpu_backend();
  return *made;
}

int threads() { return backend().device().threads; }

Matrix Random::matrix(Index rows, Index cols) {
  Matrix values(rows, cols);
  for (double& value : values.reshaped()) value = uniform(-1, 1);
  return values;
}

std::unique_ptr<Array> device(const RowMatrix& values) {
  auto array = backend().array(values.rows(), values.cols());
  backend().upload(values, *array);
  return array;
}

RowMatrix host(const Array& array) {
  RowMatrix values;
  backend().download(array, values);
  return values;
}

Field::Field(Index rows, Index n) : in(device(Random(1).matrix(rows, n))), out(backend().array(rows, n)) {}

benchmark::Counter rate(double each) { return {each, benchmark::Counter::kIsIterationInvariantRate}; }

void count(benchmark::State& state, const Work& work) {
  if (work.bytes > 0) state.counters["bytes_per_second"] = rate(work.bytes);
  if (work.flops > 0) state.counters["flops"] = rate(work.flops);
  if (work.divisions > 0) state.counters["divisions"] = rate(work.divisions);
  if (work.footprint > 0) state.counters["footprint"] = work.footprint;
}

double relative_difference(const RowMatrix& a, const RowMatrix& b) {
  const double apart = (a - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
  return a.allFinite() && b.allFinite() ? apart : INFINITY;
}

namespace {

void add_context() {
  benchmark::AddCustomContext("schema", "bromwich-micro/1");
  benchmark::AddCustomContext("cpu", app::cpu_model());
  benchmark::AddCustomContext("cores", std::to_string(app::cpu_cores()));
  benchmark::AddCustomContext("memory", std::to_string((long long)app::memory_bytes()));
  benchmark::AddCustomContext("threads", std::to_string(threads()));
  benchmark::AddCustomContext("compiler", build_info::compiler);
  benchmark::AddCustomContext("build_type", build_info::build_type);
  benchmark::AddCustomContext("flags", build_info::flags);
  benchmark::AddCustomContext("commit", build_info::commit);
  benchmark::AddCustomContext("version", build_info::version);
}

}  // namespace
}  // namespace bromwich::micro

int main(int argc, char** argv) {
  using namespace bromwich::micro;
  add_context();
  register_ceilings();
  register_lcp();
  register_convolutions();
  register_resolvents();
  register_marches();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
}
