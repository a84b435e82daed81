// Chains of steps solved forward and backward; the products with maps are virtual.

#include "kernels/host_plans.hpp"
#include "kernels/step_chain.hpp"

#include <algorithm>
#include <utility>

namespace bromwich::cuda {

DeviceStepChain::DeviceStepChain(const Device& device, const StepChainProblem& problem)
    : device_(device),
      m_(int(problem.states())),
      M_(int(problem.steps())),
      memory_limit_(problem.memory_limit),
      mu_(device, M_ + 1, m_),
      other_(device, M_ + 1, m_) {}

void DeviceStepChain::forward(const Array& d, Array& x) {
  start(values(d), values(x));
  if (scans())
    scan(Direction::forward, values(x));
  else
    run(Direction::forward, values(x));
}

void DeviceStepChain::adjoint(const Array& from, Array& to, const AdjointChoice& choice) {
  const double *q = values(from), *mu = values(mu_);
  if (choice.method != AdjointMethod::jacobi) copy_rows(q, values(mu_), 0, M_ + 1);
  switch (choice.method) {
    case AdjointMethod::exact:
      if (scans())
        scan(Direction::backward, values(mu_));
      else
        run(Direction::backward, values(mu_));
      break;
    case AdjointMethod::substitution:
      run(Direction::backward, values(mu_));
      break;
    case AdjointMethod::scan:
      check_products(scan_bytes(), memory_limit_, "scan");
      scan(Direction::backward, values(mu_));
      break;
    case AdjointMethod::doubling:
      mu = doubled();
      break;
    case AdjointMethod::jacobi:
      mu = swept(q, choice.checked_sweeps());
      break;
  }
  finish(mu, values(to));
}

RowMatrix DeviceStepChain::solve(RowMatrix d) {
  DeviceArray in(device_, d.rows(), d.cols()), x(device_, d.rows(), d.cols());
  upload(device_, d, in);
  forward(in, x);
  download(device_, x, d);
  return d;
}

RowMatrix DeviceStepChain::solve_transposed(RowMatrix q, const AdjointChoice& choice) {
  DeviceArray in(device_, q.rows(), q.cols()), l(device_, q.rows(), q.cols());
  upload(device_, q, in);
  adjoint(in, l, choice);
  download(device_, l, q);
  return q;
}

const double* DeviceStepChain::doubled() {
  check_products(16.0 * double(m_) * double(m_) * double(M_), memory_limit_, "doubling");
  double *mu = values(mu_), *next = values(other_);
  copy_rows(mu, next, 0, M_ + 1);
  for (int level = 0; (1L << level) <= M_; ++level) {
    double_windows(level, mu, next);
    std::swap(mu, next);
    // Rows that no window reaches are final. From the second level on, both arrays hold them.
    const Index rows = std::min<Index>(M_ + 1, 2L << level);
    copy_rows(mu, next, M_ + 1 - rows, rows);
  }
  return mu;
}

const double* DeviceStepChain::swept(const double* q, Index sweeps) {
  const double* mu = q;
  double* next = values(mu_);
  for (Index k = 1; k < std::min<Index>(sweeps, M_ + 1); ++k) {
    carry(q, mu, next);
    mu = next;
    next = next == values(mu_) ? values(other_) : values(mu_);
  }
  return mu;
}

void DeviceStepChain::copy_rows(const double* from, double* to, Index first, Index count) const {
  const Index step = stride(m_), at = first * step;
  check(cudaMemcpyAsync(to + at, from + at, sizeof(double) * std::size_t(count * step), cudaMemcpyDeviceToDevice,
                        device_.stream()),
        "copying rows");
}

}  // namespace bromwich::cuda
