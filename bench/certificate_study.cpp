// Certificates of results at given steps beside their true errors, on the random scenes of bromwich_trust.
//
//     bromwich_certificate_study [first seed] [count] [steps] [method]

#include "core/certificate/certificate.hpp"
#include "core/scene/breakpoints.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/trust.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

namespace {

using namespace bromwich;

}  // namespace

int main(int argc, char** argv) {
  const auto argument = [&](int i, const char* otherwise) { return std::string(argc > i ? argv[i] : otherwise); };
  const auto first = std::uint32_t(std::stoul(argument(1, "41000000"))),
             count = std::uint32_t(std::stoul(argument(2, "300")));
  Options options;
  options.steps = std::stol(argument(3, "100"));
  options.method = method_from_string(argument(4, "auto"));
  options.states = StateSelection::all;
  const auto backend = make_cpu_backend(1);
  double spent = 0;
  for (std::uint32_t seed = first; seed < first + count; ++seed) {
    const oracle::SourceScene s = oracle::source_scene(seed);
    const oracle::EventSolution truth = oracle::locate_events(s.base);
    if (!truth.decided) continue;
    Result r;
    try {
      r = solve(s.scene, *backend, options);
    } catch (const std::exception& e) {
      std::printf("%u error %s\n", seed, e.what());
      continue;
    }
    if (r.status != Status::solved) {
      std::printf("%u %s | %s\n", seed, to_string(r.status), r.reason.c_str());
      continue;
    }
    const auto begin = std::chrono::steady_clock::now();
    const auto c = certify(s.scene, r, find_breakpoints(s.scene), r.x);
    spent += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    const oracle::TrueError e = oracle::true_error(s, truth, r);
    if (!c) {
      std::printf("%u none\n", seed);
      continue;
    }
    const bool mean = e.of_mean;
    const double of_x = c->error_of_x, of_y = mean ? c->error_of_mean : c->error_of_y;
    std::printf("%u %s x %.1e est %.1e  %s %.1e est %.1e  sets %.3f defect %.1e %.1e%s%s%s | %s | %s\n", seed,
                to_string(s.family), e.x, of_x, mean ? "mean" : "y", e.y, of_y, c->share_of_sets, c->mean_defect,
                c->largest_defect, c->until == 1 ? "" : " incomplete", truth.y_unique ? "" : " y-not-unique",
                truth.jumps ? " jumps" : "", s.sources.c_str(), r.warning.c_str());
  }
  std::fprintf(stderr, "certificates: %.3f s\n", spent);
}
