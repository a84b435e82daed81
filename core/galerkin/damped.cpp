// phi(z, w) = sqrt(z^2 + w^2) - z - w vanishes exactly where 0 <= z ⊥ w >= 0, and 1/2 |phi|^2 is smooth (Fischer; De
// Luca, Facchinei, Kanzow, Math. Programming 75, 1996). With r = sqrt(z^2 + w^2), a = 1 - z/r, b = 1 - w/r, a Newton
// step is
//
//     a dz + b (D dz + C dx_{k-1}) = phi,    dx_k = E dx_{k-1} + H dz,    E0 dx_0 + ET dx_N = 0,
//
// again an affine map per interval and a linear two-point problem. a + mu, mu -> 0 with phi, keeps the maps regular
// where D_SS is singular; it damps the steps and does not move the solution.

#include "core/base/text.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/lcp/solution.hpp"
#include "core/numerics/two_point.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index most_damped_steps = 300;
constexpr double sufficient_decrease = 1e-4;
constexpr double shortest_step = 1e-8;
constexpr double largest_prox = 1e3;
constexpr double damped_tolerance = 1e-12;  ///< of phi, relative to the scaled data

double merit_phi(double z, double w) { return std::hypot(z, w) - z - w; }

// Rows and columns of D of comparable size; z = columns * (z of the scaled problem).
GalerkinProblem comparable(const GalerkinProblem& p, const Equilibration& e) {
  GalerkinProblem scaled = p;
  for (GalerkinRun& run : scaled.runs) {
    GalerkinStep& step = run.step;
    step.D = (e.rows.asDiagonal() * step.D * e.columns.asDiagonal()).eval();
    step.C = (e.rows.asDiagonal() * step.C).eval();
    step.H = (step.H * e.columns.asDiagonal()).eval();
  }
  scaled.q = p.q * e.rows.asDiagonal();
  return scaled;
}

class DampedNewton {
 public:
  DampedNewton(const GalerkinProblem& p, Backend& backend, const Options& options)
      : scale_(equilibrate(p.first_step().D)), p_(comparable(p, scale_)), backend_(backend), options_(options) {}

  GalerkinSolution run(const RowMatrix& start) {
    z_ = start * scale_.columns.cwiseInverse().asDiagonal();
    x_ = galerkin_states(p_, z_);
    w_ = galerkin_slack(p_, z_, x_);
    const double size = std::max(1.0, p_.q.cwiseAbs().maxCoeff());
    GalerkinSolution s;
    double next_attempt = 1e-1 * size;
    for (s.iterations = 1; s.iterations <= most_damped_steps; ++s.iterations) {
      if (asked_to_stop(options_, s)) break;
      const double distance = largest_phi();
      s.history.push_back(distance);
      if (options_.progress) options_.progress({s.iterations, distance, 0});
      if (distance <= next_attempt) {
        next_attempt = distance / 10;
        if (finished(s)) return s;
      }
      if (distance <= damped_tolerance * size) {
        s.status = Status::solved;
        break;
      }
      if (!step(std::min(1e-2, distance / size))) {
        s.reason = text("the damped Newton method stands still at a distance of %.1e from complementarity", distance);
        break;
      }
    }
    if (s.status != Status::solved && s.reason.empty()) s.reason = "the damped Newton method did not converge";
    s.how = text("damped Newton method, %ld steps, two-point problems eliminated orthogonally", long(s.iterations));
    s.z = RowMatrix((z_.array() > 0).select(z_, 0.0)) * scale_.columns.asDiagonal();
    s.x = x_;
    s.lcp.newton = s.iterations;
    s.lcp.fallbacks = 1;
    s.bytes = sizeof(double) * std::size_t(8 * z_.size() + p_.N * p_.states() * (3 * p_.states() + 4));
    return s;
  }

 private:
  double largest_phi() const { return z_.binaryExpr(w_, &merit_phi).cwiseAbs().maxCoeff(); }
  static double merit(const RowMatrix& z, const RowMatrix& w) { return z.binaryExpr(w, &merit_phi).squaredNorm() / 2; }

  // The active sets of the iterate, tried as those of a solution.
  bool finished(GalerkinSolution& s) const {
    const RowMatrix active = (z_.array() > w_.array()).cast<double>();
    GalerkinSolution exact = exchange_active_sets(p_, backend_, options_, &active);
    if (exact.status != Status::solved) return false;
    exact.z = exact.z * scale_.columns.asDiagonal();
    exact.how = text("damped Newton method, %ld steps; ", long(s.iterations)) + exact.how;
    exact.iterations += s.iterations;
    exact.history.insert(exact.history.begin(), s.history.begin(), s.history.end());
    exact.lcp.fallbacks = 1;
    s = std::move(exact);
    return true;
  }

  bool step(double prox) {
    const double before = merit(z_, w_);
    for (; prox <= largest_prox; prox = 10 * std::max(prox, 1e-12)) {
      if (!direction(prox)) continue;
      const RowMatrix dw = galerkin_slack(p_, dz_, dx_) - p_.q;
      for (double length = 1; length >= shortest_step; length /= 2) {
        const RowMatrix z = z_ + length * dz_, w = w_ + length * dw;
        if (!(merit(z, w) <= (1 - 2 * sufficient_decrease * length) * before)) continue;
        z_ = z;
        x_ += length * dx_;
        w_ = galerkin_slack(p_, z_, x_);
        return true;
      }
    }
    return false;
  }

  bool direction(double prox) {
    const Index n = p_.unknowns(), m = p_.states(), N = p_.N;
    std::vector<Matrix> P(static_cast<std::size_t>(N)), Z(P.size());
    std::vector<const Matrix*> pointers;
    RowMatrix inputs(N, m), free(N, n);
    Vector a(n), b(n), phi(n);
    const GalerkinRun* run = p_.runs.data();
    for (Index k = 0; k < N; ++k) {
      if (k == run->first + run->count) ++run;
      const GalerkinStep& s = run->step;
      for (Index i = 0; i < n; ++i) {
        const double z = z_(k, i), w = w_(k, i), r = std::hypot(z, w);
        a[i] = r > 0 ? 1 - z / r : 1 - std::sqrt(0.5);
        b[i] = r > 0 ? 1 - w / r : 1 - std::sqrt(0.5);
        phi[i] = merit_phi(z, w);
      }
      Matrix K = b.asDiagonal() * s.D;
      K.diagonal() += a;
      K.diagonal().array() += prox;
      const Eigen::PartialPivLU<Matrix> lu(K);
      Matrix& map = Z[std::size_t(k)] = lu.solve(Matrix(b.asDiagonal() * s.C));
      free.row(k) = lu.solve(phi).transpose();
      if (!map.allFinite() || !free.row(k).allFinite()) return false;
      P[std::size_t(k)] = s.E - s.H * map;
      inputs.row(k) = (s.H * free.row(k).transpose()).transpose();
      pointers.push_back(&P[std::size_t(k)]);
    }
    BoundaryCondition homogeneous = p_.boundary;
    homogeneous.b.setZero();
    dx_ = solve_two_point(pointers, inputs, homogeneous, epsilon);
    if (dx_.rows() == 0 || !dx_.allFinite()) return false;
    dz_ = free;
    for (Index k = 0; k < N; ++k) dz_.row(k).noalias() -= dx_.row(k) * Z[std::size_t(k)].transpose();
    return dz_.allFinite();
  }

  const Equilibration scale_;
  const GalerkinProblem p_;
  Backend& backend_;
  const Options& options_;
  RowMatrix z_, x_, w_, dz_, dx_;
};

}  // namespace

GalerkinSolution damped_newton(const GalerkinProblem& p, Backend& backend, const Options& options,
                               const RowMatrix& start) {
  return DampedNewton(p, backend, options).run(start);
}

}  // namespace bromwich
