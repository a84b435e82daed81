// The sine transforms and the complementarity problem between two convolutions, one block per row in shared memory. For
// few rows, separate kernels would spend more time on launches than on work.
//
// Memory traffic: r, y and the modes of v are read once, y and its modes are written once: 40 bytes per value.

#include "kernels/lcp_in_modes.cuh"

#include "kernels/launch.cuh"

namespace bromwich::cuda {

namespace {

template <int T, int K>
struct Shared {
  using Rows = Slot<T, K>;
  using Transform = TransformRow<T * K, K, T <= 32>;
  static constexpr std::size_t bytes =
      sizeof(double2) * Transform::size + sizeof(double) * std::size_t(Rows::size + Group<T>::scratch);
};

template <int T, int K>
__global__ void __launch_bounds__(T)
    sweep_in_modes(LcpArrays arrays, Modes modes, Coefficients<true> M, Problem problem, OutcomeTarget target) {
  using Rows = typename Shared<T, K>::Rows;
  using Transform = typename Shared<T, K>::Transform;
  extern __shared__ double2 memory[];
  let_next_begin();
  const int t = int(threadIdx.x), j = problem.first + int(blockIdx.x), n = problem.n;
  const long at = long(j) * arrays.stride;
  double* const shared = reinterpret_cast<double*>(memory + Transform::size);
  Group<T> group(shared + Rows::size, t);
  Rows rows(shared);
  Outcomes outcomes(target);
  const Transform transform{memory, modes.sine.roots, t};
  double2 twiddles[Transform::passes - 1];
  transform.template take_up<1>(twiddles);
  if (modes.v && t == 0) rows.value(rows.v, n) = 0;  // padding, as in fetched rows
  await_previous();
  rows.fetch(arrays, n, j, t);
  __pipeline_commit();
  if (modes.v)
    transform(
        twiddles, modes.sine.scale, [&](int i) { return modes.v[at + i]; },
        [&](int i, double v) { rows.value(rows.v, i) = v; });
  __pipeline_wait_prior(0);
  group.meet();
  const unsigned valid = t + 1 < T ? (1u << K) - 1 : (1u << (K - 1)) - 1;
  Part<T, K, true> part{group, M, rows, t, valid, problem.shift, problem.reach};
  const Solution solution = part.solve(problem.cap, problem.least);
  group.meet();
  if (solution.is) rows.store_y(arrays, n, j, t);
  if (t == 0) solution.count(outcomes, j);
  outcomes.template finish<true>();
  if (modes.y)  // an unsolved row keeps its y
    transform(
        twiddles, modes.sine.scale, [&](int i) { return solution.is ? rows.value(rows.y, i) : arrays.y[at + i]; },
        [&](int i, double y) { modes.y[at + i] = y; });
}

template <int T, int K>
LcpInModes chosen() {
  constexpr std::size_t bytes = Shared<T, K>::bytes;
  check(cudaFuncSetAttribute(sweep_in_modes<T, K>, cudaFuncAttributeMaxDynamicSharedMemorySize, int(bytes)),
        "reserving shared memory");
  return {sweep_in_modes<T, K>, T, K, bytes};
}

}  // namespace

LcpInModes lcp_in_modes(Index n) {
  switch (n + 1) {
    case 64:
      return chosen<32, 2>();
    case 128:
      return chosen<32, 4>();
    case 256:
      return chosen<64, 4>();
    case 512:
      return chosen<128, 4>();
    case 1024:
      return chosen<256, 4>();
    default:
      return {};
  }
}

}  // namespace bromwich::cuda
