#pragma once
// Common parts of the benchmarks: the request, the envelope of the JSON file, repeated timings and aligned tables.

#include "app/output_json.hpp"
#include "app/scene_choice.hpp"
#include "bench/studies/accuracy.hpp"
#include "core/solve/solve.hpp"

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace bromwich::app {

struct BenchRequest {
  std::optional<std::string> scene;
  ParameterValues settings;
  Index steps = 0;      ///< 0 = the benchmark's own choice
  std::string backend;  ///< the one that is measured, of studies on each; empty: all
  std::string siconos;  ///< the program of bench/peers/siconos_loop.cpp; empty: without Siconos
  bool quick = false;

  int repeats() const { return quick ? 2 : 5; }
};

/// The results of a benchmark; it prints its own tables.
struct BenchReport {
  std::string scene;
  Json parameters = Json::object();  ///< those common to all rows; each row also carries its own
  Json rows = Json::array();
  Json details = Json::object();   ///< how the numbers are defined
  std::vector<std::string> notes;  ///< conclusions, including the lost cases
};

struct Benchmark {
  const char* name;
  const char* summary;
  BenchReport (*run)(const BenchRequest&, Backend&);
  bool each_backend = false;  ///< measures on the host and on a device, or on one of them
};

/// Also on the CUDA backend if a device is found.
BenchReport bench_adjoints(const BenchRequest& request, Backend& backend);
/// SCENE is a scene or a scene file; without one, scenes of all structures.
BenchReport bench_auto(const BenchRequest& request, Backend& backend);
BenchReport bench_baselines(const BenchRequest& request, Backend& backend);
/// SCENE is a scene, a scene file or a folder of them; without one, all built-in scenes and the examples.
BenchReport bench_derivatives(const BenchRequest& request, Backend& backend);
/// SCENE is a scene or a scene file; without one, all scenes of the study.
BenchReport bench_speed_vs_error(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own.
BenchReport bench_fields(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own.
BenchReport bench_galerkin(const BenchRequest& request, Backend& backend);
/// Throws Error without a CUDA device.
BenchReport bench_gpu(const BenchRequest& request, Backend& backend);
BenchReport bench_goal(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own.
BenchReport bench_contours(const BenchRequest& request, Backend& backend);
BenchReport bench_convolution(const BenchRequest& request, Backend& backend);
/// Throws Error for another scene. Also on a CUDA device if there is one.
BenchReport bench_literal(const BenchRequest& request, Backend& backend);
/// Throws Error for another scene. Also on the CUDA backend if a device is found.
BenchReport bench_dual(const BenchRequest& request, Backend& backend);
/// Throws Error for another scene. Also on the CUDA backend if a device is found.
BenchReport bench_multigrid(const BenchRequest& request, Backend& backend);
BenchReport bench_paper(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own.
BenchReport bench_batch(const BenchRequest& request, Backend& backend);
/// SCENE is a scene file or a folder of them.
BenchReport bench_scenes(const BenchRequest& request, Backend& backend);
/// Throws Error for another scene. Also on the CUDA backend if a device is found.
BenchReport bench_signorini3d(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own.
BenchReport bench_solver(const BenchRequest& request, Backend& backend);
BenchReport bench_sparse(const BenchRequest& request, Backend& backend);
/// Throws Error for a SCENE: it has its own. Also on a CUDA device if there is one.
BenchReport bench_sparse_shifts(const BenchRequest& request, Backend& backend);
/// SCENE is a group of its cases; without one, all.
BenchReport bench_stability(const BenchRequest& request, Backend& backend);
/// SCENE is a scene, a scene file or a folder of them; without one, all built-in scenes and the examples.
BenchReport bench_tol(const BenchRequest& request, Backend& backend);

/// For studies with scenes of their own: throws Error if a scene, parameters or steps are given.
void refuse_scene(const BenchRequest& request);

/// The file itself, or the scene files of a folder by name. Throws Error if there is none.
std::vector<std::filesystem::path> scene_files(const std::string& place);
inline constexpr const char* examples_folder = "examples";

/// Wall-clock seconds of repeated runs.
struct Samples {
  std::vector<double> total, setup, solve;

  void add(double total_seconds, double setup_seconds, double solve_seconds);
};
double median(std::vector<double> values);
double minimum(const std::vector<double>& values);
double maximum(const std::vector<double>& values);
/// {median, min, max}; null without values.
Json spread(const std::vector<double>& values);
/// {median, min, max} of the total and the medians of setup and solve; null without samples.
Json to_json(const Samples& samples);
/// {y: {max, rms}, trace: {max, rms}}
Json to_json(const Errors& errors);

/// First row is the header; the first column is aligned left, the others right.
std::string table(const std::vector<std::vector<std::string>>& rows);

/// Runs a study on the host and, where there is a CUDA device, on the device as well; on one of them where the request
/// names it. Returns the text of all. Throws Error for cuda without a device.
std::string on_each_backend(const BenchRequest&, Backend& host, BenchReport&,
                            const std::function<std::string(Backend&)>& study);

/// Prints the text and the notes of the report.
void print_with_notes(std::string text, const BenchReport&);

/// "1.23e-05", or "-" for a NaN.
std::string scientific(double value);

}  // namespace bromwich::app
