#include "core/batch/lane_march.hpp"

#include "core/base/denormals.hpp"
#include "core/base/simd.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace bromwich {

using simd::abs;
using simd::all;
using simd::any;
using simd::LaneMask;
using simd::lanes;
using simd::Lanes;
using simd::max;
using simd::min;

namespace {

// Margins below the limits of core/solve/certification.cpp.
constexpr double settled_residual = 1e-10;   ///< of 1e-9
constexpr double settled_growth = 50;        ///< of 100
constexpr double settled_rounding = 1e-6;    ///< of 1e-4
constexpr double settled_impulse = 0.08;     ///< of 0.1
constexpr double alternating_part = 0.0099;  ///< of a hundredth (core/kernel/ringing.hpp)
constexpr double alternating_run = 16;

constexpr Index most_n = largest_tabulated;

Lanes select(LaneMask mask, Lanes a, Lanes b) { return mask ? a : b; }

// Solutions of one problem matrix on the active sets that the lanes have now.
struct CurrentSets {
  const ActiveSetTable* table = nullptr;
  Lanes V[most_n * most_n];
  unsigned set[lanes] = {};
  LaneMask active[most_n];

  bool load(Index lane) {
    const Index n = table->size();
    const ActiveSetTable::Entry& entry = table->at(set[lane]);
    for (Index k = 0; k < n * n; ++k) V[k][lane] = entry.usable ? entry.V[std::size_t(k)] : 0;
    for (Index i = 0; i < n; ++i) active[i][lane] = (set[lane] >> i) & 1u ? -1 : 0;
    return entry.usable;
  }
};

// Numbers in [-1, 1] without a pattern, the same in every run.
struct Noise {
  std::uint64_t state = 20;
  double operator()() {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return double(std::int64_t(state)) * 0x1p-63;
  }
};

template <Index n>
Lanes row_times(const Lanes* V, const Lanes* q, Index i) {
  Lanes sum = V[i * n] * q[0];
  for (Index k = 1; k < n; ++k) sum += V[i * n + k] * q[k];
  return sum;
}

using Rows = RowMatrix;  // matrices of the plan, row by row

}  // namespace

struct LaneMarch::State {
  explicit State(const LanePlan& plan)
      : p(plan),
        m(plan.m),
        n(plan.n),
        J(plan.J),
        N(plan.N),
        M(plan.M),
        B(plan.B),
        G(plan.whole.E * plan.whole.R + plan.whole.L),
        size_of_E(plan.whole.E.cwiseAbs()),
        size_of_R(plan.whole.R.cwiseAbs()) {
    x.resize(std::size_t((J + 1) * m));
    y.resize(std::size_t((J + 1) * n));
  }

  Lanes* x_row(Index j) { return &x[std::size_t(j * m)]; }
  Lanes* y_row(Index j) { return &y[std::size_t(j * n)]; }

  template <Index size>
  void solve(const ActiveSetTable& table, const Lanes* q, Lanes* to);
  template <Index size>
  void solve_singly(const ActiveSetTable& table, const Lanes* q, Index lane, Lanes* value);
  template <Index size>
  void march();
  template <Index size>
  void step(const Rows& E, const Rows& L, const Rows& R, const ActiveSetTable&, const Lanes* drift, const Lanes* g,
            const Lanes* x_from, const Lanes* y_from, Lanes* x_to, Lanes* y_to);
  template <Index size>
  void take_parts(const std::vector<PartOfStep>&, Index j);
  template <Index size>
  void check();
  template <Index size>
  void check_rows();
  template <Index size>
  void check_growth();
  template <Index size>
  void check_others();
  template <Index size>
  LaneMask several(Index j);
  template <Index size>
  void take_sets(const Lanes* row);
  void start(const std::vector<const LaneInput*>&);
  void fill_sources(const std::vector<const LaneInput*>&);
  template <Index size>
  void run();

  const LanePlan& p;
  Index m, n, J;
  Rows N, M, B, G, size_of_E, size_of_R;
  std::vector<Lanes> x, y, own_drift, own_g, own_f;
  CurrentSets now;  ///< of the march, then of the check
  bool lost[lanes], used[lanes], other[lanes];
  Lanes residual, largest_x[most_lane_states];
  char known[1 << most_n] = {};  ///< 1: resolved, 2: oscillates

  Lanes drift_at(Index j, Index i) const {
    return own_drift.empty() ? all(p.drift(j, i)) : own_drift[std::size_t(j * m + i)];
  }
  Lanes f_at(Index j, Index i) const { return own_drift.empty() ? all(p.f(j, i)) : own_f[std::size_t(j * m + i)]; }
  Lanes g_at(Index j, Index i) const { return own_g.empty() ? all(p.g(j, i)) : own_g[std::size_t(j * n + i)]; }
};

// The lanes whose set has a value of the wrong sign are solved one by one.
template <Index size>
void LaneMarch::State::solve(const ActiveSetTable& table, const Lanes* q, Lanes* to) {
  if (now.table != &table) {
    now.table = &table;
    for (Index l = 0; l < lanes; ++l) lost[l] |= !now.load(l);
  }
  Lanes value[most_n], least = all(0), largest = all(0);
  for (Index i = 0; i < size; ++i) {
    value[i] = row_times<size>(now.V, q, i);
    least = min(least, value[i]);
    largest = max(largest, abs(q[i]) * table.row_scale(i));
  }
  const LaneMask wrong = least < largest * (-16 * epsilon);
  if (any(wrong))
    for (Index l = 0; l < lanes; ++l)
      if (wrong[l] && !lost[l]) solve_singly<size>(table, q, l, value);
  for (Index i = 0; i < size; ++i)
    to[i] = Lanes(LaneMask(max(value[i] * table.column_scale(i), all(0))) & now.active[i]);
}

template <Index size>
void LaneMarch::State::solve_singly(const ActiveSetTable& table, const Lanes* q, Index lane, Lanes* value) {
  double given[most_n], found[most_n];
  for (Index i = 0; i < size; ++i) given[i] = q[i][lane];
  unsigned set = now.set[lane];
  if (!table.solve(given, set, found)) {
    lost[lane] = true;
    return;
  }
  if (set != now.set[lane]) {
    now.set[lane] = set;
    now.load(lane);
  }
  for (Index i = 0; i < size; ++i) value[i][lane] = found[i];
}

template <Index size>
void LaneMarch::State::step(const Rows& E, const Rows& L, const Rows& R, const ActiveSetTable& table,
                            const Lanes* drift, const Lanes* g, const Lanes* x_from, const Lanes* y_from, Lanes* x_to,
                            Lanes* y_to) {
  Lanes free[most_lane_states], q[most_n];
  for (Index i = 0; i < m; ++i) {
    Lanes sum = drift[i], more = L(i, 0) * y_from[0];
    for (Index k = 0; k < m; ++k) sum += E(i, k) * x_from[k];
    for (Index k = 1; k < size; ++k) more += L(i, k) * y_from[k];
    free[i] = sum + more;
  }
  for (Index i = 0; i < size; ++i) {
    q[i] = g[i];
    for (Index k = 0; k < m; ++k) q[i] += N(i, k) * free[k];
  }
  solve<size>(table, q, y_to);
  for (Index i = 0; i < m; ++i) {
    Lanes sum = R(i, 0) * y_to[0];
    for (Index k = 1; k < size; ++k) sum += R(i, k) * y_to[k];
    x_to[i] = free[i] + sum;
  }
}

template <Index size>
void LaneMarch::State::march() {
  const Rows E = p.whole.E, L = p.whole.L, R = p.whole.R;
  auto rough = p.parts.begin();
  Lanes drift[most_lane_states], g[most_n];
  for (Index j = 1; j <= J; ++j) {
    if (rough != p.parts.end() && rough->first == j) {
      take_parts<size>(rough->second, j);
      ++rough;
      continue;
    }
    for (Index i = 0; i < m; ++i) drift[i] = drift_at(j, i);
    for (Index i = 0; i < size; ++i) g[i] = g_at(j, i);
    step<size>(E, L, R, *p.whole.problem, drift, g, x_row(j - 1), y_row(j - 1), x_row(j), y_row(j));
  }
}

template <Index size>
void LaneMarch::State::take_parts(const std::vector<PartOfStep>& parts, Index j) {
  Lanes *to_x = x_row(j), *to_y = y_row(j), drift[most_lane_states], g[most_n];
  std::copy(x_row(j - 1), x_row(j - 1) + m, to_x);
  std::copy(y_row(j - 1), y_row(j - 1) + size, to_y);
  for (const PartOfStep& part : parts) {
    for (Index i = 0; i < size; ++i) g[i] = all(part.g[i]);
    if (part.moves) {
      for (Index i = 0; i < m; ++i) drift[i] = all(part.drift[i]);
      step<size>(part.maps->E, part.maps->L, part.maps->R, *part.maps->problem, drift, g, to_x, to_y, to_x, to_y);
      continue;
    }
    for (Index i = 0; i < size; ++i)
      for (Index k = 0; k < m; ++k) g[i] += N(i, k) * to_x[k];
    solve<size>(*part.maps->problem, g, to_y);
  }
}

// Residual, alternating y and the sizes of the states.
template <Index size>
void LaneMarch::State::check_rows() {
  Lanes largest_y[size], before[size], run[size], worst = all(0);
  for (Index i = 0; i < size; ++i) largest_y[i] = before[i] = run[i] = all(0);
  for (Index i = 0; i < m; ++i) largest_x[i] = all(0);
  Lanes finite = all(0);
  for (Index j = 0; j <= J; ++j) {
    const Lanes *xj = x_row(j), *yj = y_row(j);
    Lanes missed = all(0), scale = all(1);
    for (Index i = 0; i < m; ++i) largest_x[i] = max(largest_x[i], abs(xj[i]));
    for (Index i = 0; i < size; ++i) {
      Lanes q = g_at(j, i);
      for (Index k = 0; k < m; ++k) q += N(i, k) * xj[k];
      Lanes w = q;
      for (Index k = 0; k < size; ++k) w += M(i, k) * yj[k];
      finite += 0 * w;
      missed = max(missed, abs(min(yj[i], w)));
      scale = max(scale, abs(q));
      largest_y[i] = max(largest_y[i], yj[i]);
    }
    worst = max(worst, missed / scale);
  }
  residual = worst + finite;
  Lanes longest = all(0);
  for (Index j = 1; j < J; ++j)
    for (Index i = 0; i < size; ++i) {
      const Lanes bend = y_row(j - 1)[i] - 2 * y_row(j)[i] + y_row(j + 1)[i];
      const LaneMask on = (abs(bend) > alternating_part * largest_y[i]) & (bend * before[i] < 0);
      run[i] = select(on, run[i] + 1, all(0));
      before[i] = bend;
      longest = max(longest, run[i]);
    }
  for (Index l = 0; l < lanes; ++l) lost[l] |= !(residual[l] <= settled_residual) || longest[l] >= alternating_run;
}

template <Index size>
void LaneMarch::State::take_sets(const Lanes* row) {
  for (Index l = 0; l < lanes; ++l) {
    unsigned set = 0;
    for (Index i = 0; i < size; ++i) set |= row[i][l] > 0 ? 1u << i : 0u;
    if (!known[set]) known[set] = p.oscillates(set) ? 2 : 1;
    lost[l] |= known[set] == 2;
    if (set == now.set[l] && now.table == p.whole.problem.get()) continue;
    now.set[l] = set;
    if (!lost[l]) lost[l] |= !now.load(l);
  }
}

// core/accuracy/magnification.hpp: a perturbation, and what rounding makes of the solution.
template <Index size>
void LaneMarch::State::check_growth() {
  const Rows E = p.whole.E;
  Lanes inverse[most_lane_states], dz[most_lane_states], first[most_lane_states], error[most_lane_states];
  Lanes largest = all(1e-290), size2 = all(0), norm2 = all(0);
  for (Index i = 0; i < m; ++i) largest = max(largest, largest_x[i]);
  const Lanes* x0 = x_row(0);
  for (Index i = 0; i < m; ++i) {
    inverse[i] = 1 / max(largest_x[i], 1e-12 * largest);
    const double part = std::cos(1.0 + 2.399963 * double(i));
    first[i] = part * largest_x[i];
    error[i] = epsilon * part * x0[i];
    norm2 += (first[i] * inverse[i]) * (first[i] * inverse[i]);
    size2 += (x0[i] * inverse[i]) * (x0[i] * inverse[i]);
  }
  for (Index i = 0; i < m; ++i) dz[i] = first[i];
  Lanes least2 = norm2, last2 = norm2, most2 = all(1), rounding2 = all(0), impulse2 = all(0);
  const Lanes first2 = norm2;
  Noise noise;
  const auto impulse_of = [&](Index j, Lanes of2) {
    Lanes sum = all(0);
    for (Index i = 0; i < m; ++i) {
      Lanes b = B(i, 0) * y_row(j)[0];
      for (Index k = 1; k < size; ++k) b += B(i, k) * y_row(j)[k];
      sum += (b * inverse[i]) * (b * inverse[i]);
    }
    return select(of2 > 0, p.h * p.h * sum / of2, all(0));
  };
  now.table = p.whole.problem.get();
  for (Index l = 0; l < lanes; ++l) now.set[l] = ~0u;  // none
  bool fresh = true;
  for (Index j = 1; j <= J; ++j) {
    const Lanes *xj = x_row(j), *xb = x_row(j - 1), *yj = y_row(j), *yb = y_row(j - 1);
    LaneMask changed = all(0) != all(0);
    for (Index i = 0; i < size; ++i) changed |= (yj[i] > 0) ^ (yb[i] > 0);
    const Lanes before2 = size2;
    Lanes seen[size], seen_error[size], u[size], v[size], next[most_lane_states], next_error[most_lane_states];
    if (fresh || any(changed)) take_sets<size>(yj);
    fresh = false;
    for (Index i = 0; i < size; ++i) {
      seen[i] = N(i, 0) * dz[0];
      seen_error[i] = N(i, 0) * error[0];
      for (Index k = 1; k < m; ++k) {
        seen[i] += N(i, k) * dz[k];
        seen_error[i] += N(i, k) * error[k];
      }
    }
    for (Index i = 0; i < size; ++i) {
      const double c = now.table->column_scale(i);
      u[i] = Lanes(LaneMask(c * row_times<size>(now.V, seen, i)) & now.active[i]);
      v[i] = Lanes(LaneMask(c * row_times<size>(now.V, seen_error, i)) & now.active[i]);
    }
    Lanes now2 = all(0), error2 = all(0), x2 = all(0);
    for (Index i = 0; i < m; ++i) {
      Lanes a = G(i, 0) * u[0], b = G(i, 0) * v[0], terms = abs(xj[i]) + abs(drift_at(j, i));
      for (Index k = 1; k < size; ++k) a += G(i, k) * u[k], b += G(i, k) * v[k];
      for (Index k = 0; k < size; ++k) terms += size_of_R(i, k) * yj[k];
      for (Index k = 0; k < m; ++k) {
        a += E(i, k) * dz[k], b += E(i, k) * error[k];
        terms += size_of_E(i, k) * abs(xb[k]);
      }
      next[i] = a;
      next_error[i] = b + (2 * epsilon * noise()) * terms;
      const Lanes of_a = a * inverse[i], of_e = next_error[i] * inverse[i], of_x = xj[i] * inverse[i];
      now2 += of_a * of_a, error2 += of_e * of_e, x2 += of_x * of_x;
    }
    size2 = max(size2, x2);
    rounding2 = max(rounding2, select(size2 > 0, 4 * error2 / size2, all(0)));
    const LaneMask gone = now2 < 1e-28 * last2;
    for (Index i = 0; i < m; ++i) dz[i] = select(gone, first[i], next[i]), error[i] = next_error[i];
    now2 = select(gone, first2, now2);
    least2 = select(gone, first2, min(least2, now2));
    most2 = max(most2, select(least2 > 0, now2 / least2, all(1)));
    if (const LaneMask small = now2 < 1e-200; any(small)) {  // out of the range of squares
      const Lanes by = select(small & (now2 > 0), all(1e80), all(1));
      for (Index i = 0; i < m; ++i) dz[i] *= by;
      now2 *= by * by, least2 *= by * by;
    }
    last2 = now2;
    if (!any(changed)) continue;
    if (j < J) impulse2 = select(changed, max(impulse2, impulse_of(j, size2)), impulse2);
    if (j > 1) impulse2 = select(changed, max(impulse2, impulse_of(j - 1, before2)), impulse2);
  }
  for (Index l = 0; l < lanes; ++l)
    lost[l] |= !(most2[l] <= settled_growth * settled_growth) ||
               !(rounding2[l] <= settled_rounding * settled_rounding) ||
               (p.surely_P && !(impulse2[l] <= settled_impulse * settled_impulse));
}

// Whether the step of implicit Euler to row j has two solutions, or nearly so.
template <Index size>
LaneMask LaneMarch::State::several(Index j) {
  constexpr double loose = 1e-8, apart = 5e-7;
  Lanes q[size], from[most_lane_states], solution[size];
  for (Index k = 0; k < m; ++k) from[k] = x_row(j - 1)[k] + p.h * f_at(j, k);
  for (Index i = 0; i < size; ++i) {
    q[i] = g_at(j, i);
    for (Index k = 0; k < m; ++k) q[i] += p.euler->seen(i, k) * from[k];
    solution[i] = all(0);
  }
  LaneMask found = all(0) != all(0), two = found;
  for (std::size_t set = 0; set < p.euler->V.size(); ++set) {
    const RowMatrix& V = p.euler->V[set];
    Lanes value[size];
    LaneMask may = all(0) == all(0);
    for (Index i = 0; i < size && any(may); ++i) {
      Lanes sum = all(0), terms = all(0);
      for (Index k = 0; k < size; ++k) {
        sum += V(i, k) * q[k];
        terms += std::abs(V(i, k)) * abs(q[k]);
      }
      value[i] = sum;
      may &= sum >= -loose * terms;
    }
    if (!any(may)) continue;
    Lanes distance = all(0), scale = all(0);
    for (Index i = 0; i < size; ++i) {
      const Lanes y = (set >> i) & 1u ? value[i] : all(0);
      distance = max(distance, abs(y - solution[i]));
      scale = max(scale, max(abs(y), abs(solution[i])));
      solution[i] = select(may & ~found, y, solution[i]);
    }
    two |= may & found & (distance > apart * scale);
    found |= may;
  }
  return two;
}

// At the rows where core/accuracy/other_solution.cpp looks, of any lane. Lanes with two solutions there are left to it.
template <Index size>
void LaneMarch::State::check_others() {
  constexpr Index most_rows = 24;
  const Index stride = std::max<Index>(1, J / (most_rows / 2));
  Index changes[lanes] = {};
  for (Index j = 1; j <= J; ++j) {
    bool look = j == 1 || j % stride == 0;
    LaneMask changed = all(0) != all(0);
    for (Index i = 0; i < size && j > 1; ++i) changed |= (y_row(j)[i] > 0) ^ (y_row(j - 1)[i] > 0);
    if (j > 1 && any(changed))
      for (Index l = 0; l < lanes; ++l)
        if (changed[l] && !lost[l] && !other[l]) look |= ++changes[l] <= most_rows / 2;
    if (!look) continue;
    const LaneMask two = several<size>(j);
    for (Index l = 0; l < lanes; ++l) lost[l] |= two[l] && !other[l];
  }
}

template <Index size>
void LaneMarch::State::check() {
  check_rows<size>();
  if (std::all_of(lost, lost + lanes, [](bool l) { return l; })) return;
  check_growth<size>();
  bool open = false;  // a lane whose other solutions are not known yet
  for (Index l = 0; l < lanes; ++l) open |= used[l] && !lost[l] && !other[l];
  if (p.euler && open) check_others<size>();
}

// x0 and y_0, lane by lane. Lanes without a scene repeat the first one.
void LaneMarch::State::start(const std::vector<const LaneInput*>& inputs) {
  now.table = nullptr;
  Vector y0(n), q(n);
  for (Index l = 0; l < lanes; ++l) {
    used[l] = l < Index(inputs.size());
    other[l] = false;
    const LaneInput& input = *inputs[std::size_t(used[l] ? l : 0)];
    for (Index i = 0; i < m; ++i) x[std::size_t(i)][l] = input.x0[i];
    for (Index i = 0; i < n; ++i) q[i] = g_at(0, i)[l];
    const Vector start = N * input.x0 + q, terms = N.cwiseAbs() * input.x0.cwiseAbs() + q.cwiseAbs();
    const double share = 4 * double(m + 1) * epsilon;  // as core/march/outcome.cpp
    for (Index i = 0; i < n; ++i) q[i] = start[i] < 0 && start[i] >= -share * terms[i] ? 0 : start[i];
    double value[most_n] = {};
    unsigned set = 0;
    lost[l] = !p.at_zero->solve(q.data(), set, value);
    for (Index i = 0; i < n; ++i)
      y0[i] = (set >> i) & 1u && !lost[l] ? std::max(p.at_zero->column_scale(i) * value[i], 0.0) : 0;
    for (Index i = 0; i < n; ++i) y[std::size_t(i)][l] = y0[i];
    now.set[l] = 0;
    for (Index i = 0; i < n; ++i) now.set[l] |= y0[i] > 0 ? 1u << i : 0u;
    if (p.others && used[l] && !lost[l]) other[l] = p.others->any(start, y0);
  }
}

void LaneMarch::State::fill_sources(const std::vector<const LaneInput*>& inputs) {
  const auto fill = [&](const RowMatrix LaneInput::*table, Index width, std::vector<Lanes>& to) {
    if ((inputs[0]->*table).size() == 0) return to.clear();
    to.resize(std::size_t((J + 1) * width));
    for (Index l = 0; l < lanes; ++l) {
      const double* from = (inputs[std::size_t(l < Index(inputs.size()) ? l : 0)]->*table).data();
      for (Index k = 0; k < (J + 1) * width; ++k) to[std::size_t(k)][l] = from[k];
    }
  };
  fill(&LaneInput::drift, m, own_drift);
  fill(&LaneInput::g, n, own_g);
  fill(&LaneInput::f, m, own_f);
}

template <Index size>
void LaneMarch::State::run() {
  march<size>();
  check<size>();
}

LaneMarch::LaneMarch(const LanePlan& plan) : s_(std::make_unique<State>(plan)) {}
LaneMarch::~LaneMarch() = default;

void LaneMarch::run(const std::vector<const LaneInput*>& inputs, std::vector<LaneOutcome>& outcomes) {
  const FlushDenormals flush;
  State& s = *s_;
  s.fill_sources(inputs);
  s.start(inputs);
  using Run = void (State::*)();
  constexpr Run run_of[] = {&State::run<1>, &State::run<2>, &State::run<3>, &State::run<4>,
                            &State::run<5>, &State::run<6>, &State::run<7>, &State::run<8>};
  static_assert(std::size(run_of) == largest_tabulated);
  (s.*run_of[s.n - 1])();
  outcomes.resize(inputs.size());
  for (std::size_t l = 0; l < inputs.size(); ++l) outcomes[l] = {!s.lost[l], s.other[l], s.residual[Index(l)]};
}

void LaneMarch::write_y(Index lane, Eigen::Ref<RowMatrix> y) const {
  const State& s = *s_;
  double* to = y.data();
  const double* from = reinterpret_cast<const double*>(s.y.data()) + lane;
  for (Index k = 0; k < (s.J + 1) * s.n; ++k) to[k] = from[k * lanes];
}

void LaneMarch::write_x(Index lane, const std::vector<Index>& components, Eigen::Ref<RowMatrix> x) const {
  const State& s = *s_;
  const double* from = reinterpret_cast<const double*>(s.x.data()) + lane;
  for (Index j = 0; j <= s.J; ++j)
    for (std::size_t c = 0; c < components.size(); ++c) x(j, Index(c)) = from[(j * s.m + components[c]) * lanes];
}

void LaneMarch::write_w(Index lane, Eigen::Ref<RowMatrix> w) const {
  const State& s = *s_;
  const double *x = reinterpret_cast<const double*>(s.x.data()) + lane,
               *y = reinterpret_cast<const double*>(s.y.data()) + lane;
  for (Index j = 0; j <= s.J; ++j)
    for (Index i = 0; i < s.n; ++i) {
      double sum = s.g_at(j, i)[lane];
      for (Index k = 0; k < s.m; ++k) sum += s.N(i, k) * x[(j * s.m + k) * lanes];
      for (Index k = 0; k < s.n; ++k) sum += s.M(i, k) * y[(j * s.n + k) * lanes];
      w(j, i) = sum;
    }
}

}  // namespace bromwich
