// z_k and x_k on given active sets, and the exchange of components with the wrong sign: the semismooth Newton method on
// min(z, w) = 0, with every linear system solved exactly. The backend does the work of single intervals, for all of
// them at once (core/host/affine_chain.hpp).

#include "core/base/text.hpp"
#include "core/galerkin/solvers.hpp"
#include "core/host/affine_chain.hpp"
#include "core/lcp/solution.hpp"
#include "core/seam/backend.hpp"

#include <Eigen/Dense>

#include <bit>
#include <map>
#include <memory>
#include <unordered_set>

namespace bromwich {

namespace {

constexpr double least_pivot_condition = 1e-13;  ///< of D_SS; below it the active set counts as singular
constexpr double sign_tolerance = 1e-13;         ///< of the largest z, and of the largest w

// The affine map of an interval with the active set S: v = z on S and w elsewhere. Null where D_SS is singular.
std::unique_ptr<AffineMap> active_map(const GalerkinStep& step, const SetWords& active) {
  const Index m = step.E.rows(), n = step.D.rows();
  std::vector<Index> S, rest;
  for (Index i = 0; i < n; ++i) (contains(active.data(), i) ? S : rest).push_back(i);
  auto map = std::make_unique<AffineMap>(AffineMap{step.E, Matrix::Zero(m, n), step.C, Matrix::Identity(n, n), active});
  if (S.empty()) return map;
  const Matrix D = step.D(S, S);
  const Equilibration scale = equilibrate(D);
  const Eigen::PartialPivLU<Matrix> lu(scale.rows.asDiagonal() * D * scale.columns.asDiagonal());
  if (!(reciprocal_condition(lu) >= least_pivot_condition)) return nullptr;
  const Matrix inverse = scale.columns.asDiagonal() * lu.inverse() * scale.rows.asDiagonal();
  const Matrix Z = inverse * step.C(S, Eigen::all), H = step.H(Eigen::all, S);  // z_S = -(Z x + D_SS^{-1} q_S)
  map->P -= H * Z;
  map->G(Eigen::all, S) = H * inverse;
  map->X(S, Eigen::all) = -Z;
  map->X(rest, Eigen::all) -= step.D(rest, S) * Z;
  map->Q(S, S) = -inverse;
  map->Q(rest, S) = -step.D(rest, S) * inverse;
  return map;
}

// The maps of the active sets that have occurred, on intervals of each length.
class ActiveMaps {
 public:
  explicit ActiveMaps(const GalerkinProblem& p) : p_(p), numbers_(p.runs.size()) {}

  /// Number of the map of one set on intervals of a run, -1 where D_SS is singular.
  int find(std::size_t run, const std::uint64_t* set) {
    const SetWords key(set, set + words_of_set(p_.unknowns()));
    const auto [place, fresh] = numbers_[run].try_emplace(key, -1);
    if (fresh)
      if (auto map = active_map(p_.runs[run].step, key)) {
        place->second = int(maps_.size());
        pointers_.push_back(map.get());
        maps_.push_back(std::move(map));
      }
    return place->second;
  }
  const std::vector<const AffineMap*>& maps() const { return pointers_; }
  std::size_t bytes() const {
    const Index m = p_.states(), n = p_.unknowns();
    return maps_.size() * sizeof(double) * std::size_t((n + m) * (n + m));
  }

 private:
  const GalerkinProblem& p_;
  std::vector<std::map<SetWords, int>> numbers_;
  std::vector<std::unique_ptr<AffineMap>> maps_;
  std::vector<const AffineMap*> pointers_;
};

class Exchange {
 public:
  Exchange(const GalerkinProblem& p, Backend& backend, const Options& options)
      : p_(p),
        options_(options),
        maps_(p),
        chain_(backend.affine_chain({p.N, p.states(), p.unknowns()})),
        words_(words_of_set(p.unknowns())),
        active_(std::size_t(p.N * words_), 0),
        map_of_(std::size_t(p.N)) {
    chain_->set_sources(p.forcing, p.q);
  }

  GalerkinSolution run(const RowMatrix* start, Index most) {
    GalerkinSolution s;
    if (start) start_from(*start);
    std::unordered_set<std::size_t> visited;
    for (s.iterations = 1; s.iterations <= most; ++s.iterations) {
      if (asked_to_stop(options_, s)) break;
      ActiveSizes sizes;
      if (!solve_on_active_sets(p_.boundary, sizes, s.reason)) break;
      const Index flips = exchanged(sizes);
      s.history.push_back(double(flips) / double(p_.N * p_.unknowns()));
      if (options_.progress) options_.progress({s.iterations, s.history.back(), 0});
      if (flips == 0) {
        finish(s);
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
    if (s.status != Status::solved) last_values(s);
    s.how = text("active sets of all intervals exchanged %ld times, two-point problems in blocks of intervals",
                 long(s.iterations));
    s.lcp.newton = s.iterations;
    s.bytes = maps_.bytes() + chain_->bytes() + sizeof(std::uint64_t) * 2 * active_.size();
    return s;
  }

 private:
  void start_from(const RowMatrix& z) {
    for (Index k = 0; k < p_.N; ++k)
      for (Index i = 0; i < z.cols(); ++i)
        if (z(k, i) > 0) active_[std::size_t(k * words_ + i / 64)] |= std::uint64_t(1) << (i % 64);
  }

  bool solve_on_active_sets(const BoundaryCondition& boundary, ActiveSizes& sizes, std::string& reason) {
    std::size_t run = 0;
    for (Index k = 0; k < p_.N; ++k) {
      const bool begins = k == p_.runs[run].first + p_.runs[run].count;
      if (begins) ++run;
      const std::uint64_t* set = &active_[std::size_t(k * words_)];
      const bool as_before = k > 0 && !begins && std::equal(set, set + words_, set - words_);
      const int map = as_before ? map_of_[std::size_t(k - 1)] : maps_.find(run, set);
      if (map < 0) {
        reason = text("the matrix of the active set at t = %.6g is singular", p_.t[k]);
        return false;
      }
      map_of_[std::size_t(k)] = map;
    }
    chain_->set_maps(maps_.maps(), map_of_);
    if (!solve_chain(*chain_, p_.N, boundary, epsilon)) {
      reason = "on an active set the boundary condition does not determine the states";
      return false;
    }
    sizes = chain_->evaluate();
    evaluated_ = true;
    if (!sizes.finite) reason = "the iteration is not finite";
    return sizes.finite;
  }

  Index exchanged(const ActiveSizes& sizes) {
    SetWords wrong;
    chain_->wrong_signs(sign_tolerance * sizes.active, sign_tolerance * sizes.inactive, wrong);
    Index flips = 0;
    for (std::size_t i = 0; i < wrong.size(); ++i) {
      active_[i] ^= wrong[i];
      flips += std::popcount(wrong[i]);
    }
    return flips;
  }

  // z from v, and refined: where M is singular D_SS is of size h, and z loses digits that w shows.
  void finish(GalerkinSolution& s) {
    constexpr double rounding_of_slack = 1e-13;
    s.z = active_part(s.x);
    BoundaryCondition homogeneous = p_.boundary;
    homogeneous.b.setZero();
    for (int twice = 0; twice < 2; ++twice) {
      const RowMatrix slack = galerkin_slack(p_, s.z, galerkin_states(p_, s.z));
      const RowMatrix rest = on_active_sets(slack);
      if (!(rest.cwiseAbs().maxCoeff() > rounding_of_slack * std::max(1.0, slack.cwiseAbs().maxCoeff()))) break;
      chain_->set_sources(RowMatrix::Zero(p_.N, p_.states()), rest);
      ActiveSizes sizes;
      std::string reason;
      if (!solve_on_active_sets(homogeneous, sizes, reason)) break;
      RowMatrix dx;
      s.z += active_part(dx);
      s.x += dx;
    }
    s.z = (s.z.array() > 0).select(s.z, 0.0);
  }

  // z on the last active sets.
  void last_values(GalerkinSolution& s) const {
    if (evaluated_) s.z = active_part(s.x).cwiseMax(0);
    if (!evaluated_ || !s.z.allFinite()) s.z = RowMatrix::Zero(p_.N, p_.unknowns());
  }

  // v on the active sets, 0 elsewhere.
  RowMatrix active_part(RowMatrix& x) const {
    RowMatrix v;
    chain_->download(x, v);
    return on_active_sets(v);
  }
  RowMatrix on_active_sets(RowMatrix v) const {
    for (Index k = 0; k < p_.N; ++k)
      for (Index i = 0; i < v.cols(); ++i)
        if (!contains(maps_.maps()[std::size_t(map_of_[std::size_t(k)])]->active.data(), i)) v(k, i) = 0;
    return v;
  }

  std::size_t hash() const {
    std::size_t h = 0;
    for (const std::uint64_t word : active_) h = (h ^ word) * 1099511628211u;
    return h;
  }

  const GalerkinProblem& p_;
  const Options& options_;
  ActiveMaps maps_;
  std::unique_ptr<AffineChain> chain_;
  Index words_;
  SetWords active_;
  std::vector<int> map_of_;
  bool evaluated_ = false;
};

}  // namespace

GalerkinSolution exchange_active_sets(const GalerkinProblem& p, Backend& backend, const Options& options,
                                      const RowMatrix* start, Index most) {
  return Exchange(p, backend, options).run(start, most);
}

}  // namespace bromwich
