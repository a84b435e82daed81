#include "core/goal/reconstruction.hpp"

#include "core/base/error.hpp"
#include "core/base/text.hpp"
#include "core/base/threads.hpp"
#include "core/numerics/matrix_phi.hpp"
#include "core/numerics/phi.hpp"
#include "core/numerics/row_products.hpp"
#include "core/scene/descriptor.hpp"

#include <cmath>

namespace bromwich {
namespace {

constexpr Index largest_dense_step = 64;          // above, sparse factors are faster
constexpr Index largest_exponential_step = 1024;  // e^{hA} is dense

/// Calls work(i) for the rows i = 0 .. rows-1 of an array, on the given threads or on this one.
template <typename Work>
void share_out(const HostThreads* threads, Index rows, Index cols, const Work& work) {
  const auto range = [&](Index first, Index last) {
    for (Index i = first; i < last; ++i) work(i);
  };
  if (threads)
    threads->each_range(rows, std::max<Index>(1, (Index(1) << 16) / cols), range);
  else
    range(0, rows);
}

/// M x m times the transpose of a sparse matrix.
RowMatrix times_transposed(const RowMatrix& x, const SparseMatrix& A) {
  return row_products(x, SparseMatrix(A.transpose()));
}

}  // namespace

Reconstruction reconstruction(StepScheme scheme, double s) {
  switch (scheme) {
    case StepScheme::euler:
      return {0, 1, 0, 0};
    case StepScheme::midpoint:
      return {1 - s, s, 0, 0};
    case StepScheme::exponential:
      break;
  }
  const double r = 1 - s;
  return {r * r * (1 + 2 * s), s * s * (1 + 2 * r), s * r * r, -s * s * r};
}

const Quadrature& quadrature(StepScheme scheme) {
  static const Quadrature right{{1}, {1}};
  static const double g2 = std::sqrt(1. / 12), g3 = std::sqrt(0.15);
  static const Quadrature two{{0.5 - g2, 0.5 + g2}, {0.5, 0.5}};
  static const Quadrature three{{0.5 - g3, 0.5, 0.5 + g3}, {5. / 18, 8. / 18, 5. / 18}};
  switch (scheme) {
    case StepScheme::euler:
      return right;
    case StepScheme::midpoint:
      return two;
    case StepScheme::exponential:
      break;
  }
  return three;
}

int order(StepScheme scheme) { return scheme == StepScheme::euler ? 1 : scheme == StepScheme::midpoint ? 2 : 4; }

const char* to_string(StepScheme scheme) {
  switch (scheme) {
    case StepScheme::euler:
      return "euler";
    case StepScheme::midpoint:
      return "midpoint";
    case StepScheme::exponential:
      break;
  }
  return "exponential";
}

PortSystem::PortSystem(const PortHamiltonian& port, double T, Form form)
    : port_(port),
      T_(T),
      keeps_E_(form == Form::automatic && port.states() > largest_dense_step && port.E.size() > 0 &&
               !is_diagonal(port.E)),
      energy_(port.energy_matrix()),
      dissipation_(port.dissipation_matrix()),
      output_(port.ports() > 0 ? port.output_matrix() : SparseMatrix(port.states(), 0)) {}

const StateSpace& PortSystem::space() const {
  if (!space_) space_ = state_space(port_);
  return *space_;
}

bool PortSystem::keeps_E(StepScheme scheme) const { return keeps_E_ && scheme != StepScheme::exponential; }

StepChainProblem PortSystem::step_problem(StepScheme scheme, const StepSizes& sizes) const {
  StepChainProblem problem;
  if (keeps_E(scheme)) {
    const SparseMatrix A = port_.state_matrix();
    problem.map_of = sizes.of;
    for (const double h : sizes.sizes) {
      const double right = scheme == StepScheme::euler ? h : h / 2, left = h - right;
      problem.maps.push_back(
          {SparseMatrix(port_.E - right * A), SparseMatrix(port_.E + left * A), SparseMatrix(h * A)});
    }
  } else {
    problem = step_chain_problem(scheme, step_matrix(scheme), sizes);
  }
  if (memory_limit > 0) problem.memory_limit = memory_limit;
  return problem;
}

StepMatrix PortSystem::step_matrix(StepScheme scheme) const {
  if (scheme == StepScheme::exponential && states() > largest_exponential_step)
    throw Error("scheme", text("exponential with %td states", states()),
                text("use midpoint or euler above %td states: e^{hA} is dense", largest_exponential_step));
  if (dense_steps(scheme)) return Matrix(A());
  return A();
}

bool PortSystem::dense_steps(StepScheme scheme) const {
  return scheme == StepScheme::exponential || states() <= largest_dense_step;
}

RowMatrix PortSystem::inputs(const Vector& t, double s) const {
  if (!port_.u) return RowMatrix::Zero(t.size() - 1, port_.ports());
  return samples_.at(port_, T_, t, s);
}

RowMatrix slopes(const Trajectory& path, Side side) {
  const bool left = side == Side::behind;
  const PortSystem& system = path.system;
  const Index M = path.steps();
  RowMatrix slope = times_transposed(left ? path.x.topRows(M) : path.x.bottomRows(M), system.A());
  if (system.port().u) slope += times_transposed(system.inputs(path.t, left ? 0 : 1), system.F());
  return slope;
}

RowMatrix states_within(const Trajectory& path, double s) {
  const Index M = path.steps();
  const auto [alpha, beta, gamma, delta] = reconstruction(path.scheme, s);
  if (path.scheme == StepScheme::euler) return path.x.bottomRows(M);
  RowMatrix x = alpha * path.x.topRows(M) + beta * path.x.bottomRows(M);
  if (path.scheme == StepScheme::exponential)
    x += path.lengths().asDiagonal() * (gamma * slopes(path, Side::behind) + delta * slopes(path, Side::before));
  return x;
}

void add_within(const Trajectory& path, double s, const RowMatrix& g, RowMatrix& gradient) {
  const Index M = path.steps();
  const auto [alpha, beta, gamma, delta] = reconstruction(path.scheme, s);
  gradient.topRows(M) += alpha * g;
  gradient.bottomRows(M) += beta * g;
  if (path.scheme != StepScheme::exponential) return;
  const RowMatrix through_slope = path.lengths().asDiagonal() * row_products(g, path.system.A());
  gradient.topRows(M) += gamma * through_slope;
  gradient.bottomRows(M) += delta * through_slope;
}

RowMatrix step_sources(const PortSystem& system, StepScheme scheme, const Vector& t, const Vector& x0,
                       const HostThreads* threads) {
  const Index M = t.size() - 1, m = system.states();
  RowMatrix d(M + 1, m);
  d.row(0) = x0.transpose();
  if (!system.port().u) {
    d.bottomRows(M).setZero();
    return d;
  }
  if (scheme != StepScheme::exponential) {
    const RowMatrix u = system.inputs(t, scheme == StepScheme::euler ? 1 : 0.5);
    const SparseMatrix& F = system.keeps_E(scheme) ? system.port().B : system.F();
    share_out(threads, M, m, [&](Index i) {
      d.row(i + 1).setZero();
      const double h = t[i + 1] - t[i];
      for (Index c = 0; c < u.cols(); ++c)
        for (SparseMatrix::InnerIterator entry(F, c); entry; ++entry)
          d(i + 1, entry.row()) += h * (u(i, c) * entry.value());
    });
    return d;
  }
  const RowMatrix before = system.inputs(t, 0), behind = system.inputs(t, 1);
  const StepSizes sizes = group_steps(t);
  const Matrix A(system.A()), F(system.F());
  std::vector<std::pair<Matrix, Matrix>> weights;  // h (phi1 - phi2)(hA) F and h phi2(hA) F, by size
  for (const double h : sizes.sizes) {
    const MatrixPhi phi = matrix_phi(h * A);
    weights.emplace_back(h * (phi.phi1 - phi.phi2) * F, h * phi.phi2 * F);
  }
  for (Index i = 0; i < M; ++i) {
    const auto& [left, right] = weights[std::size_t(sizes.of[std::size_t(i)])];
    d.row(i + 1) = before.row(i) * left.transpose() + behind.row(i) * right.transpose();
  }
  return d;
}

Vector halved(const Vector& t) {
  const Index M = t.size() - 1;
  Vector fine(2 * M + 1);
  for (Index i = 0; i < M; ++i) {
    fine[2 * i] = t[i];
    fine[2 * i + 1] = t[i] + (t[i + 1] - t[i]) / 2;
  }
  fine[2 * M] = t[M];
  return fine;
}

RowMatrix prolonged(const Trajectory& path) {
  const Index M = path.steps();
  const bool cubic = path.scheme == StepScheme::exponential;
  const RowMatrix middle = cubic ? states_within(path, 0.5) : RowMatrix();
  const Reconstruction at = reconstruction(path.scheme, 0.5);
  RowMatrix x(2 * M + 1, path.x.cols());
  share_out(path.threads, M, path.x.cols(), [&](Index i) {
    x.row(2 * i) = path.x.row(i);
    if (cubic)
      x.row(2 * i + 1) = middle.row(i);
    else if (at.alpha == 0)
      x.row(2 * i + 1) = path.x.row(i + 1);
    else
      x.row(2 * i + 1) = at.alpha * path.x.row(i) + at.beta * path.x.row(i + 1);
  });
  x.row(2 * M) = path.x.row(M);
  return x;
}

}  // namespace bromwich
