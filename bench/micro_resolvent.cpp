// Shifted solves N (z_p I - A)^{-1} B for the nodes z_p of one contour.
//
// A          n, k    solves          useful operations a node
// Kronecker  Q       nodes x lines   not counted: a closed form, complex exponentials and roots
// dense      4       nodes           8/3 m^3 + 8 m^2 k + 8 n m k: complex LU, both triangles, the product with N
// sparse     10      nodes           8 a complex multiply-add below and on the diagonal of every front, columns of
//                                    inputs (with the test column) and rows of outputs included
//
// Sparse: the second differences of a G x G square, m = G^2; the time includes the symbolic analysis of every call.
// No traffic is counted: inputs and results are small, and factors are internal.

#include "bench/micro.hpp"

#include "catalogue/catalogue.hpp"
#include "core/numerics/contour.hpp"
#include "core/numerics/elimination.hpp"

#include <map>

namespace bromwich::micro {

namespace {

constexpr Index contacts = 10;

ComplexVector nodes() { return window_contour(*contour_parameters(0), 0.01).nodes; }

KroneckerDynamics square(Index Q) {
  return get<KroneckerDynamics>(make_scene("signorini", {{"Q", double(Q)}}).dynamics);
}

void run(benchmark::State& state, const Dynamics& dynamics, double lines, double flops) {
  const ComplexVector z = nodes();
  if (!backend().resolvent(dynamics, z).allFinite()) return state.SkipWithError("the resolvent is not finite");
  for (auto _ : state) benchmark::DoNotOptimize(backend().resolvent(dynamics, z));
  state.counters["solves"] = rate(double(z.size()) * lines);
  count(state, {.flops = double(z.size()) * flops});
}

void kronecker(benchmark::State& state) {
  const Index Q = state.range(0);
  run(state, square(Q), double(Q), 0);
}

void dense(benchmark::State& state) {
  const Index size = state.range(0);
  const double m = double(size), k = ports, n = ports;
  Random random{std::uint64_t(size)};
  const Matrix S = random.matrix(size, size);
  const DenseDynamics d{(S - S.transpose()) / 2 - Matrix::Identity(size, size), random.matrix(size, ports),
                        random.matrix(ports, size)};
  run(state, d, 1, 8.0 / 3 * m * m * m + 8 * m * m * k + 8 * n * m * k);
}

SparseDynamics plate(Index G) {
  SparseDynamics d{to_sparse(square(G)).A, SparseMatrix(G * G, contacts), SparseMatrix(contacts, G * G)};
  for (Index i = 0; i < contacts; ++i) {
    const Index point = (G / 2) * G + (i + 1) * G / (contacts + 1);
    d.B.insert(point, i) = 1;
    d.N.insert(i, point) = 1;
  }
  d.B.makeCompressed();
  d.N.makeCompressed();
  return d;
}

// Complex multiply-adds of one elimination that uses the symmetry of A.
double products(const Elimination& elimination) {
  double sum = 0;
  for (const Front& front : elimination.fronts)
    for (Index p = 1; p <= front.pivots; ++p) {
      const double rest = double(front.pivots - p) + double(front.rest.size());
      const double outputs = double(front.outputs.size()), inputs = double(front.inputs.size());
      sum += rest * (rest + 1) / 2 + rest * (outputs + inputs) + outputs * inputs;
    }
  return sum;
}

void sparse(benchmark::State& state) {
  struct Case {
    SparseDynamics dynamics;
    double products;
  };
  static std::map<Index, Case> made;  // repetitions share them
  const Index G = state.range(0);
  if (!made.contains(G)) {
    const SparseDynamics d = plate(G);
    made[G] = {d, products(analyse(d.A, d.B, d.N, 1))};
  }
  const Case& c = made[G];
  run(state, c.dynamics, 1, 8 * c.products);
  state.counters["states"] = double(G * G);
}

}  // namespace

void register_resolvents() {
  benchmark::RegisterBenchmark("resolvent_kronecker", kronecker)->Arg(39)->Arg(511)->ArgName("Q")->UseRealTime();
  benchmark::RegisterBenchmark("resolvent_dense", dense)->Arg(8)->Arg(32)->Arg(64)->ArgName("m")->UseRealTime();
  benchmark::RegisterBenchmark("resolvent_sparse", sparse)->Arg(24)->Arg(96)->Arg(200)->ArgName("G")->UseRealTime();
}

}  // namespace bromwich::micro
