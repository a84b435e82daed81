#include "nonlinear/exponential_step.hpp"

#include "core/numerics/matrix_phi.hpp"

namespace bromwich {

ExponentialStep make_exponential_step(const Matrix& A, double h, StepRule rule) {
  ExponentialStep step;
  step.nodes = rule == StepRule::radau ? std::vector<double>{1.0 / 3, 1} : std::vector<double>{1};
  for (const double c : step.nodes) {
    const MatrixPhi phi = matrix_phi(c * h * A);
    // Integrals of e^{(ch - s) A} and of e^{(ch - s) A} s / h over [0, ch].
    const Matrix of_one = c * h * phi.phi1, of_time = c * c * h * phi.phi2;
    step.propagators.push_back(phi.exponential);
    step.left.push_back(rule == StepRule::linear ? Matrix(of_one - of_time) : Matrix(0 * of_one));
    if (rule == StepRule::linear)
      step.weights.push_back({of_time});
    else
      step.weights.push_back({1.5 * (of_one - of_time), 1.5 * of_time - 0.5 * of_one});
  }
  return step;
}

}  // namespace bromwich
