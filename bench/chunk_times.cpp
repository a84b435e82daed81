// Times of method shooting beside method march for many steps: march on one core, chunks of time on all cores of the
// host, and on a device where there is one.
//
//     bromwich_chunk_times [--steps 1000000] [--repeats 3] [--threads 16] [--chunks 0] [--whole] [--out FILE.json]
//                          [SCENE ...]
//
// --steps and --chunks may be given several times; chunks are those of the device, 0: chosen.
//
// A time is that of a method on a sampled scene, with all rows of x and y in the memory of the host; "resident" is that
// of the passes alone, with sources and rows where they are. --whole: also that of a call of solve.

#include "bench/chunk_scenes.hpp"
#include "bench/pairs.hpp"
#include "core/build_info.hpp"
#include "core/solve/methods.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <iostream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;
using study::apart;

struct Arguments {
  std::vector<Index> steps;
  int repeats = 3, threads = int(std::thread::hardware_concurrency());
  std::vector<Index> chunks;
  bool whole = false;
  std::string out;
  std::vector<std::string> scenes;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    const auto value = [&]() -> std::string {
      if (i + 1 == argc) throw std::invalid_argument(name + ": no value");
      return argv[++i];
    };
    if (name == "--steps")
      a.steps.push_back(std::stol(value()));
    else if (name == "--repeats")
      a.repeats = std::stoi(value());
    else if (name == "--threads")
      a.threads = std::stoi(value());
    else if (name == "--chunks")
      a.chunks.push_back(std::stol(value()));
    else if (name == "--whole")
      a.whole = true;
    else if (name == "--out")
      a.out = value();
    else if (name.starts_with("--"))
      throw std::invalid_argument(name + ": unknown; see the head of bench/chunk_times.cpp");
    else
      a.scenes.push_back(name);
  }
  if (a.chunks.empty()) a.chunks.push_back(0);
  if (a.steps.empty()) a.steps.push_back(1000000);
  if (a.scenes.empty()) a.scenes = study::chunk_scenes();
  return a;
}

struct Times {
  std::vector<double> seconds, resident;
  Result result;
  ordered_json json() const {
    const auto sorted = [](std::vector<double> all) {
      std::sort(all.begin(), all.end());
      return ordered_json{{"median", all[all.size() / 2]}, {"least", all.front()}, {"most", all.back()}};
    };
    return {{"seconds", sorted(seconds)},         {"resident", sorted(resident)}, {"passes", result.iterations},
            {"status", to_string(result.status)}, {"kernel", result.kernel},      {"reason", result.reason}};
  }
};

Times timed(Methods& methods, Method method, int repeats, Index chunks = 0) {
  InnerOptions options;
  options.method = method, options.confirm = false, options.states = StateSelection::all;
  options.chunks = chunks;
  Times times;
  for (int k = 0; k < repeats; ++k) {
    Result r;
    const auto begin = std::chrono::steady_clock::now();
    methods.run(method, options, r);
    times.seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    times.resident.push_back(r.seconds.lcp);
    times.result = std::move(r);
  }
  return times;
}

double whole_call(const Scene& scene, Method method, Index steps, Backend& backend) {
  Options options;
  options.method = method, options.steps = steps, options.states = StateSelection::all, options.confirm = false;
  const auto begin = std::chrono::steady_clock::now();
  const Result r = solve(scene, backend, options);
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

ordered_json study_scene(const std::string& name, Index steps, Backend& host, Backend* device, const Arguments& a) {
  const Scene scene = study::chunk_scene(name, steps);
  std::vector<Index> all(static_cast<std::size_t>(scene.states()));
  std::iota(all.begin(), all.end(), Index(0));
  ordered_json row{{"scene", name}, {"steps", steps}, {"states", scene.states()}, {"constraints", scene.constraints()}};
  Times march;
  {
    Methods methods(scene, host, steps, all);
    methods.run(Method::march, InnerOptions{}, march.result);
    march = timed(methods, Method::march, steps > 2000000 ? 1 : a.repeats);
    row["march"] = march.json();
    const Times chunks = timed(methods, Method::shooting, a.repeats);
    row["host"] = chunks.json();
    row["host"]["apart"] = {apart(chunks.result.x, march.result.x), apart(chunks.result.y, march.result.y)};
  }
  if (device) {
    Methods methods(scene, *device, steps, all);
    for (const Index number : a.chunks) {
      const Times chunks = timed(methods, Method::shooting, a.repeats + 1, number);
      ordered_json one = chunks.json();
      one["apart"] = {apart(chunks.result.x, march.result.x), apart(chunks.result.y, march.result.y)};
      if (number > 0) row["device with chunks"][std::to_string(number)] = one;
      if (number == a.chunks.front()) row["device"] = one;
    }
  }
  if (a.whole) {
    row["whole"]["march"] = whole_call(scene, Method::march, steps, host);
    row["whole"]["host"] = whole_call(scene, Method::shooting, steps, host);
    if (device) row["whole"]["device"] = whole_call(scene, Method::shooting, steps, *device);
  }
  return row;
}

void print(const ordered_json& row) {
  const double march = row["march"]["resident"]["median"];
  std::cout << row["scene"].get<std::string>() << " " << row["steps"] << ": march "
            << row["march"]["seconds"]["median"].get<double>() * 1e3 << " ms, resident " << march * 1e3 << " ms";
  for (const char* where : {"host", "device"})
    if (row.contains(where)) {
      const auto& r = row[where];
      std::cout << " | " << where << " " << r["seconds"]["median"].get<double>() * 1e3 << " ms, resident "
                << r["resident"]["median"].get<double>() * 1e3 << " ms ("
                << march / r["resident"]["median"].get<double>() << " x), passes " << r["passes"] << ", apart "
                << r["apart"].dump();
    }
  if (row.contains("whole")) std::cout << " | whole " << row["whole"].dump();
  if (row.contains("device with chunks"))
    for (const auto& [number, r] : row["device with chunks"].items())
      std::cout << " | " << number << ": " << r["resident"]["median"].get<double>() * 1e3 << " ms " << r["passes"];
  std::cout << "\n    " << row["host"]["kernel"].get<std::string>() << "\n" << std::flush;
}

int run(const Arguments& a) {
  const auto host = make_cpu_backend(a.threads);
  std::unique_ptr<Backend> device;
  if (!cuda_devices().empty()) device = make_cuda_backend(make_cpu_backend(a.threads));
  ordered_json all{{"commit", std::string(build_info::commit)},
                   {"threads", a.threads},
                   {"device", device ? device->device().name : "none"},
                   {"repeats", a.repeats},
                   {"scenes", ordered_json::array()}};
  for (const Index steps : a.steps)
    for (const std::string& name : a.scenes) {
      all["scenes"].push_back(study_scene(name, steps, *host, device.get(), a));
      print(all["scenes"].back());
      if (!a.out.empty()) std::ofstream(a.out) << all.dump(1) << "\n";
    }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(parse(argc, argv));
  } catch (const std::exception& e) {
    std::cerr << e.what() << "\n";
    return 2;
  }
}
