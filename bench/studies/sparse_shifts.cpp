// Shifted solves of sparse dynamics at 48 nodes, N (z I - A)^{-1} B for second differences on a square of G x G points
// with contact along one side, or at ten points of it: by the host's elimination on one core and on all, and by a
// device with cuDSS (BROMWICH_CUDSS), at its first call of a pattern, which orders it, and at later calls.

#include "app/text.hpp"
#include "bench/studies/heat_on_a_square.hpp"
#include "bench/studies/study.hpp"
#include "core/numerics/contour.hpp"
#include "core/seam/backend.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "kernels/cudss.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <vector>

namespace bromwich::app {

namespace {

SparseDynamics square(Index G, Index contacts) {
  std::vector<Index> points;
  for (Index i = 0; i < contacts; ++i) points.push_back(contacts == G ? i : (i + 1) * G / (contacts + 1));
  return heat_on_a_square(G, points);
}

// Of two windows of a contour.
ComplexVector nodes() {
  constexpr Index count = 48;
  const ContourParameters parameters = *contour_parameters(0);
  const ComplexVector first = window_contour(parameters, 0.01).nodes, second = window_contour(parameters, 0.05).nodes;
  ComplexVector all(first.size() + second.size());
  all << first, second;
  return all.head(std::min(count, all.size()));
}

double seconds_of(Backend& backend, const Dynamics& dynamics, const ComplexVector& z, ComplexMatrix& R) {
  const auto begin = std::chrono::steady_clock::now();
  R = backend.resolvent(dynamics, z);
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

std::vector<double> repeated(Backend& backend, const Dynamics& dynamics, const ComplexVector& z, int repeats,
                             ComplexMatrix& R) {
  std::vector<double> times;
  for (int k = 0; k < repeats; ++k) times.push_back(seconds_of(backend, dynamics, z, R));
  return times;
}

Json measured(Index G, Index contacts, Backend& alone, Backend& host, Backend* device, int repeats) {
  const Dynamics dynamics = square(G, contacts);
  const ComplexVector z = nodes();
  ComplexMatrix expected, found;  // by the host, and by what is measured beside it
  Json row{{"states", G * G}, {"contacts", contacts}, {"nodes", z.size()}};
  row["one core"] = seconds_of(alone, dynamics, z, found);
  row["host"] = spread(repeated(host, dynamics, z, repeats, expected));
  const auto apart = [&] { return (found - expected).cwiseAbs().maxCoeff() / expected.cwiseAbs().maxCoeff(); };
  row["apart"] = apart();
  if (!device) return row;
  row["device first"] = seconds_of(*device, dynamics, z, found);
  row["device again"] = spread(repeated(*device, dynamics, z, repeats, found));
  row["device apart"] = apart();
  return row;
}

std::vector<std::string> line(const Json& row) {
  const auto seconds = [&](const char* key) {
    if (!row.contains(key)) return std::string("-");
    return format_seconds(row[key].is_number() ? row[key].get<double>() : row[key]["median"].get<double>());
  };
  return {fmt::format("{}", row["states"].get<Index>()),
          fmt::format("{}", row["contacts"].get<Index>()),
          seconds("one core"),
          seconds("host"),
          seconds("device first"),
          seconds("device again")};
}

}  // namespace

BenchReport bench_sparse_shifts(const BenchRequest& request, Backend& backend) {
  refuse_scene(request);
  const auto alone = make_cpu_backend(1);
  BenchReport report;
  report.details["apart"] = "largest difference from the host's, beside the largest entry";
  std::unique_ptr<Backend> device;
  if (!cuda_devices().empty()) {
    device = make_cuda_backend(make_cpu_backend(backend.threads()));
    report.parameters["device"] = device->device().name;
    report.parameters["cudss"] = bool(cuda::cudss().functions);
    ComplexMatrix R;  // loads and starts what the device needs
    report.details["seconds of the device's first call of all"] = seconds_of(*device, square(80, 2), nodes(), R);
  }
  std::vector<std::pair<Index, Index>> sizes{{100, 100}, {200, 200}, {316, 10}, {316, 316}, {500, 500}};
  if (request.quick) sizes = {{20, 20}};
  std::vector<std::vector<std::string>> lines{
      {"states", "contacts", "one core", "all cores", "device first", "device again"}};
  for (const auto& [G, contacts] : sizes) {
    report.rows.push_back(measured(G, contacts, *alone, backend, device.get(), request.repeats()));
    lines.push_back(line(report.rows.back()));
  }
  print_with_notes(table(lines), report);
  return report;
}

}  // namespace bromwich::app
