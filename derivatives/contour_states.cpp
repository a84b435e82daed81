#include "derivatives/contour_states.hpp"

#include "core/base/error.hpp"
#include "core/kernel/sparse_kernel.hpp"
#include "core/kernel/states.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr std::size_t most_kept_bytes = std::size_t(1) << 30;

const HostThreads calling_thread;  // callbacks of users need not be safe in others

ComplexMatrix times(const SparseMatrix& matrix, const ComplexMatrix& columns) {
  ComplexMatrix product(matrix.rows(), columns.cols());
  product.real() = matrix * columns.real();
  product.imag() = matrix * columns.imag();
  return product;
}

}  // namespace

ContourStates::ContourStates(const DiscreteProblem& p)
    : d_(p.modes() ? Dynamics(to_sparse(*p.modes())) : p.scene.dynamics),
      backend_(p.backend),
      threads_(d_->matrices() ? static_cast<const HostThreads&>(p.backend) : calling_thread),
      B_(d_->inputs()),
      N_(d_->outputs()),
      J_(p.J),
      h_(p.h) {
  if (const SparseDynamics* m = d_->matrices()) {
    transposed_ = Dynamics(SparseDynamics{m->A.transpose(), m->N.transpose(), m->B.transpose(), m->E.transpose()});
    shifts_ = std::make_unique<SparseShifts>(*m);
  }
  const ContourChoices choices = contours_to_try(p.shared->spectrum(), p.scene.T);
  for (const double half_angle : choices.half_angles)
    if (take_windows(*contour_parameters(half_angle), choices.shift)) return;
  throw Error("derivative", "no contour holds the spectrum of A", "use the derivative of dense dynamics");
}

// Windows for this sector, if neighbours agree where they meet.
bool ContourStates::take_windows(const ContourParameters& parameters, double shift) {
  windows_ = lag_windows(parameters, h_, J_, shift);
  kept_.assign(windows_.size(), nullptr);
  const Vector driven = B_ * Vector::Ones(B_.cols()) + N_.transpose() * Vector::Ones(N_.rows());
  const double size = d_->observed_terms(driven).norm() + driven.norm();
  const auto seen = [](const Contour& contour, const ComplexMatrix& at_nodes, double t) {
    const ComplexVector factors = contour.weights.array() * (t * contour.nodes.array()).exp();
    return Vector((at_nodes.transpose() * factors).real());
  };
  Contour before = window_contour(parameters, 0.8 * h_);
  before.nodes.array() += shift;
  try {
    ComplexMatrix of_before = seen_at(driven, before.nodes);
    for (std::size_t k = 0; k < windows_.size(); ++k) {
      const Contour& contour = windows_[k].contour;
      ComplexMatrix of_window = seen_in(driven, k);
      const double t = h_ * double(std::max<Index>(windows_[k].first, 1));
      const double apart = (seen(before, of_before, t) - seen(contour, of_window, t)).norm();
      if (!(apart <= accepted_contour_error * size)) return false;
      before = contour;
      of_before = std::move(of_window);
    }
  } catch (const SingularShift&) {
    return false;
  }
  return true;
}

// N (z_p E - A)^{-1} right, a row for each node.
ComplexMatrix ContourStates::seen_at(const Vector& right, const ComplexVector& nodes) const {
  const SparseMatrix column = Matrix(right).sparseView();
  return backend_.resolvent(Dynamics(d_->with_inputs_and_outputs(column, N_)), nodes);
}

// The same at the nodes of a window, with its factors where the host has them.
ComplexMatrix ContourStates::seen_in(const Vector& right, std::size_t window) const {
  const ComplexVector& nodes = windows_[window].contour.nodes;
  const bool by_device = bool(backend_.fused().resolvent);
  const auto factors = by_device ? kept_[window] : factors_of(window);
  if (!factors) return seen_at(right, nodes);
  const ComplexMatrix columns = right.cast<Complex>().replicate(1, nodes.size());
  return times(N_, factors->solve(columns, false, threads_)).transpose();
}

// Null where elimination needs pivots, and for dynamics of callbacks.
std::shared_ptr<const SparseShifts::Factors> ContourStates::factors_of(std::size_t window) const {
  if (kept_[window] || !shifts_) return kept_[window];
  auto made = shifts_->factorize(windows_[window].contour.nodes, threads_);
  std::size_t bytes = made ? made->bytes() : 0;
  for (const auto& kept : kept_) bytes += kept ? kept->bytes() : 0;
  if (bytes <= most_kept_bytes) kept_[window] = made;
  return made;
}

// (z_p E - A)^{-T} of column p, z_p the nodes of a window.
ComplexMatrix ContourStates::solve_transposed(const ComplexMatrix& right, std::size_t window) const {
  if (const auto factors = factors_of(window)) return factors->solve(right, true, threads_);
  const ComplexVector& nodes = windows_[window].contour.nodes;
  ComplexMatrix found(right.rows(), nodes.size());
  share_each(threads_, nodes.size(), [&](Index p) {
    const auto system = (*transposed_)->at_shift(nodes[p]);
    if (!system) throw eigenvalue_at(nodes[p]);
    found.col(p) = system->solve(ShiftedSystem<Complex>::Column(right.col(p)));
  });
  return found;
}

RowMatrix ContourStates::seen(const Vector& x0) const {
  RowMatrix rows(J_ + 1, N_.rows());
  rows.row(0) = (N_ * x0).transpose();
  if (x0.isZero(0)) return RowMatrix::Zero(J_ + 1, N_.rows());
  const Vector right = d_->times_mass(x0);
  for (std::size_t k = 0; k < windows_.size(); ++k) {
    const LagWindow& window = windows_[k];
    const Index first = std::max<Index>(window.first, 1);
    if (window.last >= first)
      real_product(exponential_factors(window.contour, h_, first, window.last), seen_in(right, k),
                   rows.middleRows(first, window.last - first + 1));
  }
  return rows;
}

Vector ContourStates::seen_transposed(const RowMatrix& rho) const {
  if (!transposed_) return {};
  Vector sum = Vector::Zero(d_->states());
  for (std::size_t k = 0; k < windows_.size(); ++k) {
    const LagWindow& window = windows_[k];
    const Index first = std::max<Index>(window.first, 1), count = window.last - first + 1;
    if (count <= 0) continue;
    const ComplexMatrix at_nodes = rho.middleRows(first, count).transpose().cast<Complex>() *
                                   exponential_factors(window.contour, h_, first, window.last);
    sum += solve_transposed(times(N_.transpose(), at_nodes), k).real().rowwise().sum();
  }
  return (*transposed_)->times_mass(sum) + N_.transpose() * rho.row(0).transpose();
}

// Of the contour of one step: d, l and r, and the prepared solves.
struct ContourStates::Step : StepFactors {
  Step(const ContourStates& of, bool transposed)
      : StepFactors(step_factors(of.windows_.front(), of.h_)),
        threads(of.threads_),
        transposed(transposed),
        factors(of.factors_of(0)) {
    if (factors) return;
    for (const Complex z : of.windows_.front().contour.nodes) {
      systems.push_back((transposed ? *of.transposed_ : of.d_)->at_shift(z));
      if (!systems.back()) throw eigenvalue_at(z);
    }
  }

  Index nodes() const { return decay.size(); }
  /// Column p: S(z_p) or S(z_p)^T times column p.
  ComplexMatrix solve(const ComplexMatrix& given) {
    if (factors) return factors->solve(given, transposed, threads);
    ComplexMatrix found(given.rows(), nodes());
    share_each(threads, nodes(), [&](Index p) {
      found.col(p) = systems[std::size_t(p)]->solve(ShiftedSystem<Complex>::Column(given.col(p)));
    });
    return found;
  }

  const HostThreads& threads;
  const bool transposed;
  std::shared_ptr<const SparseShifts::Factors> factors;  ///< or null
  std::vector<std::unique_ptr<ShiftedSystem<Complex>>> systems;
};

RowMatrix ContourStates::states(const Vector& x0, const RowMatrix& u) const {
  Step step(*this, false);
  RowMatrix x(J_ + 1, d_->states());
  x.row(0) = x0.transpose();
  for (Index j = 1; j <= J_; ++j) {
    const Vector decayed = d_->times_mass(x.row(j - 1).transpose()), before = B_ * u.row(j - 1).transpose(),
                 now = B_ * u.row(j).transpose();
    ComplexMatrix given(x.cols(), step.nodes());
    for (Index p = 0; p < step.nodes(); ++p)
      given.col(p) = step.decay[p] * decayed + step.left[p] * before + step.right[p] * now;
    const ComplexMatrix found = step.solve(given);
    x.row(j) = found.real().rowwise().sum().transpose();
  }
  return x;
}

std::pair<RowMatrix, Vector> ContourStates::states_transposed(const RowMatrix& of_x) const {
  if (!transposed_) throw Error("x", "has no gradient where A is known by its solves alone", "weigh y, w or integral");
  Step step(*this, true);
  RowMatrix u = RowMatrix::Zero(J_ + 1, B_.cols());
  Vector q = of_x.row(J_).transpose();
  for (Index j = J_; j > 0; --j) {
    const ComplexMatrix found = step.solve(q.cast<Complex>().replicate(1, step.nodes()));
    const auto sum = [&](const ComplexVector& factors) { return Vector((found * factors).real()); };
    u.row(j) += (B_.transpose() * sum(step.right)).transpose();
    u.row(j - 1) += (B_.transpose() * sum(step.left)).transpose();
    q = of_x.row(j - 1).transpose() + (*transposed_)->times_mass(sum(step.decay));
  }
  return {std::move(u), std::move(q)};
}

}  // namespace bromwich
