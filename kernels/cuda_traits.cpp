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
  traits.contour = [](double n, double J) {
    const double sweeps = 10 + 0.6 * n;
    return 0.8 + 1.5e-6 * n * J + 1.9e-4 * J + sweeps * (0.042 + 3.9e-8 * n * J);
  };
  traits.multigrid = [](double n, double J) { return (0.32 + 2.5e-3 * n) * std::log2(J) + 2e-6 * n * J + 8.5e-5 * J; };
  // Faces of 31^2 to 255^2 points: cycles to 1e-12, and marches, whose steps are bound by the start of their kernels.
  traits.face_multigrid = [](double n, double J) { return 2 + 4e-6 * n * J; };
  traits.face_march = [](double n, double J) { return 1 + 0.2 * J + 4.7e-6 * n * J; };
  return traits;
}

}  // namespace bromwich
