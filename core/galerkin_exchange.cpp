// z_k and x_k on given active sets, and the exchange of what has the wrong sign: the semismooth Newton method on
// min(z, w) = 0, with every linear system solved exactly.

#include "core/galerkin_solvers.hpp"
#include "core/lcp/solution.hpp"
#include "core/text.hpp"
#include "core/two_point.hpp"

#include <Eigen/Dense>

#include <functional>
#include <string>
#include <unordered_map>
#include <unordered_set>

namespace bromwich {

namespace {

constexpr double least_pivot_condition = 1e-13;  ///< of D_SS; below it the active set counts as singular
constexpr double sign_tolerance = 1e-13;         ///< of the largest z, and of the largest w

// z = -(Zx x + Zq q) and x_next = P x - HZq q + F on one active set.
struct ActiveMap {
  Matrix Zx, Zq, P, HZq;
};

// out -= A v, without the overhead of a library call where A is small.
template <typename In, typename Out>
void subtract_product(const Matrix& A, const In& v, Out& out) {
  constexpr Index small = 400;
  if (A.size() <= small)
    out.noalias() -= A.lazyProduct(v);
  else
    out.noalias() -= A * v;
}

class ActiveMaps {
 public:
  explicit ActiveMaps(const GalerkinStep& step) : step_(step) {}

  /// Null where D_SS is singular. `active` has one character per component, 1 for those in S.
  const ActiveMap* find(const std::string& active) {
    const auto [place, fresh] = maps_.try_emplace(active);
    if (fresh) place->second = make(active);
    return place->second.get();
  }
  std::size_t bytes() const {
    const Index m = step_.E.rows(), n = step_.D.rows();
    return maps_.size() * sizeof(double) * std::size_t((n + m) * (n + m));
  }

 private:
  std::unique_ptr<ActiveMap> make(const std::string& active) const {
    const Index m = step_.E.rows(), n = step_.D.rows();
    std::vector<Index> S;
    for (Index i = 0; i < n; ++i)
      if (active[std::size_t(i)] == 1) S.push_back(i);
    auto map =
        std::make_unique<ActiveMap>(ActiveMap{Matrix::Zero(n, m), Matrix::Zero(n, n), step_.E, Matrix::Zero(m, n)});
    if (S.empty()) return map;
    const Matrix D = step_.D(S, S);
    const Equilibration scale = equilibrate(D);
    const Eigen::PartialPivLU<Matrix> lu(scale.rows.asDiagonal() * D * scale.columns.asDiagonal());
    if (!(reciprocal_condition(lu) >= least_pivot_condition)) return nullptr;
    const Matrix inverse = scale.columns.asDiagonal() * lu.inverse() * scale.rows.asDiagonal();
    map->Zx(S, Eigen::all) = inverse * step_.C(S, Eigen::all);
    map->Zq(S, S) = inverse;
    map->P -= step_.H * map->Zx;
    map->HZq = step_.H * map->Zq;
    return map;
  }

  const GalerkinStep& step_;
  std::unordered_map<std::string, std::unique_ptr<ActiveMap>> maps_;
};

class Exchange {
 public:
  Exchange(const GalerkinProblem& p, const Options& options)
      : p_(p),
        options_(options),
        maps_(p.step),
        active_(std::size_t(p.N), std::string(std::size_t(p.unknowns()), char(0))),
        P_(std::size_t(p.N)),
        map_(std::size_t(p.N)) {}

  GalerkinSolution run(const RowMatrix* start, Index most) {
    GalerkinSolution s;
    if (start) start_from(*start);
    std::unordered_set<std::size_t> visited;
    RowMatrix before;
    for (s.iterations = 1; s.iterations <= most; ++s.iterations) {
      if (options_.interrupted && options_.interrupted()) {
        s.status = Status::interrupted;
        s.reason = "stopped on request";
        break;
      }
      if (!evaluate(s.reason)) break;
      s.history.push_back(
          before.size() == 0 ? 1 : (z_ - before).cwiseAbs().maxCoeff() / std::max(1.0, z_.cwiseAbs().maxCoeff()));
      if (options_.progress) options_.progress({s.iterations, s.history.back(), 0});
      before = z_;
      if (exchanged() == 0) {
        refine();
        s.status = Status::solved;
        break;
      }
      if (!visited.insert(hash()).second) {
        s.reason = text("the active sets repeat after %ld exchanges", long(s.iterations));
        break;
      }
    }
    if (s.status != Status::solved && s.reason.empty())
      s.reason = text("the active sets still change after %ld exchanges", long(most));
    s.how = text("active sets of all intervals exchanged %ld times, two-point problems eliminated orthogonally",
                 long(s.iterations));
    s.z = (z_.array() > 0).select(z_, 0.0);
    s.x = x_;
    s.lcp.newton = s.iterations;
    const Index m = p_.states(), n = p_.unknowns();
    s.bytes = maps_.bytes() + sizeof(double) * std::size_t(p_.N * (2 * m * m + 4 * m + 4 * n)) +
              std::size_t(p_.N) * (std::size_t(n) + 5 * sizeof(void*));
    return s;
  }

 private:
  void start_from(const RowMatrix& z) {
    for (Index k = 0; k < p_.N; ++k)
      for (Index i = 0; i < z.cols(); ++i) active_[std::size_t(k)][std::size_t(i)] = z(k, i) > 0 ? 1 : 0;
  }

  bool evaluate(std::string& reason) {
    for (Index k = 0; k < p_.N; ++k) {
      const std::string& active = active_[std::size_t(k)];
      const bool as_before = k > 0 && active == active_[std::size_t(k - 1)];
      const ActiveMap* map = as_before ? map_[std::size_t(k - 1)] : maps_.find(active);
      if (!map) {
        reason = text("the matrix of the active set at t = %.6g is singular", double(k) * p_.h);
        return false;
      }
      map_[std::size_t(k)] = map;
      P_[std::size_t(k)] = &map->P;
    }
    if (!solve_on_active_sets(p_.forcing, p_.q, p_.boundary, z_, x_)) {
      reason = "on an active set the boundary condition does not determine the states";
      return false;
    }
    w_ = galerkin_slack(p_, z_, x_);
    if (z_.allFinite() && w_.allFinite()) return true;
    reason = "the iteration is not finite";
    return false;
  }

  bool solve_on_active_sets(const RowMatrix& forcing, const RowMatrix& q, const BoundaryCondition& boundary,
                            RowMatrix& z, RowMatrix& x) const {
    RowMatrix inputs = forcing;
    for (Index k = 0; k < p_.N; ++k) {
      auto input = inputs.row(k).transpose();
      subtract_product(map_[std::size_t(k)]->HZq, q.row(k).transpose(), input);
    }
    x = solve_two_point(P_, inputs, boundary, epsilon);
    if (x.rows() == 0) return false;
    z = RowMatrix::Zero(p_.N, p_.unknowns());
    for (Index k = 0; k < p_.N; ++k) {
      const ActiveMap& map = *map_[std::size_t(k)];
      auto values = z.row(k).transpose();
      subtract_product(map.Zx, x.row(k).transpose(), values);
      subtract_product(map.Zq, q.row(k).transpose(), values);
    }
    return true;
  }

  // Iterative refinement: where M is singular D_SS is of size h, and z loses digits that w shows.
  void refine() {
    constexpr double rounding_of_slack = 1e-13;
    BoundaryCondition homogeneous = p_.boundary;
    homogeneous.b.setZero();
    for (int twice = 0; twice < 2; ++twice) {
      RowMatrix rest = galerkin_slack(p_, z_, galerkin_states(p_, z_)), dz, dx;
      const double size = std::max(1.0, rest.cwiseAbs().maxCoeff());
      for (Index k = 0; k < p_.N; ++k)
        for (Index i = 0; i < rest.cols(); ++i)
          if (!active_[std::size_t(k)][std::size_t(i)]) rest(k, i) = 0;
      if (!(rest.cwiseAbs().maxCoeff() > rounding_of_slack * size)) return;
      if (!solve_on_active_sets(RowMatrix::Zero(p_.N, p_.states()), rest, homogeneous, dz, dx)) return;
      z_ += dz;
      x_ += dx;
    }
  }

  Index exchanged() {
    const double z_small = sign_tolerance * z_.cwiseAbs().maxCoeff();
    const double w_small = sign_tolerance * w_.cwiseAbs().maxCoeff();
    Index flips = 0;
    for (Index k = 0; k < p_.N; ++k)
      for (Index i = 0; i < z_.cols(); ++i) {
        char& a = active_[std::size_t(k)][std::size_t(i)];
        const bool wrong = a ? z_(k, i) < -z_small : w_(k, i) < -w_small;
        if (!wrong) continue;
        a = char(1 - a);
        ++flips;
      }
    return flips;
  }

  std::size_t hash() const {
    std::size_t h = 0;
    for (const std::string& a : active_) h = h * 1099511628211u + std::hash<std::string>{}(a);
    return h;
  }

  const GalerkinProblem& p_;
  const Options& options_;
  ActiveMaps maps_;
  std::vector<std::string> active_;
  std::vector<const Matrix*> P_;
  std::vector<const ActiveMap*> map_;
  RowMatrix z_, x_, w_;
};

}  // namespace

GalerkinSolution exchange_active_sets(const GalerkinProblem& p, const Options& options, const RowMatrix* start,
                                      Index most) {
  return Exchange(p, options).run(start, most);
}

double natural_residual(const GalerkinProblem& p, const RowMatrix& z, const RowMatrix& x) {
  const RowMatrix known = p.q + x.topRows(p.N) * p.step.C.transpose(), w = known + z * p.step.D.transpose();
  return z.cwiseMin(w).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(1.0, known.cwiseAbs().maxCoeff());
}

}  // namespace bromwich
