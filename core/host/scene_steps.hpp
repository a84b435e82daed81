#pragma once
// The steps of small dense scenes and the checks of their rows, in numbers of any kind. A double is one scene, in a
// thread of a device; a vector of doubles has a scene in each lane (batch/lane_march.hpp). Nothing is allocated.
//
// Continuous y, linear between time points (core/march/marching.cpp):
//
//     x~ = E x_{j-1} + L y_{j-1} + d_j,   y_j in SOL(M + N R, N x~ + g_j),   x_j = x~ + R y_j.
//
// Stages of Radau IIA, Y = (y at the first stage, y at the end), D = diag(3/4, 1/4) (core/host/stage_stepper.hpp):
//
//     q = S x_{j-1} + g_j,   Y in SOL(D (I ⊗ M + W), D q),   x_j = E x_{j-1} + d_j + R Y.
//
// symbol     member              shape            meaning
// E, L, R    E, L, R             m x m, m x n,    of a step; with stages R is m x 2n, and L is S, 2n x m
//                                m x n
// d_j, g_j   drift, g            m, n             contribution of f, source; with stages g has 2n entries
//            Problem                              solves LCP(q) by stored inverses on active sets
//
// A `Problem` has solve<n>(q, y, lost) and try_stages<2n>(q, Y, uncertain); take<n>(y, lost), which takes the active
// set of a row; respond<n>(v, u), u = V v on that set; lasts(run, lost), which knows for how long that set may last.

#include "scene_numbers.hpp"

#include <type_traits>

namespace bromwich::scene_steps {

/// `fixed`: m where it is known to the compiler, otherwise 0. `Table`: of the matrices.
template <Index fixed, Index n, class Number, class Table>
struct Steps {
  using A = Arithmetic<Number>;
  using Mask = typename A::Mask;
  using Given = Source<Number, std::conditional_t<std::is_same_v<Table, const double*>, const Number*, Table>>;
  static constexpr Index room = fixed > 0 ? fixed : most_states;

  const Matrices<Table>& s;
  Rows<Number> x, y;
  Given drift, g, growth_drift;
  constexpr Index m() const { return fixed > 0 ? fixed : s.m; }

  static constexpr Number none() { return A::all(0); }
  static constexpr Mask no_lane() { return none() != none(); }

  // ---- Continuous y.

  template <class Problem>
  constexpr void step(Table E, Table L, Table R, const Number* d, const Number* given, const Number* x_from,
                      const Number* y_from, Number* x_to, Number* y_to, Problem& problem, Mask& lost) const {
    Number free[room], q[n];
    for (Index i = 0; i < m(); ++i) {
      Number sum = d[i], more = L[i * n] * y_from[0];
      for (Index k = 0; k < m(); ++k) sum += E[i * m() + k] * x_from[k];
      for (Index k = 1; k < n; ++k) more += L[i * n + k] * y_from[k];
      free[i] = sum + more;
    }
    for (Index i = 0; i < n; ++i) {
      q[i] = given[i];
      for (Index k = 0; k < m(); ++k) q[i] += s.N[i * m() + k] * free[k];
    }
    problem.template solve<n>(q, y_to, lost);
    for (Index i = 0; i < m(); ++i) {
      Number sum = R[i * n] * y_to[0];
      for (Index k = 1; k < n; ++k) sum += R[i * n + k] * y_to[k];
      x_to[i] = free[i] + sum;
    }
  }

  /// Row 0 holds x0 and y_0. `rough(j, x, y)`: takes step j itself where it returns true.
  template <class Problem, class Rough>
  constexpr void march(Problem& problem, Mask& lost, const Rough& rough) const {
    Number xs[room], ys[n], d[room], given[n];
    for (Index i = 0; i < m(); ++i) xs[i] = x(0, i);
    for (Index i = 0; i < n; ++i) ys[i] = y(0, i);
    for (Index j = 1; j <= s.J; ++j) {
      if (!rough(j, xs, ys)) {
        for (Index i = 0; i < m(); ++i) d[i] = drift(j, i);
        for (Index i = 0; i < n; ++i) given[i] = g(j, i);
        step(s.E, s.L, s.R, d, given, xs, ys, xs, ys, problem, lost);
      }
      for (Index i = 0; i < m(); ++i) x(j, i) = xs[i];
      for (Index i = 0; i < n; ++i) y(j, i) = ys[i];
    }
  }

  // ---- Stages. `g` has 2n entries a row. `rigid`: bits of the constraints on a position (core/host/stage_steps.hpp).

  /// `irregular(j, mask, x_from, x_to, y_to, regular)` takes the step to j in the lanes of the mask. `regular` is the
  /// largest y_i at the ends of steps without jumps.
  template <class Problem, class Irregular>
  constexpr void march_stages(Problem& problem, unsigned rigid, Mask& lost, const Irregular& irregular) const {
    Number xs[room], next[room], ys[n], q[2 * n], Y[2 * n], regular[n];
    for (Index i = 0; i < m(); ++i) xs[i] = x(0, i);
    for (Index i = 0; i < n; ++i) regular[i] = ys[i] = y(0, i);
    for (Index j = 1; j <= s.J; ++j) {
      Number least = A::all(1e300);
      for (Index i = 0; i < 2 * n; ++i) {
        q[i] = g(j, i);
        for (Index k = 0; k < m(); ++k) q[i] += s.L[i * m() + k] * xs[k];
        least = A::min(least, q[i]);
        q[i] *= i < n ? 0.75 : 0.25;
      }
      for (Index i = 0; i < m(); ++i) {
        next[i] = drift(j, i);
        for (Index k = 0; k < m(); ++k) next[i] += s.E[i * m() + k] * xs[k];
      }
      const Mask rests = least >= 0;
      Mask odd = no_lane();
      for (Index i = 0; i < 2 * n; ++i) Y[i] = none();
      if (A::any(A::no(rests | lost))) {
        problem.template try_stages<2 * n>(q, Y, odd);
        Number most = none();
        for (Index i = 0; i < 2 * n; ++i) {
          Y[i] = A::select(rests, none(), Y[i]);
          most = A::max(most, Y[i]);
        }
        for (Index i = 0; i < n; ++i)
          if (rigid >> i & 1u) {
            const Mask active = A::max(Y[i], Y[n + i]) > 0;
            odd |= active & (j == 1 ? A::no(no_lane()) : A::no(ys[i] > 0));
          }
      }
      for (Index i = 0; i < m(); ++i)
        for (Index k = 0; k < 2 * n; ++k) next[i] += s.R[i * 2 * n + k] * Y[k];
      odd |= may_jump(Y, regular, xs, next);
      odd &= A::no(rests | lost);
      for (Index i = 0; i < n; ++i) {
        ys[i] = Y[n + i];
        regular[i] = A::select(odd, regular[i], A::max(regular[i], ys[i]));
      }
      if (A::any(odd)) irregular(j, odd, xs, next, ys, regular, lost);
      for (Index i = 0; i < m(); ++i) x(j, i) = xs[i] = next[i];
      for (Index i = 0; i < n; ++i) y(j, i) = ys[i];
    }
  }

  /// Whether StageSteps might see a jump of the state: y_i is released within the step, and is large or moves a state.
  constexpr Mask may_jump(const Number* Y, const Number* regular, const Number* before, const Number* after) const {
    constexpr double margin = 0.999;
    Number most = none(), released[n], size[room], largest = none();
    for (Index i = 0; i < 2 * n; ++i) most = A::max(most, Y[i]);
    Mask any = no_lane(), jumps = any;
    for (Index i = 0; i < n; ++i) {
      const Mask here = (Y[i] > margin * 1e-9 * most) & (margin * Y[n + i] <= 1e-9 * most);
      released[i] = A::select(here, Y[i], none());
      jumps |= here & (Y[i] > margin * 4 * regular[i]);
      any |= here;
    }
    if (!A::any(any)) return any;
    for (Index i = 0; i < m(); ++i) {
      size[i] = A::max(A::abs(before[i]), A::abs(after[i]));
      largest = A::max(largest, size[i]);
    }
    for (Index i = 0; i < m(); ++i) {
      Number moved = none();
      for (Index k = 0; k < n; ++k) moved += s.B[i * n + k] * released[k];
      jumps |= s.h * A::abs(moved) > margin * 0.25 * A::max(size[i], 0.01 * largest);
    }
    return jumps & any;
  }

  // ---- Checks. `source`: g of the rows, n entries.

  /// Residual in the units of the scene, and lanes lost by the residual or by an alternating y.
  constexpr Number check_rows(const Given& source, Number* largest_x, Mask& lost) const {
    Number largest_y[n], before[n], run[n], worst = none(), reported = none(), finite = none(), longest = none();
    for (Index i = 0; i < n; ++i) largest_y[i] = before[i] = run[i] = none();
    for (Index i = 0; i < m(); ++i) largest_x[i] = none();
    for (Index j = 0; j <= s.J; ++j) {
      Number xs[room], ys[n], missed = none(), scale = A::all(1), missed_there = none(), scale_there = A::all(1);
      for (Index i = 0; i < m(); ++i) {
        xs[i] = x(j, i);
        largest_x[i] = A::max(largest_x[i], A::abs(xs[i]));
      }
      for (Index i = 0; i < n; ++i) ys[i] = y(j, i);
      for (Index i = 0; i < n; ++i) {
        Number q = source(j, i);
        for (Index k = 0; k < m(); ++k) q += s.N[i * m() + k] * xs[k];
        Number w = q;
        for (Index k = 0; k < n; ++k) w += s.M[i * n + k] * ys[k];
        finite += 0 * w;
        missed = A::max(missed, A::abs(A::min(ys[i], w)));
        scale = A::max(scale, A::abs(q));
        missed_there = A::max(missed_there, A::abs(A::min(s.y_unit[i] * ys[i], s.w_unit[i] * w)));
        scale_there = A::max(scale_there, s.w_unit[i] * A::abs(q));
        largest_y[i] = A::max(largest_y[i], ys[i]);
      }
      worst = A::max(worst, missed / scale);
      reported = A::max(reported, missed_there / scale_there);
    }
    lost |= A::no(worst + finite <= settled_residual);
    if (s.stages) return reported + finite;
    for (Index j = 1; j < s.J; ++j)
      for (Index i = 0; i < n; ++i) {
        const Number bend = y(j - 1, i) - 2 * y(j, i) + y(j + 1, i);
        const Mask on = (A::abs(bend) > alternating_part * largest_y[i]) & (bend * before[i] < 0);
        run[i] = A::select(on, run[i] + 1, none());
        before[i] = bend;
        longest = A::max(longest, run[i]);
      }
    lost |= longest >= alternating_run;
    return reported + finite;
  }

  /// core/accuracy/magnification.hpp: how a perturbation grows, and what rounding makes of the solution.
  template <class Problem>
  constexpr void check_growth(Problem& problem, const Number* largest_x, Mask& lost) const {
    Perturbed p;
    Number first[room], xj[room], yj[n], run = none(), impulse2 = none();
    Growth growth = begin_growth(largest_x, p);
    for (Index i = 0; i < m(); ++i) first[i] = p.dz[i];
    for (Index j = 1; j <= s.J; ++j) {
      Mask changed = no_lane();
      for (Index i = 0; i < m(); ++i) xj[i] = x(j, i);
      for (Index i = 0; i < n; ++i) {
        yj[i] = y(j, i);
        changed |= (yj[i] > 0) ^ (p.y[i] > 0);
      }
      if (j == 1 || A::any(changed)) problem.template take<n>(yj, lost);
      run = A::select(changed, A::all(1), run + 1);
      problem.lasts(run, lost);
      growth.take(perturb(problem, j, xj, yj, p), first, p.dz, m());
      if (s.surely_P && A::any(changed)) {
        if (j < s.J) impulse2 = A::select(changed, A::max(impulse2, impulse_of(yj, p.inverse)), impulse2);
        if (j > 1) impulse2 = A::select(changed, A::max(impulse2, impulse_of(p.y, p.inverse)), impulse2);
      }
      for (Index i = 0; i < m(); ++i) p.x[i] = xj[i];
      for (Index i = 0; i < n; ++i) p.y[i] = yj[i];
    }
    lost |= A::no(growth.most2 <= s.most_growth * s.most_growth);
    lost |= A::no(growth.rounding2 <= settled_rounding * settled_rounding);
    // The growth of each impulse up to T is not more than that from any step to any later one.
    lost |= A::no(impulse2 * growth.most2 <= settled_impulse * settled_impulse * growth.size2);
  }

  /// Whether a step of implicit Euler has two solutions, or nearly so, at the rows where
  /// core/accuracy/other_solution.cpp looks. V: n x n, of all active sets one after the other; `seen`: n x m, N (I -
  /// hA)^{-1}. Lanes in `known` are not checked.
  constexpr void check_others(Table seen, Table V, const Given& source, const Given& f, Mask known, Mask& lost) const {
    constexpr Index most_rows = 24;
    const Index stride = s.J / (most_rows / 2) > 1 ? s.J / (most_rows / 2) : 1;
    Number changes = none();
    for (Index j = 1; j <= s.J; ++j) {
      bool look = j == 1 || j % stride == 0;
      Mask changed = no_lane();
      for (Index i = 0; i < n && j > 1; ++i) changed |= (y(j, i) > 0) ^ (y(j - 1, i) > 0);
      changed &= A::no(lost | known);
      changes = A::select(changed, changes + 1, changes);
      look = look || A::any(changed & (changes <= double(most_rows / 2)));
      if (look) lost |= several(j, seen, V, source, f) & A::no(known);
    }
  }

 private:
  // A perturbation dz, what rounding has made of the state, and the rows of the step before. 1 / inverse: the size of
  // each state.
  struct Perturbed {
    Number inverse[room], dz[room], error[room], x[room], y[n];
    Noise noise;
  };

  // Squares of norms of one row.
  struct Sizes {
    Number dz, error, x;
  };

  // Squares: of dz after the last step, its least so far, its growth since then, the size of the solution, and the
  // largest error by rounding in units of it.
  struct Growth {
    Number first2, last2, least2, most2, size2, rounding2;

    // `dz` begins anew where it has died out, and is scaled where its square would leave the range.
    constexpr void take(const Sizes& now, const Number* first, Number* dz, Index m) {
      size2 = A::max(size2, now.x);
      rounding2 = A::max(rounding2, A::select(size2 > 0, 4 * now.error / size2, none()));
      const Mask gone = now.dz < 1e-28 * last2;
      for (Index i = 0; i < m; ++i) dz[i] = A::select(gone, first[i], dz[i]);
      last2 = A::select(gone, first2, now.dz);
      least2 = A::select(gone, first2, A::min(least2, last2));
      most2 = A::max(most2, A::select(least2 > 0, last2 / least2, A::all(1)));
      if (const Mask small = last2 < 1e-200; A::any(small)) {
        const Number by = A::select(small & (last2 > 0), A::all(1e80), A::all(1));
        for (Index i = 0; i < m; ++i) dz[i] *= by;
        last2 *= by * by, least2 *= by * by;
      }
    }
  };

  constexpr Growth begin_growth(const Number* largest_x, Perturbed& p) const {
    Number largest = A::all(1e-290), size2 = none(), norm2 = none();
    for (Index i = 0; i < m(); ++i) largest = A::max(largest, largest_x[i]);
    for (Index i = 0; i < m(); ++i) {
      p.inverse[i] = 1 / A::max(largest_x[i], 1e-12 * largest);
      p.x[i] = x(0, i);
      p.dz[i] = s.part[i] * largest_x[i];
      p.error[i] = epsilon * s.part[i] * p.x[i];
      norm2 += (p.dz[i] * p.inverse[i]) * (p.dz[i] * p.inverse[i]);
      size2 += (p.x[i] * p.inverse[i]) * (p.x[i] * p.inverse[i]);
    }
    for (Index i = 0; i < n; ++i) p.y[i] = y(0, i);
    return {norm2, norm2, norm2, A::all(1), size2, none()};
  }

  // One step of dz and of the errors, on the active set of row j.
  template <class Problem>
  constexpr Sizes perturb(Problem& problem, Index j, const Number* xj, const Number* yj, Perturbed& p) const {
    Number u[n], v[n], next[room], next_error[room];
    Sizes sizes{none(), none(), none()};
    respond(problem, p.dz, u);
    respond(problem, p.error, v);
    for (Index i = 0; i < m(); ++i) {
      Number a = s.growth_G[i * n] * u[0], b = s.growth_G[i * n] * v[0],
             terms = A::abs(xj[i]) + A::abs(growth_drift(j, i));
      for (Index k = 1; k < n; ++k) a += s.growth_G[i * n + k] * u[k], b += s.growth_G[i * n + k] * v[k];
      for (Index k = 0; k < n; ++k) terms += s.size_of_R[i * n + k] * yj[k];
      for (Index k = 0; k < m(); ++k) {
        a += s.growth_E[i * m() + k] * p.dz[k], b += s.growth_E[i * m() + k] * p.error[k];
        terms += s.size_of_E[i * m() + k] * A::abs(p.x[k]);
      }
      next[i] = a;
      next_error[i] = b + (2 * epsilon * p.noise()) * terms;
      const Number of_a = a * p.inverse[i], of_e = next_error[i] * p.inverse[i], of_x = xj[i] * p.inverse[i];
      sizes.dz += of_a * of_a, sizes.error += of_e * of_e, sizes.x += of_x * of_x;
    }
    for (Index i = 0; i < m(); ++i) p.dz[i] = next[i], p.error[i] = next_error[i];
    return sizes;
  }

  // u = V N dz on the active set.
  template <class Problem>
  constexpr void respond(Problem& problem, const Number* dz, Number* u) const {
    Number seen[n];
    for (Index i = 0; i < n; ++i) {
      seen[i] = s.N[i * m()] * dz[0];
      for (Index k = 1; k < m(); ++k) seen[i] += s.N[i * m() + k] * dz[k];
    }
    problem.template respond<n>(seen, u);
  }

  // The square of h |B y_j|.
  constexpr Number impulse_of(const Number* yj, const Number* inverse) const {
    Number sum = none();
    for (Index i = 0; i < m(); ++i) {
      Number b = s.B[i * n] * yj[0];
      for (Index k = 1; k < n; ++k) b += s.B[i * n + k] * yj[k];
      sum += (b * inverse[i]) * (b * inverse[i]);
    }
    return s.h * s.h * sum;
  }

  constexpr Mask several(Index j, Table seen, Table V, const Given& source, const Given& f) const {
    constexpr double loose = 1e-8, apart = 5e-7;
    Number q[n], from[room], solution[n];
    for (Index k = 0; k < m(); ++k) from[k] = x(j - 1, k) + s.h * f(j, k);
    for (Index i = 0; i < n; ++i) {
      q[i] = source(j, i);
      for (Index k = 0; k < m(); ++k) q[i] += seen[i * m() + k] * from[k];
      solution[i] = none();
    }
    Mask found = no_lane(), two = found;
    for (Index set = 0; set < Index(1) << n; ++set) {
      const Table v = V + set * n * n;
      Number value[n];
      Mask may = A::no(no_lane());
      for (Index i = 0; i < n; ++i) {
        Number sum = none(), terms = none();
        for (Index k = 0; k < n; ++k) {
          const Number term = v[i * n + k] * q[k];
          sum += term;
          terms += A::abs(term);
        }
        value[i] = sum;
        may &= sum >= -loose * terms;
        if (!A::any(may)) break;
      }
      if (!A::any(may)) continue;
      Number distance = none(), scale = none();
      for (Index i = 0; i < n; ++i) {
        const Number now = set >> i & 1 ? value[i] : none();
        distance = A::max(distance, A::abs(now - solution[i]));
        scale = A::max(scale, A::max(A::abs(now), A::abs(solution[i])));
        solution[i] = A::select(may & A::no(found), now, solution[i]);
      }
      two |= may & found & (distance > apart * scale);
      found |= may;
    }
    return two;
  }
};

}  // namespace bromwich::scene_steps
