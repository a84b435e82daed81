#include "core/shooting/divided_shooting.hpp"

#include "core/events/event_sources.hpp"
#include "core/lcp/active_set.hpp"
#include "core/scene/memory_rows.hpp"
#include "core/shooting/flow_derivative.hpp"
#include "core/shooting/shooting_matrix.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>

namespace bromwich {

namespace {

constexpr Index parts = 11;  ///< a prime: edges of pulses at simple fractions of T lie inside of parts
constexpr int most_steps = 30, most_halvings = 6;
constexpr double small_defect = 1e-7;  ///< of the sizes: Newton's method over [0, T] takes the rest

/// One part, as a scene that begins at 0.
struct Part {
  Scene scene;
  std::vector<double> breakpoints;
  FlowDerivative derivative;
  std::shared_ptr<RegimesOfScene> kept = keep_regimes();

  Part(const Scene& whole, const std::vector<double>& all, double begin, double end)
      : scene(shifted(whole, begin, end)), breakpoints(inside(all, begin, end)), derivative(scene) {}

  static Scene shifted(const Scene& whole, double begin, double end) {
    Scene part = whole;
    part.T = end - begin;
    change_each_source(part, [begin](const TimeFunction& all) -> TimeFunction {
      return [all, begin](double t, Eigen::Ref<Vector> value) { all(t + begin, value); };
    });
    return part;
  }
  static std::vector<double> inside(const std::vector<double>& all, double begin, double end) {
    std::vector<double> some;
    for (const double t : all)
      if (t > begin && t < end) some.push_back(t - begin);
    return some;
  }
};

class DividedShooting {
 public:
  DividedShooting(const Scene& scene, const BoundaryCondition& c, LcpClass lcp_class,
                  const std::vector<double>& breakpoints, const EventOptions& options, const Vector& size)
      : c_(c), class_(lcp_class), options_(options), size_(size) {
    const double h = scene.T / double(parts);
    for (Index k = 0; k < parts; ++k)
      parts_.emplace_back(scene, breakpoints, double(k) * h, k + 1 == parts ? scene.T : double(k + 1) * h);
  }

  Vector run(const EventSolution& guess) {
    std::vector<Vector> states;
    for (Index k = 0; k < parts; ++k) states.push_back(guess.x(double(k) * parts_.front().scene.T, k > 0));
    Iterate now = pass(std::move(states));
    for (int step = 0; step < most_steps && now.complete; ++step) {
      if (now.defect <= small_defect) return now.x.front();
      if (!descend(now)) break;
    }
    return {};
  }

 private:
  struct Iterate {
    std::vector<Vector> x, F;
    std::vector<EventSolution> flows;
    bool complete = false;
    double defect = INFINITY;
  };

  Iterate pass(std::vector<Vector> x) {
    Iterate it;
    for (Index k = 0; k < parts; ++k) {
      Part& part = parts_[std::size_t(k)];
      part.scene.x0 = nearest_feasible(part.scene, x[std::size_t(k)], size_);
      it.x.push_back(part.scene.x0);
      EventOptions options = options_;
      options.kept = part.kept;
      it.flows.push_back(integrate_with_events(part.scene, class_, part.breakpoints, options));
      if (!it.flows.back().complete) return it;
    }
    it.complete = true;
    for (Index k = 0; k < parts; ++k) {
      const Vector end = it.flows[std::size_t(k)].x(parts_[std::size_t(k)].scene.T, true);
      const bool last = k + 1 == parts;
      it.F.push_back(last ? Vector(c_.E0 * it.x.front() + c_.ET * end - c_.b) : Vector(end - it.x[std::size_t(k + 1)]));
    }
    it.defect = defect_of(it.F);
    return it;
  }

  double defect_of(const std::vector<Vector>& F) const {
    const Vector of_ends = (c_.E0.cwiseAbs() + c_.ET.cwiseAbs()) * size_ + c_.b.cwiseAbs();
    double sum = 0;
    for (const Vector& f : F) sum += f.cwiseQuotient(&f == &F.back() ? of_ends : size_).squaredNorm();
    return std::isfinite(sum) ? std::sqrt(sum) : INFINITY;
  }

  bool descend(Iterate& now) {
    std::vector<Matrix> D;
    for (Index k = 0; k < parts; ++k) {
      D.push_back(parts_[std::size_t(k)].derivative.at_end(now.flows[std::size_t(k)]));
      if (!D.back().allFinite()) return false;
    }
    // dx_{k+1} = D_k dx_k + F_k: dx at the end of the last part is D dx_0 + from_F.
    Matrix all = Matrix::Identity(size_.size(), size_.size());
    Vector from_F = Vector::Zero(size_.size());
    for (Index k = 0; k < parts; ++k) {
      all = D[std::size_t(k)] * all;
      from_F = D[std::size_t(k)] * from_F;
      if (k + 1 < parts) from_F += now.F[std::size_t(k)];
    }
    const ShootingMatrix K(c_, all, size_);
    std::vector<Vector> dx{K.solve(Vector(-now.F.back() - c_.ET * from_F))};
    for (Index k = 0; k + 1 < parts; ++k) dx.push_back(D[std::size_t(k)] * dx.back() + now.F[std::size_t(k)]);
    double share = 1;
    for (int halved = 0; halved <= most_halvings; ++halved, share /= 2) {
      if (options_.interrupted && options_.interrupted()) return false;
      std::vector<Vector> x = now.x;
      for (std::size_t k = 0; k < x.size(); ++k) x[k] += share * dx[k];
      Iterate next = pass(std::move(x));
      if (!next.complete || !(next.defect <= (1 - 0.1 * share) * now.defect)) continue;
      now = std::move(next);
      return true;
    }
    return false;
  }

  const BoundaryCondition& c_;
  const LcpClass class_;
  const EventOptions& options_;
  const Vector size_;
  std::deque<Part> parts_;  ///< which stay in place: their derivatives refer to their scenes
};

}  // namespace

Vector shoot_in_parts(const Scene& scene, const BoundaryCondition& c, LcpClass lcp_class,
                      const std::vector<double>& breakpoints, const EventOptions& options, const EventSolution& guess,
                      const Vector& size) {
  return DividedShooting(scene, c, lcp_class, breakpoints, options, size).run(guess);
}

// z = x + size^2 N^T p, p an LCP.
Vector nearest_feasible(const Scene& all, const Vector& x, const Vector& size, RowsOfStart which) {
  const Scene scene = all.memories.empty() ? all : in_modes(all, modes_at(all, x));
  const Matrix M = to_dense(scene.M), &N = scene.dynamics->small_state()->N, &B = scene.dynamics->small_state()->B;
  const Vector g = EventSources(scene).g(0);
  const Vector impulses = (N * B).cwiseAbs().rowwise().sum(), terms = N.cwiseAbs() * B.cwiseAbs().rowwise().sum();
  const double rounding = 4 * double(N.cols() + 1) * epsilon;
  std::vector<Index> rows;
  for (Index i = 0; i < M.rows(); ++i) {
    const bool moved = which == RowsOfStart::without_impulses && impulses[i] > rounding * terms[i];
    if (!(M.row(i).array() != 0).any() && N.row(i).norm() > 0 && !moved) rows.push_back(i);
  }
  if (rows.empty()) return x;
  const Matrix K = size.asDiagonal() * N(rows, Eigen::all).transpose();
  ActiveSetLcp lcp(K.transpose() * K, LcpClass::PSD);
  Vector p;
  const Vector w = N(rows, Eigen::all) * x + g(rows);
  if (!lcp.solve(w, p).solved) return x;
  return x + size.asDiagonal() * (K * p);
}

}  // namespace bromwich
