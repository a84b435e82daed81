// Shifted solves of sparse dynamics at 48 nodes, N (z I - A)^{-1} B for second differences on a square of G x G points
// with contact along one side, or at ten points of it: by the host's elimination on one core and on all, and by a
// device with cuDSS.
//
//     BROMWICH_CUDSS=auto bromwich_sparse_shifts [--threads 16] [--repeats 5] [--out FILE.json]
//
// Device: the first call of a pattern, which orders it, and later calls. cuDSS is loaded and started before.

#include "app/machine.hpp"
#include "core/build_info.hpp"
#include "core/numerics/contour.hpp"
#include "core/seam/backend.hpp"
#include "cpu/cpu_backend.hpp"
#include "kernels/cuda_backend.hpp"
#include "kernels/cudss.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iostream>
#include <string>
#include <thread>
#include <vector>

namespace {

using namespace bromwich;
using nlohmann::ordered_json;

struct Arguments {
  int threads = int(std::thread::hardware_concurrency()), repeats = 5;
  std::string out;
};

Arguments parse(int argc, char** argv) {
  Arguments a;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i], value = argv[i + 1];
    if (name == "--threads")
      a.threads = std::stoi(value);
    else if (name == "--repeats")
      a.repeats = std::stoi(value);
    else if (name == "--out")
      a.out = value;
    else
      throw std::invalid_argument(name + ": unknown; see the head of bench/sparse_shifts.cpp");
  }
  return a;
}

SparseDynamics square(Index G, Index contacts) {
  const double c = double(G + 1) * double(G + 1);
  std::vector<Eigen::Triplet<double>> entries;
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < G; ++j) {
      const Index r = i * G + j;
      entries.emplace_back(r, r, -4 * c);
      for (const auto& [inside, other] :
           {std::pair{i > 0, r - G}, {i + 1 < G, r + G}, {j > 0, r - 1}, {j + 1 < G, r + 1}})
        if (inside) entries.emplace_back(r, other, c);
    }
  SparseDynamics d{SparseMatrix(G * G, G * G), SparseMatrix(G * G, contacts), SparseMatrix(contacts, G * G)};
  d.A.setFromTriplets(entries.begin(), entries.end());
  for (Index i = 0; i < contacts; ++i) {
    const Index point = contacts == G ? i : (i + 1) * G / (contacts + 1);
    d.B.insert(point, i) = c;
    d.N.insert(i, point) = 1;
  }
  d.B.makeCompressed();
  d.N.makeCompressed();
  return d;
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

ordered_json spread(std::vector<double> all) {
  std::sort(all.begin(), all.end());
  return {{"median", all[all.size() / 2]}, {"min", all.front()}, {"max", all.back()}};
}

ordered_json measured(Index G, Index contacts, Backend& one, Backend& host, Backend* device, int repeats) {
  const Dynamics dynamics = square(G, contacts);
  const ComplexVector z = nodes();
  ComplexMatrix expected, found;
  ordered_json row{{"states", G * G}, {"contacts", contacts}, {"nodes", z.size()}};
  row["one core"] = seconds_of(one, dynamics, z, found);
  std::vector<double> times, first, again;
  for (int k = 0; k < repeats; ++k) times.push_back(seconds_of(host, dynamics, z, expected));
  row["host"] = spread(times);
  if (!device) return row;
  row["device first"] = seconds_of(*device, dynamics, z, found);
  for (int k = 0; k < repeats; ++k) again.push_back(seconds_of(*device, dynamics, z, found));
  row["device again"] = spread(again);
  row["apart"] = (found - expected).cwiseAbs().maxCoeff() / expected.cwiseAbs().maxCoeff();
  return row;
}

int run(const Arguments& a) {
  const auto one = make_cpu_backend(1), host = make_cpu_backend(a.threads);
  std::unique_ptr<Backend> device;
  if (!cuda_devices().empty()) device = make_cuda_backend(make_cpu_backend(a.threads));
  ordered_json all{{"commit", std::string(build_info::commit)},
                   {"machine", {{"cpu", app::cpu_model()}, {"cores", app::cpu_cores()}}},
                   {"threads", a.threads},
                   {"device", device ? device->device().name : "none"},
                   {"cudss", device && cuda::cudss().functions},
                   {"repeats", a.repeats},
                   {"rows", ordered_json::array()}};
  ComplexMatrix R;
  if (device) all["seconds of the first call of all"] = seconds_of(*device, square(80, 2), nodes(), R);
  for (const auto& [G, contacts] : {std::pair<Index, Index>{100, 100}, {200, 200}, {316, 10}, {316, 316}, {500, 500}}) {
    all["rows"].push_back(measured(G, contacts, *one, *host, device.get(), a.repeats));
    std::cout << all["rows"].back().dump() << "\n" << std::flush;
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
