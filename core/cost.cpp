#include "core/cost.hpp"

#include "core/error.hpp"
#include "core/sparse_kernel.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <vector>

namespace bromwich {

namespace {

constexpr double number = sizeof(double);
constexpr double most_operations = 1e16;
constexpr double sweeps = 100;

struct Part {
  double bytes;
  const char* what;
};

Cost sum(const std::vector<Part>& parts, double operations) {
  Cost cost{0, operations, ""};
  double most = -1;
  for (const Part& part : parts) {
    cost.bytes += part.bytes;
    if (part.bytes > most) cost.largest = part.what;
    most = std::max(most, part.bytes);
  }
  return cost;
}

struct Sizes {
  double m, n, J, c, k;
  double table() const { return number * J * (6 * n + k + c); }
};

constexpr const char* tables = "tables over time (J x n and J x states asked for)";
constexpr const char* states = "matrices of the state (m x m)";
constexpr const char* problems = "matrices of the complementarity problem (n x n)";
constexpr const char* weights = "lag weights (J x n x n)";

Cost dense(const Sizes& s, Method method) {
  const double step = s.J * (s.m * s.m + 2 * s.m * s.n + 4 * s.n * s.n);
  const double setup = 60 * s.m * s.m * s.m + 10 * s.n * s.n * s.n;
  const double forcing = s.k > 0 ? number * s.J * s.m : 0;
  if (method == Method::contour_literal)
    return sum({{s.table(), tables}, {26 * 16 * s.J * s.n * s.n, "resolvents of every time point (26 J x n x n)"}},
               26 * s.J * s.m * s.m * s.m + sweeps * 26 * s.J * s.J * s.n);
  const double iterated = method == Method::contour ? sweeps : 1;
  return sum({{s.table() + forcing, tables},
              {number * 14 * s.m * s.m, states},
              {number * 24 * s.n * s.n, problems},
              {method == Method::contour ? number * 130 * s.n * s.n : 0, weights}},
             setup + iterated * step);
}

Cost kronecker(const Sizes& s, Method method) {
  const double lines = s.m / s.n;
  if (method == Method::contour_literal)
    return sum({{s.table(), tables}, {26 * 16 * s.J * s.n, "resolvents of every time point (26 J x n)"}},
               sweeps * 26 * s.J * s.J * s.n);
  if (method == Method::contour)
    return sum({{s.table() + number * 6 * s.J * s.n, tables}}, sweeps * s.J * s.n * (150 + 2 * std::min(s.n, 1000.0)));
  return sum({{s.table(), tables}, {number * 6 * s.n * s.n, problems}, {number * 4 * s.m, "modes of the state"}},
             s.J * (s.n * s.n + 3 * s.n * std::min(lines, 60.0)) + s.n * s.n * s.n);
}

Cost sparse(const Sizes& s, const SparseDynamics& d, Method method, Index J, int threads) {
  const double n = s.n, inputs = n + s.k + 1;
  if (method == Method::euler)
    return sum({{s.table(), tables},
                {40 * std::pow(s.m, 1.2) + 12 * double(d.A.nonZeros()), "the factors of I - hA"},
                {number * (s.m * n + 6 * n * n), "responses of the state to y (m x n)"}},
               s.J * (60 * std::pow(s.m, 1.2) + s.m * n));
  const double solver = predicted_sparse_bytes(d, J, Index(inputs), Index(n + s.c), threads);
  return sum(
      {{s.table(), tables}, {number * 2 * s.J * (n + s.c) * inputs, weights}, {solver, "factors of zI - A"}},
      2e5 * std::pow(s.m, 1.1) + (method == Method::contour ? sweeps : 1) * 40 * s.J * n * n * std::log2(s.J + 2));
}

std::string amount(double value, const char* unit) {
  char text[48];
  std::snprintf(text, sizeof text, "%.3g %s", value, unit);
  return text;
}

std::string excess(const Cost& cost, double limit) {
  if (limit > 0 && cost.bytes > limit)
    return "needs about " + amount(cost.bytes * 1e-9, "GB") + ", most of it for " + cost.largest +
           ", and the limit is " + amount(limit * 1e-9, "GB");
  if (cost.operations > most_operations) return "needs about " + amount(cost.operations, "multiplications");
  return "";
}

}  // namespace

Cost predicted_cost(const Scene& scene, Method method, Index J, Index components, int threads) {
  const Sizes s{double(scene.states()), double(scene.constraints()), double(J) + 1, double(components),
                scene.f ? double(scene.sources()) : 0};
  if (std::holds_alternative<DenseDynamics>(scene.dynamics)) return dense(s, method);
  if (const auto* d = std::get_if<SparseDynamics>(&scene.dynamics)) return sparse(s, *d, method, J, threads);
  return kronecker(s, method);
}

void refuse_what_does_not_fit(const Scene& scene, const Options& options, Index J, Index components, int threads) {
  std::string found;
  const std::array<Method, 3> all{Method::march, Method::contour, Method::euler};
  for (const Method method : all) {
    const Method asked = options.method == Method::automatic ? method : options.method;
    const std::string because = excess(predicted_cost(scene, asked, J, components, threads), options.memory_limit);
    if (because.empty()) return;
    if (found.empty())
      found = std::string("method ") + to_string(asked) + " with " + std::to_string(J) + " steps " + because;
    if (asked == options.method) break;
  }
  throw Error("steps", found,
              components > 0 ? "use fewer steps or fewer states" : "use fewer steps, or another method");
}

}  // namespace bromwich
