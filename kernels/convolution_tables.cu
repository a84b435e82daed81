// The tables of a scan (convolution_scan.cuh), formed on the device from those of a recurrence. Where groups of modes
// keep some of the rates, they are brought into shells (core/kernel/shells.hpp) on the way.

#include "kernels/convolution_scan.cuh"

#include <algorithm>
#include <optional>
#include <vector>

namespace bromwich::cuda::scan {

namespace {

constexpr int formers = 8;  ///< warps of a block

/// The tables of the host: `count` rows of `step` values.
struct Given {
  int count, modes;
  long step;
  const double *decay = nullptr, *output = nullptr, *start = nullptr, *initial = nullptr, *w0 = nullptr, *w1 = nullptr,
               *s1 = nullptr;
};

/// The rates that groups of `lanes` modes keep (core/kernel/shells.hpp). Null: all.
struct Kept {
  const int *fit = nullptr, *count = nullptr, *order = nullptr;  ///< of a group; of a fit; `Given::count` for each fit
  const double* factors = nullptr;                               ///< as `order`
};

// One block for `lanes` modes.
__global__ void __launch_bounds__(lanes* formers)
    form(Given r, Kept rates, int K, int length, int stride, double* tables) {
  __shared__ double changes[2][formers][lanes];
  const int l = int(blockIdx.x) * lanes + int(threadIdx.x), part = int(threadIdx.y);
  const int fit = rates.fit ? rates.fit[blockIdx.x] : 0, kept = rates.fit ? rates.count[fit] : r.count;
  const bool given = l < r.modes;
  const auto put = [&](int table, int k, double value) { tables[long(table * K + k) * stride + l] = value; };
  double lag1 = 0, of_start = 0;  // what the exponentials no longer have of lag 1
  for (int k = part; k < K; k += formers) {
    const int from = k >= kept ? -1 : rates.fit ? rates.order[fit * r.count + k] : k;
    const long at = long(from) * r.step + l;
    const bool has = given && from >= 0;
    const double E = has ? r.decay[at] : 0, G0 = has ? r.start[at] : 0,
                 C = has ? r.output[at] * (rates.fit ? rates.factors[fit * r.count + k] : 1) : 0;
    put(0, k, E);
    put(1, k, power(E, length));
    put(2, k, C);
    put(3, k, G0);
    put(4, k, has && r.initial ? r.initial[at] : 0);
    lag1 -= C, of_start -= C * G0;
  }
  for (int k = part; k < r.count && given; k += formers) {
    const long at = long(k) * r.step + l;
    lag1 += r.output[at], of_start += r.output[at] * r.start[at];
  }
  changes[0][part][threadIdx.x] = lag1;
  changes[1][part][threadIdx.x] = of_start;
  __syncthreads();
  if (part > 0) return;
  lag1 = of_start = 0;
  for (int p = 0; p < formers && kept < r.count; ++p)
    lag1 += changes[0][p][threadIdx.x], of_start += changes[1][p][threadIdx.x];
  put(5, 0, given ? r.w0[l] : 0);
  put(5, 1, given ? r.w1[l] + lag1 : 0);
  put(5, 2, given ? r.s1[l] + of_start : 0);
}

/// Kept on the device.
class KeptRates {
 public:
  KeptRates(const Device& device, const Shells& shells)
      : fit_(device, shells.of_group.size()),
        count_(device, shells.fits.size()),
        order_(device, shells.fits.size() * shells.fits[0].order.size()),
        factors_(device, order_.size()) {
    const std::size_t K = shells.fits[0].order.size();
    std::vector<int> counts, orders(order_.size(), 0);
    std::vector<double> factors(order_.size(), 0);
    for (std::size_t f = 0; f < shells.fits.size(); ++f) {
      const ShellFit& fit = shells.fits[f];
      counts.push_back(int(fit.order.size()));
      std::copy(fit.order.begin(), fit.order.end(), orders.begin() + long(f * K));
      std::copy(fit.factors.begin(), fit.factors.end(), factors.begin() + long(f * K));
    }
    const std::vector<int> of_group(shells.of_group.begin(), shells.of_group.end());
    fit_.put(of_group.data());
    count_.put(counts.data());
    order_.put(orders.data());
    factors_.put(factors.data());
  }
  Kept view() const { return {fit_.data(), count_.data(), order_.data(), factors_.data()}; }

 private:
  Memory<int> fit_, count_, order_;
  Memory<double> factors_;
};

}  // namespace

Memory<double> form_tables(const Device& device, const ModalRecurrence& r, const Shells* shells, TableSize size) {
  const Index total = r.modes(), count = r.exponentials() * total;
  Memory<double> sent(device, std::size_t((r.initial.size() > 0 ? 4 : 3) * count + 3 * total));
  double* free = sent.data();
  const auto send = [&](const auto& values) {
    double* const to = free;
    device.fetcher().send(values.data(), std::size_t(values.size()), to, device.stream());
    free += values.size();
    return to;
  };
  Given given{int(r.exponentials()), int(size.modes), total};
  given.decay = send(r.decay), given.output = send(r.output), given.start = send(r.start);
  given.w0 = send(r.w0), given.w1 = send(r.w1), given.s1 = send(r.s1);
  if (r.initial.size() > 0) given.initial = send(r.initial);
  std::optional<KeptRates> rates;
  if (shells) rates.emplace(device, *shells);
  Memory<double> tables(device, std::size_t((5 * size.exponentials + 3) * size.stride));
  form<<<unsigned(size.stride / lanes), dim3(lanes, formers), 0, device.stream()>>>(
      given, rates ? rates->view() : Kept{}, int(size.exponentials), int(size.length), int(size.stride), tables.data());
  check(cudaGetLastError(), "forming the tables of a scan");
  device.wait();  // kernels may read them before their predecessors end (launch.cuh)
  return tables;
}

}  // namespace bromwich::cuda::scan
