// Newton's method on the initial state: x_0 -> E0 x_0 + ET x_N(x_0) - b is piecewise linear, where every interval has
// one solution. Marching gives the active sets that belong to x_0, the linear two-point problem on them the next x_0.

#include "core/base/text.hpp"
#include "core/galerkin/solvers.hpp"

namespace bromwich {

namespace {

constexpr Index most_shots = 40;
constexpr double shortest_shot = 1. / 64;

class Shooting {
 public:
  Shooting(const GalerkinProblem& p, Backend& backend, const Options& options)
      : p_(p), from_start_(p), backend_(backend), options_(options) {
    const Index m = p.states();
    from_start_.initial_value = true;
    from_start_.boundary = {Matrix::Identity(m, m), Matrix::Zero(m, m), Vector::Zero(m)};
    options_.progress = {};
  }

  GalerkinSolution run(const Vector& first) {
    GalerkinSolution s;
    Vector x0 = first;
    if (!march(x0)) return marched_;
    double miss = largest_miss();
    LcpCount count = marched_.lcp;
    for (Index shots = 1; shots <= most_shots; ++shots) {
      s = exchange_active_sets(p_, backend_, options_, &marched_.z, 1);
      s.iterations = shots;
      s.lcp += count;
      ++s.lcp.fallbacks;
      s.how =
          text("Newton's method on the initial state, %ld times marched and a two-point problem solved", long(shots));
      if (s.status != Status::tolerance_not_met) return s;
      if (s.x.rows() != p_.N + 1) break;
      const Vector direction = s.x.row(0).transpose() - x0;
      if (!direction.allFinite()) break;
      double length = 1;
      for (; length >= shortest_shot; length /= 2) {
        if (march(x0 + length * direction)) {
          count += marched_.lcp;
          if (largest_miss() < miss) break;
        } else if (marched_.status == Status::interrupted) {
          return marched_;
        }
      }
      if (length < shortest_shot) break;
      x0 += length * direction;
      miss = largest_miss();
    }
    s.reason = text("shooting stands still, the boundary condition missed by %.1e", miss);
    return s;
  }

 private:
  bool march(const Vector& x0) {
    from_start_.boundary.b = x0;
    marched_ = march_galerkin(from_start_, backend_, options_);
    if (marched_.status == Status::solved && marched_.x.allFinite()) return true;
    if (marched_.status == Status::interrupted) return false;
    marched_.status = Status::tolerance_not_met;
    marched_.reason = "marching from an initial state ends early";
    return false;
  }
  double largest_miss() const {
    const BoundaryCondition& c = p_.boundary;
    return (c.E0 * marched_.x.row(0).transpose() + c.ET * marched_.x.row(p_.N).transpose() - c.b)
        .cwiseAbs()
        .maxCoeff<Eigen::PropagateNaN>();
  }

  const GalerkinProblem& p_;
  GalerkinProblem from_start_;
  Backend& backend_;
  Options options_;
  GalerkinSolution marched_;
};

}  // namespace

GalerkinSolution shoot(const GalerkinProblem& p, Backend& backend, const Options& options, const Vector& x0) {
  return Shooting(p, backend, options).run(x0);
}

}  // namespace bromwich
