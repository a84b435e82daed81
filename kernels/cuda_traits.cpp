#include "core/seam/traits.hpp"
#include "kernels/cuda_backend.hpp"

#include <cmath>

namespace bromwich {

BackendTraits cuda_traits() {
  BackendTraits traits;
  traits.fewest_steps = 48;
  traits.unpolled_steps = 2048;
  traits.one_at_a_time = false;
  traits.start_seconds = 0.15;
  traits.fewest_values = 1e4;
  traits.march = [](double n, double J) {
    constexpr double largest = 1024;  // largest n of the fit
    return n > largest ? INFINITY : 0.5 + 0.017 * n + 2.8e-5 * n * n + 1e-5 * n * J + 2.4e-3 * J;
  };
  // signorini with c = 0.002 and 0.05 on an H200 (bench/results/auto-gpu.json); the larger c needs up to five times the
  // sweeps of `contour`, and the fit is to both.
  traits.contour = [](double n, double J) {
    const double sweeps = 80 + 1.25 * n;
    return 1.5e-6 * n * J + 1.9e-4 * J + sweeps * (0.031 + 3.9e-8 * n * J);
  };
  traits.multigrid = [](double n, double J) {
    return (0.46 + 2.9e-3 * n) * std::log2(J) + 1.6e-6 * n * J + 3.3e-4 * J;
  };
  // Faces of 31^2 to 255^2 points: cycles to 1e-12, and marches, whose steps are bound by the start of their kernels.
  traits.face_multigrid = [](double n, double J) { return 2 + 4e-6 * n * J; };
  traits.face_march = [](double n, double J) { return 1 + 0.2 * J + 4.7e-6 * n * J; };
  return traits;
}

}  // namespace bromwich
