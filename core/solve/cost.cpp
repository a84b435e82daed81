#include "core/solve/cost.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/dual/local_march.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "core/kernel/states.hpp"
#include "core/kernel/time_operator.hpp"
#include "core/seam/point_responses.hpp"

#include <array>
#include <cmath>
#include <vector>

namespace bromwich {

namespace {

constexpr double number = sizeof(double);
constexpr double most_operations = 1e16;  ///< a month at 4e9 multiplications a second
constexpr double iteration_sweeps = 100;  ///< of an iteration, as Cost::operations says
constexpr double sweeps_in_cycles = 60;   ///< eight cycles, coarser grids included
/// Entries of L and U over m^1.2: 9.1 to 10.7 for five-point stencils on squares of 32^2 to 256^2 points, COLAMD.
constexpr double factor_entries = 10.5;
constexpr double nodes_of_step = 25;                             ///< at most, of SteppedStates
constexpr double bytes_of_entry = sizeof(double) + sizeof(int);  ///< of a real sparse factor

bool cycles(Method method) { return method == Method::multigrid || method == Method::dual; }
bool convolves(Method method) { return method == Method::contour || cycles(method); }

double sweeps_of(Method method) {
  return method == Method::contour ? iteration_sweeps : cycles(method) ? sweeps_in_cycles : 1;
}

struct MemoryPart {
  double bytes;
  const char* what;
};

Cost sum(const std::vector<MemoryPart>& parts, double operations) {
  Cost cost{0, operations, ""};
  double most = -1;
  for (const MemoryPart& part : parts) {
    cost.bytes += part.bytes;
    if (part.bytes > most) cost.largest = part.what;
    most = std::max(most, part.bytes);
  }
  return cost;
}

struct Sizes {
  double m, n, J, c, k;  ///< J: time points
  int threads = 1;
  double edges = 0;   ///< with contact on a face: the sum of its extents; else 0
  double nodes = 26;  ///< of contour-literal, P + 1; circles around eigenvalues are not counted
  double table() const { return number * J * (6 * n + k + c); }
};

// Memory of the grids of a multigrid method, beyond y, v and r of one grid.
MemoryPart grids(const Sizes& s, Method method, double arrays) {
  return {cycles(method) ? number * arrays * s.J * s.n : 0, "arrays of all time grids"};
}

constexpr const char* tables = "tables over time (J x n and J x recorded states)";
constexpr const char* states = "matrices of the state (m x m)";
constexpr const char* problems = "matrices of the complementarity problem (n x n)";
constexpr double typical_poles = 55, nodes_of_poles = 56;  ///< of a fit to 1e-9 at J = 1000
constexpr const char* residues = "values at the nodes and residues of the poles";
constexpr const char* weights = "lag weights (J x n x n)";

// The convolution of a dense scene steps the state where that costs less than transforms of length 2J.
bool scanned(const Sizes& s) { return scan_is_cheaper(s.m, s.n, s.J); }

// Of contour-literal: R and four numbers of each node, and one group of nodes as the shifted solves return it.
MemoryPart resolvents(const Sizes& s, double values) {
  const double bytes = s.nodes * s.J * sizeof(Complex) * values;
  return {bytes + s.nodes * s.J * sizeof(PointFactor) + std::min(bytes, 2.7e8),
          values > s.n ? "resolvents of every time point (nodes x J x n x n)"
                       : "resolvents of every time point (nodes x J x n)"};
}

Cost with_small_state(const Sizes& s, Method method) {
  // A step: e^{hA} x, B and N, and four products of an active set with M + W_0.
  const double step = s.J * (s.m * s.m + 2 * s.m * s.n + 4 * s.n * s.n);
  // e^{hA} by twenty products, all eigenvalues by 25 m^3, and a second way to the first weights; classes of M + W_0 by
  // a few factorizations.
  const double setup = 60 * s.m * s.m * s.m + 10 * s.n * s.n * s.n;
  const double forcing = s.k > 0 ? number * s.J * s.m : 0;
  if (method == Method::contour_literal)
    return sum({{s.table(), tables}, resolvents(s, s.n * s.n)},
               s.nodes * s.J * (s.m * s.m * s.m + iteration_sweeps * s.J * s.n));
  // W_d and S_d from both ways to them, 64 lags to check a scan with or all; then one of the two beside its spectrum.
  const double all = cycles(method) ? 7 : 5;
  const double table = !convolves(method) ? 0 : scanned(s) ? 4 * std::min(s.J, 65.) : all * s.J;
  return sum({{s.table() + forcing, tables},
              grids(s, method, 6),
              {number * 20 * s.m * s.m, states},
              {number * 24 * s.n * s.n, problems},
              {number * table * s.n * s.n, weights}},
             setup + sweeps_of(method) * step);
}

// Dense dynamics, or others written out. Boundary values: the steps of every interval and the QR factors between them.
Cost galerkin(const Sizes& s, bool two_point) {
  const double between = two_point ? 2 * s.m * s.m + 2 * s.m : 0, exchanges = two_point ? 10 : 1;
  return sum({{s.table() + number * s.J * (14 * s.n + 4 * s.m), tables},
              {number * s.J * between, "steps of the two-point problem (J x m x m)"},
              {number * (30 * s.m * s.m + 96 * s.n * s.n), states}},
             60 * s.m * s.m * s.m + exchanges * s.J * (2 * s.n + s.m) * (2 * s.n + (two_point ? 10 * s.m : 1) * s.m));
}

// Where sweeps on the coarsest grid do not suffice, it is marched.
MemoryPart coarsest_march(const Sizes& s, Method method) {
  return {cycles(method) && s.edges == 0 ? number * 6 * s.n * s.n : 0, problems};
}

Cost in_modes(const Sizes& s, Method method) {
  const double lines = s.m / s.n;
  if (method == Method::contour_literal)
    return sum({{s.table(), tables}, resolvents(s, s.n)}, iteration_sweeps * s.nodes * s.J * s.J * s.n);
  // A sweep in modes: 64 exponentials at most and their sums (150), two sine transforms as products of up to 1000 rows.
  if (convolves(method))
    return sum({{s.table() + number * 6 * s.J * s.n, tables}, grids(s, method, 9), coarsest_march(s, method)},
               sweeps_of(method) * s.J * s.n * (150 + 2 * (s.edges > 0 ? 2 * s.edges : std::min(s.n, 1000.0))));
  // On a face a step takes some ten products with W_0, as transforms, and no matrices.
  if (s.edges > 0)
    return sum({{s.table() + number * 3 * s.J * s.n, tables},
                {number * 12 * 60 * s.n, problems},
                {number * 4 * s.m, "modes of the state"}},
               s.J * s.n * (40 * s.edges + 3 * std::min(lines, 60.0)));
  // A step: one product with M + W_0, and three numbers for each exponential of a mode, 60 where they are fitted.
  return sum({{s.table() + number * 3 * s.J * s.n, tables},
              {number * 10 * s.n * s.n, problems},
              {number * 4 * s.m, "modes of the state"}},
             s.J * (s.n * s.n + 3 * s.n * std::min(lines, 60.0)) + s.n * s.n * s.n);
}

bool tabulates_poles(const Sizes& s) { return s.J * s.n * s.n >= fewest_tabulated; }

// A table of values at all nodes and one to fit from, then the residues; a sweep is two products with a state of
// typical_poles n numbers at most.
Cost by_poles(const Sizes& s, Method method, MemoryPart solver, double setup) {
  const double n = s.n, rows = typical_poles * (n + s.k + 1);
  return sum({{s.table(), tables},
              grids(s, method, 6),
              {number * ((n + s.c) * (4 * nodes_of_poles * (n + s.k + 1) + 2 * rows) + 10 * n * n), residues},
              solver},
             setup + sweeps_of(method) * s.J * n * (rows + n));
}

Cost with_matrices(const SparseDynamics& d, const Sizes& s, Method method) {
  const double n = s.n, inputs = n + s.k + 1;
  if (method == Method::euler)
    return sum(
        {{s.table(), tables},
         {bytes_of_entry * (factor_entries * std::pow(s.m, 1.2) + double(d.A.nonZeros())), "the factors of I - hA"},
         {number * (s.m * n + 6 * n * n), "responses of the state to y (m x n)"}},
        s.J * (factor_entries * std::pow(s.m, 1.2) + s.m * n));
  if (s.c > double(RecordedStates::most_in_kernel)) {
    Sizes without = s;
    without.c = 0;
    Cost cost = with_matrices(d, without, method);
    // One elimination takes eight nodes together, the factors of a step's contour are kept.
    const double factors = nodes_of_step / 8 * predicted_elimination_bytes(d, d.B.cols(), 1);
    cost.bytes += number * s.J * s.c + factors;
    cost.operations += s.J * nodes_of_step * 4 * factor_entries * std::pow(s.m, 1.2);
    return cost;
  }
  if (tabulates_poles(s))
    return by_poles(s, method, {predicted_elimination_bytes(d, Index(inputs), s.threads), "factors of zI - A"},
                    2e4 * std::pow(s.m, 1.1));
  // 2e5 m^1.1: 620 nodes (J = 400) times the products of one elimination, 3e5 (m = 1e3) to 3e8 (m = 6e4) on squares,
  // to a factor of 4.
  const double solver = predicted_sparse_bytes(d, Index(s.J) - 1, Index(inputs), Index(n + s.c), s.threads);
  return sum({{s.table(), tables},
              grids(s, method, 6 + 4 * n),  // with the weights of all of them
              {number * 2 * s.J * (n + s.c) * inputs, weights},
              {solver, "factors of zI - A"}},
             2e5 * std::pow(s.m, 1.1) + sweeps_of(method) * 40 * s.J * n * n * std::log2(s.J + 2));
}

// What the solver of a user takes is not known.
Cost by_solves(const Sizes& s, Method method) {
  const double n = s.n, inputs = n + s.k + 1;
  if (tabulates_poles(s) && method != Method::euler)
    return by_poles(s, method, {2 * number * s.m * inputs, "shifted solves"}, 0);
  return sum({{s.table(), tables},
              grids(s, method, 6 + 4 * n),
              {number * 2 * s.J * (n + s.c) * inputs, weights},
              {2 * number * s.m * inputs, "shifted solves"}},
             sweeps_of(method) * 40 * s.J * n * n * std::log2(s.J + 2));
}

// Steps in w with a local V: sparse factors of both stages, y, its integral, the trace, and g and f at the stages.
Cost in_w(const Sizes& s) {
  constexpr double entries_of_factors = 60;  // times m^1.2, for both stages and two factorizations
  return sum({{number * s.J * (6 * s.n + 2 * s.k + s.c), tables},
              {number * 2 * entries_of_factors * std::pow(s.m, 1.2), "the factors of a step"}},
             s.J * 4 * entries_of_factors * std::pow(s.m, 1.3));
}

Cost cost_of(const LinearSystem& system, const Sizes& s, Method method) {
  if (system.small_state()) return with_small_state(s, method);
  if (system.modes()) return in_modes(s, method);
  return system.matrices() ? with_matrices(*system.matrices(), s, method) : by_solves(s, method);
}

Sizes sizes(const Scene& scene, Index J, Index components, int threads = 1) {
  double edges = 0;
  if (const KroneckerDynamics* modes = scene.dynamics->modes(); modes && !modes->beside.empty())
    for (const SecondDifference& direction : modes->face()) edges += double(direction.points);
  return {double(scene.states()),
          double(scene.constraints()),
          double(J) + 1,
          double(components),
          scene.f ? double(scene.sources()) : 0,
          threads,
          edges};
}

// ---- on a device: bytes of the plans of kernels/, as their constructors allocate them ----

// Rows begin at cache lines (kernels/device.hpp).
double padded(double n) { return n < 16 ? n : 8 * std::ceil(n / 8); }

// An FFT over lag weights: their spectrum, the column of y_0, and spectra with workspaces of all columns.
MemoryPart lag_weights(const Sizes& s) { return {number * s.J * (3 * s.n * s.n + 10 * s.n), weights}; }

void add_state_plans(const Sizes& s, Method method, std::vector<MemoryPart>& parts) {
  parts.push_back({number * (4 * s.m * s.m + 3 * s.m * s.n), states});
  parts.push_back({number * 6 * s.n * s.n, problems});
  if (method == Method::contour_literal) parts.push_back(resolvents(s, s.n * s.n));
  if (s.k > 0 && !iterates(method)) parts.push_back({number * s.J * s.m, "the source at all times (J x m)"});
  if (!convolves(method)) return;
  // 16 bytes m^2 for each of 26 nodes of a window, in groups of at most 1 GiB (kernels/resolvent.cu).
  parts.push_back({std::min(1.1e9, 420 * s.m * s.m), "shifted solves of the nodes"});
  parts.push_back(scanned(s) ? MemoryPart{number * 2 * s.m * std::sqrt(s.J), "states at the starts of chunks of time"}
                             : lag_weights(s));
}

void add_modal_plans(const Sizes& s, Method method, std::vector<MemoryPart>& parts) {
  if (!iterates(method)) {
    parts.push_back({number * (s.edges > 0 ? 12 * 60 * s.n : 6 * s.n * s.n), problems});
    parts.push_back({number * 4 * s.m, "modes of the state"});
    return;
  }
  if (method == Method::contour_literal) {
    parts.push_back(resolvents(s, s.n));
    return;
  }
  parts.push_back(coarsest_march(s, method));
  // At most 64 exponentials. Chunks of at least 32 time points, at most 64, and as many as give some 34 000 threads a
  // mode each. Up to 512 time points have weights instead, on each of their grids.
  const double modes = 32 * std::ceil(s.n / 32), chunks = std::min({s.J * modes / 32, 64 * modes, 34e3 + modes});
  parts.push_back({number * 2 * 64 * chunks, "states at the starts of chunks of time"});
  parts.push_back({number * 4 * std::min(s.J, 513.) * modes, weights});
  parts.push_back({number * (s.edges > 0   ? s.edges * s.edges
                             : s.n <= 1536 ? s.n * s.n
                                           : 2048 * s.n),
                   "the sine transform"});
}

void add_plans(const LinearSystem& system, const Sizes& s, Method method, std::vector<MemoryPart>& parts) {
  if (system.small_state()) return add_state_plans(s, method, parts);
  if (system.modes()) return add_modal_plans(s, method, parts);
  parts.push_back(convolves(method) ? lag_weights(s) : MemoryPart{number * s.J * s.c, tables});
}

std::string amount(double value, const char* unit) { return text("%.3g %s", value, unit); }

std::string excess(const Cost& cost, double limit) {
  if (limit > 0 && cost.bytes > limit)
    return "needs about " + amount(cost.bytes * 1e-9, "GB") + ", most of it for " + cost.largest +
           ", and the limit is " + amount(limit * 1e-9, "GB");
  if (cost.operations > most_operations) return "needs about " + amount(cost.operations, "multiplications");
  return "";
}

Cost device_cost(const Scene& scene, const Sizes& s, Method method) {
  // Iterating: y, v, r, two in modes, the first q, one to work in. Cycles: y, v, r, y~ and two in modes on all grids,
  // y_h on the two below the finest, one to work in. Marching: y, v, r, the source, and as much in the plan.
  const double arrays = cycles(method) ? (s.edges > 0 ? 15 : 14) : iterates(method) ? 7 : 8;
  std::vector<MemoryPart> parts{{number * s.J * padded(s.n) * arrays + 32 * s.J, tables}};
  add_plans(*scene.dynamics, s, method, parts);
  return sum(parts, 0);
}

std::string device_excess(const Cost& cost, const DeviceInfo& device) {
  return "needs about " + amount(cost.bytes * 1e-9, "GB") + " on the device, most of it for " + cost.largest +
         ", and " + device.name + " has " + amount(device.memory * 1e-9, "GB") + " free";
}

}  // namespace

Cost predicted_cost(const Scene& scene, Method method, Index J, Index components, int threads) {
  const Sizes s = sizes(scene, J, components, threads);
  if (method == Method::galerkin) return galerkin(s, scene.boundary.has_value());
  if (method == Method::dual && has_local_inverse(scene)) return in_w(s);
  return cost_of(*scene.dynamics, s, method);
}

Cost predicted_device_cost(const Scene& scene, Method method, Index J, Index components) {
  return device_cost(scene, sizes(scene, J, components), method);
}

bool fits_on_device(const Scene& scene, Method method, Index J, Index components, const DeviceInfo& device) {
  return device.memory <= 0 || predicted_device_cost(scene, method, J, components).bytes <= device.memory;
}

Cost refuse_what_does_not_fit(const Scene& scene, const Options& options, Index J, Index components,
                              const DeviceInfo& device) {
  std::string found, remedy;
  const std::array<Method, 3> all{Method::march, Method::contour, Method::euler};
  for (const Method method : all) {
    const Method chosen = options.method == Method::automatic ? method : options.method;
    Sizes s = sizes(scene, J, components, device.threads);
    s.nodes = double(options.tuning.literal_nodes) + 1;
    const Cost cost = chosen == Method::contour_literal ? cost_of(*scene.dynamics, s, chosen)
                                                        : predicted_cost(scene, chosen, J, components, device.threads);
    std::string because = excess(cost, options.memory_limit);
    const bool on_machine = because.empty();
    if (const Cost there = device_cost(scene, s, chosen);
        on_machine && device.memory > 0 && there.bytes > device.memory)
      because = device_excess(there, device);
    if (because.empty()) return cost;
    if (found.empty()) {
      found = std::string("method ") + to_string(chosen) + " with " + std::to_string(J) + " steps " + because;
      remedy = on_machine ? ", or the cpu backend" : components > 0 ? " or fewer states" : ", or another method";
    }
    if (chosen == options.method) break;
  }
  throw Error("steps", found, "use fewer steps" + remedy, ErrorKind::does_not_fit);
}

}  // namespace bromwich
