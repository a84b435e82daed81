// The results of one build, stored, so that those of a later one can be compared with them case by case.
//
//     bromwich_frozen store FILE [--examples FOLDER] [--random 10000] [--sources 1134] [--hard yes|no] [--jobs 1]
//                               [--seconds 20]
//     bromwich_frozen compare FILE FILE [--rounding 1e-10]
//
// `store` solves the cases of bench/frozen/cases.hpp and writes status, method, notices, estimate, seconds of the
// processor, and at most 33 rows of t, y and x of each, as CBOR. A case of more than --seconds ends as `interrupted`.
// `compare` prints what differs. Its exit code is 1 if a status, a grid or a value does.

#include "bench/frozen/cases.hpp"
#include "bench/frozen/compare.hpp"
#include "core/build_info.hpp"
#include "cpu/cpu_backend.hpp"

#include <time.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

using namespace bromwich;
using nlohmann::json;

struct Arguments {
  std::vector<std::string> files;
  frozen::Selection selection;
  int jobs = 1;
  double seconds = 20, rounding = 1e-10;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 2; i < argc; ++i) {
    const std::string name = argv[i];
    if (name.rfind("--", 0) != 0) {
      a.files.push_back(name);
      continue;
    }
    if (++i == argc) throw std::invalid_argument(name + ": no value");
    const std::string value = argv[i];
    if (name == "--examples")
      a.selection.examples = value;
    else if (name == "--random")
      a.selection.random = std::uint32_t(std::stoul(value));
    else if (name == "--sources")
      a.selection.sources = std::uint32_t(std::stoul(value));
    else if (name == "--hard")
      a.selection.hard = value == "yes";
    else if (name == "--jobs")
      a.jobs = std::max(1, std::stoi(value));
    else if (name == "--seconds")
      a.seconds = std::stod(value);
    else if (name == "--rounding")
      a.rounding = std::stod(value);
    else
      throw std::invalid_argument(name + ": unknown; see the head of bench/frozen/frozen.cpp");
  }
  return a;
}

double processor_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

/// Rows 0, J/32, 2 J/32, ..., J, without repetition.
std::vector<Index> stored_rows(Index rows) {
  std::vector<Index> chosen;
  for (Index k = 0; k <= 32 && rows > 0; ++k) {
    const Index j = k * (rows - 1) / 32;
    if (chosen.empty() || chosen.back() != j) chosen.push_back(j);
  }
  return chosen;
}

json rows_of(const RowMatrix& values) {
  json rows = json::array();
  for (const Index j : stored_rows(values.rows()))
    rows.push_back(std::vector<double>(values.row(j).begin(), values.row(j).end()));
  return rows;
}

json record(const frozen::Case& one, Backend& backend, double seconds) {
  const double start = processor_seconds();
  try {
    const Result r = one.solve(backend, [=] { return processor_seconds() - start > seconds; });
    return {{"status", to_string(r.status)},
            {"reason", r.reason},
            {"warning", r.warning},
            {"method", to_string(r.method)},
            {"steps", r.steps},
            {"estimate", r.error_estimate ? json(*r.error_estimate) : json()},
            {"y", rows_of(r.y)},
            {"x", rows_of(r.x)},
            {"seconds", processor_seconds() - start}};
  } catch (const std::exception& error) {
    return {
        {"status", "error"}, {"reason", error.what()}, {"warning", ""},      {"method", ""},
        {"steps", 0},        {"y", json::array()},     {"x", json::array()}, {"seconds", processor_seconds() - start}};
  }
}

void store(const Arguments& a) {
  const std::vector<frozen::Case> all = frozen::cases(a.selection);
  std::vector<json> records(all.size());
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    const auto backend = make_cpu_backend(1);
    for (std::size_t i; (i = next++) < all.size();) records[i] = record(all[i], *backend, a.seconds);
  };
  std::vector<std::thread> threads;
  for (int k = 1; k < a.jobs; ++k) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();

  json file{{"commit", build_info::commit}, {"compiler", build_info::compiler}, {"jobs", a.jobs}};
  for (std::size_t i = 0; i < all.size(); ++i) file["cases"][all[i].name] = std::move(records[i]);
  std::ofstream out(a.files.at(0), std::ios::binary);
  json::to_cbor(file, out);
  if (!out.flush()) throw std::runtime_error("could not write " + a.files.at(0));
  std::printf("%zu cases\n", all.size());
}

json read(const std::string& name) {
  std::ifstream in(name, std::ios::binary);
  if (!in) throw std::runtime_error("could not read " + name);
  return json::from_cbor(in);
}

}  // namespace

int main(int argc, char** argv) try {
  const Arguments a = parse(argc, argv);
  const std::string command = argc > 1 ? argv[1] : "";
  if (command == "store" && a.files.size() == 1) {
    store(a);
    return 0;
  }
  if (command == "compare" && a.files.size() == 2)
    return frozen::compare(read(a.files[0]), read(a.files[1]), a.rounding) ? 0 : 1;
  throw std::invalid_argument("use 'store FILE' or 'compare FILE FILE'; see the head of bench/frozen/frozen.cpp");
} catch (const std::exception& error) {
  std::fprintf(stderr, "bromwich_frozen: %s\n", error.what());
  return 2;
}
