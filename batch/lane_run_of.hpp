#pragma once
// The definition of run_lanes, for the files that instantiate it.

#include "../core/base/error.hpp"
#include "lane_run.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <type_traits>

namespace bromwich {

namespace lane_run {

using scene_steps::Arithmetic;
using scene_steps::Matrices;
using scene_steps::Rows;
using simd::LaneMask;
using simd::Lanes;

// Matrices row by row, of the first lane or of all.
template <class C>
struct Tables {
  std::vector<C> E, L, R, N, M, B, growth_E, growth_G, size_of_E, size_of_R, y_unit, w_unit, seen, V;

  template <class Of>
  void fill(std::vector<C>& to, const LaneState& s, const Of& of) {
    for (Index l = 0; l < (std::is_same_v<C, double> ? 1 : simd::lanes); ++l) {
      const RowMatrix matrix = of(s.plan(l));
      to.resize(std::size_t(matrix.size()));
      for (Index k = 0; k < matrix.size(); ++k)
        if constexpr (std::is_same_v<C, double>)
          to[std::size_t(k)] = matrix.data()[k];
        else
          to[std::size_t(k)][l] = matrix.data()[k];
    }
  }

  explicit Tables(const LaneState& s) {
    fill(E, s, [](const LanePlan& p) { return p.whole.E; });
    fill(L, s, [](const LanePlan& p) { return p.whole.L; });
    fill(R, s, [](const LanePlan& p) { return p.whole.R; });
    fill(N, s, [](const LanePlan& p) { return p.N; });
    fill(M, s, [](const LanePlan& p) { return p.M; });
    fill(B, s, [](const LanePlan& p) { return p.B; });
    fill(growth_E, s, [](const LanePlan& p) { return p.growth().E; });
    fill(growth_G, s, [](const LanePlan& p) { return p.growth().G; });
    fill(size_of_E, s, [](const LanePlan& p) { return Matrix(p.growth().E.cwiseAbs()); });
    fill(size_of_R, s, [](const LanePlan& p) { return Matrix(p.growth().R.cwiseAbs()); });
    fill(y_unit, s, [](const LanePlan& p) { return units(p.units.y, p.n); });
    fill(w_unit, s, [](const LanePlan& p) { return units(p.units.w, p.n); });
  }

  static Vector units(const std::vector<int>& k, Index n) {
    Vector all = Vector::Ones(n);
    for (Index i = 0; i < n && !k.empty(); ++i) all[i] = times_ten_to(k[std::size_t(i)], 1);
    return all;
  }

  // Of implicit Euler, in lanes that have it.
  void add_euler(const LaneState& s) {
    const Index sets = Index(1) << s.n;
    fill(seen, s, [&](const LanePlan& p) { return p.euler ? p.euler->seen : Matrix(Matrix::Zero(s.n, s.m)); });
    fill(V, s, [&](const LanePlan& p) {
      RowMatrix all = RowMatrix::Zero(sets * s.n, s.n);
      for (Index set = 0; p.euler && set < sets; ++set) all.middleRows(set * s.n, s.n) = p.euler->V[std::size_t(set)];
      return all;
    });
  }

  Matrices<const C*> view(const LanePlan& p) const {
    Matrices<const C*> v;
    v.m = p.m, v.J = p.J, v.h = p.h;
    v.E = E.data(), v.L = L.data(), v.R = R.data(), v.N = N.data(), v.M = M.data(), v.B = B.data();
    v.growth_E = growth_E.data(), v.growth_G = growth_G.data();
    v.size_of_E = size_of_E.data(), v.size_of_R = size_of_R.data();
    v.y_unit = y_unit.data(), v.w_unit = w_unit.data();
    v.surely_P = p.surely_P, v.stages = p.stages, v.most_growth = p.most_growth;
    return v;
  }
};

template <class Get>
LaneProblem::Tables tables_of(const LaneState& s, const Get& get) {
  LaneProblem::Tables tables;
  for (Index l = 0; l < simd::lanes; ++l) tables[std::size_t(l)] = get(s.plan(l));
  return tables;
}

template <Index n, class C>
class Run {
  using Steps = scene_steps::Steps<0, n, Lanes, const C*>;

 public:
  explicit Run(LaneState& s)
      : s_(s),
        p_(s.plan(0)),
        tables_(s),
        view_(tables_.view(p_)),
        sources_(s.sources()),
        steps_{view_, {s.x.data(), s.m, 1}, {s.y.data(), n, 1}, sources_.drift, sources_.g, sources_.growth_drift} {
    for (Index i = 0; i < s.m; ++i) part_[i] = std::cos(1.0 + 2.399963 * double(i));
    view_.part = part_;
  }

  void operator()() {
    LaneProblem problem;
    for (Index l = 0; l < simd::lanes; ++l) {
      unsigned set = 0;
      for (Index i = 0; i < n; ++i) set |= s_.y[std::size_t(i)][l] > 0 ? 1u << i : 0u;
      problem.start_from(l, p_.stages ? 0 : set);
    }
    if (p_.stages)
      march_stages(problem);
    else
      march(problem);
    check();
  }

 private:
  void march(LaneProblem& problem) {
    const auto whole = tables_of(s_, [](const LanePlan& p) { return p.whole.problem.get(); });
    problem.use(whole, s_.lost);
    auto rough = p_.parts.begin();
    steps_.march(problem, s_.lost, [&](Index j, Lanes* xs, Lanes* ys) {
      if (rough == p_.parts.end() || rough->first != j) return false;
      if constexpr (std::is_same_v<C, double>) take_parts(rough->second, problem, xs, ys);
      problem.use(whole, s_.lost);
      ++rough;
      return true;
    });
  }

  void take_parts(const std::vector<PartOfStep>& parts, LaneProblem& problem, Lanes* xs, Lanes* ys) {
    Lanes drift[most_lane_states], g[n];
    for (const PartOfStep& part : parts) {
      LaneProblem::Tables same;
      same.fill(part.maps->problem.get());
      problem.use(same, s_.lost);
      for (Index i = 0; i < n; ++i) g[i] = simd::all(part.g[i]);
      if (part.moves) {
        const RowMatrix E = part.maps->E, L = part.maps->L, R = part.maps->R;
        for (Index i = 0; i < s_.m; ++i) drift[i] = simd::all(part.drift[i]);
        if constexpr (std::is_same_v<C, double>)
          steps_.step(E.data(), L.data(), R.data(), drift, g, xs, ys, xs, ys, problem, s_.lost);
        continue;
      }
      for (Index i = 0; i < n; ++i)
        for (Index k = 0; k < s_.m; ++k) g[i] += view_.N[i * s_.m + k] * xs[k];
      problem.template solve<n>(g, ys, s_.lost);
    }
  }

  void march_stages(LaneProblem& problem) {
    if constexpr (2 * n <= largest_tabulated) {
      problem.certain = p_.certain;
      problem.use(tables_of(s_, [](const LanePlan& p) { return p.whole.problem.get(); }), s_.lost);
      steps_.march_stages(
          problem, s_.rigid(), s_.lost,
          [&](Index j, LaneMask odd, const Lanes* from, Lanes* to, Lanes* ys, Lanes* regular, LaneMask& lost) {
            for (Index l = 0; l < simd::lanes; ++l)
              if (odd[l] && !take_singly(l, j, from, to, ys, regular)) lost[l] = -1;
          });
    }
  }

  // As a single solve takes the step.
  bool take_singly(Index l, Index j, const Lanes* from, Lanes* to, Lanes* ys, Lanes* regular) {
    host::StageSteps& steps = s_.steps_of(l);
    Vector x(s_.m), next(s_.m), y(n);
    for (Index i = 0; i < s_.m; ++i) x[i] = from[i][l];
    for (Index i = 0; i < n; ++i) y[i] = s_.y[std::size_t((j - 1) * n + i)][l];
    if (j == 1) steps.start(x, y, s_.plan(l).N * x);
    for (Index i = 0; i < n; ++i) {
      if (j > 1) steps.touching[std::size_t(i)] = y[i] > 0;
      steps.regular[i] = regular[i][l];
    }
    MarchReport report;
    const host::Stepper* used = steps.take(x, j, next, report);
    if (!used) return false;
    const Vector end = used->last_stage();
    for (Index i = 0; i < s_.m; ++i) to[i][l] = next[i];
    for (Index i = 0; i < n; ++i) {
      ys[i][l] = end[i];
      if (used->stages() == 2) regular[i][l] = std::max(regular[i][l], end[i]);
    }
    return true;
  }

  void check() {
    Lanes largest_x[most_lane_states];
    s_.residual = steps_.check_rows(sources_.at_points, largest_x, s_.lost);
    if (!simd::any(~s_.lost)) return;
    LaneProblem problem;
    problem.longest = [&](Index l, unsigned set) { return s_.plan(l).longest(set); };
    LaneMask none = {};
    problem.use(tables_of(s_, [](const LanePlan& p) { return p.growth().problem; }), none);
    steps_.check_growth(problem, largest_x, s_.lost);
    bool looks = false;  // at lanes whose other solutions are not known yet
    for (Index l = 0; l < s_.used; ++l) looks |= s_.plan(l).euler && !s_.lost[l] && !s_.other[l];
    if (!looks) return;
    tables_.add_euler(s_);
    LaneMask known = s_.other;
    for (Index l = 0; l < simd::lanes; ++l)
      if (!s_.plan(l).euler) known[l] = -1;
    steps_.check_others(tables_.seen.data(), tables_.V.data(), sources_.at_points, sources_.f, known, s_.lost);
  }

  LaneState& s_;
  const LanePlan& p_;
  Tables<C> tables_;
  Matrices<const C*> view_;
  LaneState::Sources sources_;
  Steps steps_;
  double part_[most_lane_states];
};

template <Index n, class C>
void run_of(LaneState& s) {
  Run<n, C> run(s);
  run();
}

}  // namespace lane_run

template <class C>
void run_lanes(LaneState& s) {
  using namespace lane_run;
  using Call = void (*)(LaneState&);
  constexpr Call calls[] = {run_of<1, C>, run_of<2, C>, run_of<3, C>, run_of<4, C>,
                            run_of<5, C>, run_of<6, C>, run_of<7, C>, run_of<8, C>};
  static_assert(std::size(calls) == largest_tabulated);
  calls[s.n - 1](s);
}

}  // namespace bromwich
