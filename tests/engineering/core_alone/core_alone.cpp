// Uses core where there is nothing else: e^{-t} on a contour of the library, and a scene of its catalogue.

#include <bromwich/bromwich.hpp>
#include <bromwich/core/numerics/contour.hpp>

#include <cmath>
#include <cstdio>

int main() {
  bromwich::make_scene("bridge").validate();

  const bromwich::Contour contour = bromwich::window_contour(*bromwich::contour_parameters(0), 0.5);
  double error = 0;
  for (const double t : {0.5, 1.0, 2.5}) {
    bromwich::Complex sum = 0;
    for (bromwich::Index p = 0; p < contour.nodes.size(); ++p)
      sum += contour.weights[p] * std::exp(contour.nodes[p] * t) / (contour.nodes[p] + 1.0);
    error = std::fmax(error, std::abs(sum.real() - std::exp(-t)));
  }
  std::printf("core alone: e^{-t} on a contour, error %.1e\n", error);
  return error < 1e-13 ? 0 : 1;  // the stored parameters promise 1e-14; the sum has some 20 terms of size 1
}
