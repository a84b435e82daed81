#pragma once
// One small dense scene with sources of its own, and the derivatives of its discrete solution on the active sets that
// it has. Only numbers and pointers: it runs in a thread of the host or of a device. Continuous y, linear between time
// points, u_j = B y_j + f_j:
//
//     x_j = E x_{j-1} + L u_{j-1} + R u_j,   w_j = N x_j + M y_j + g_j,   0 <= y_j ⊥ w_j >= 0.
//
// The derivatives are those of derivatives/solution_derivative.hpp, and so are the limits.
//
// symbol       member               shape
// E, L, R      E, L, R              m x m
// L B, R B     left, right          m x n
// M + N R B    steps                problem of its active sets; that of M, at t = 0, is `start`

#include "scene_steps.hpp"
#include "stored_problem.hpp"

#include <cmath>

namespace bromwich::scene_steps {

inline constexpr Index most_held = 8;  ///< m, n

/// Matrices row by row, shared by all scenes.
struct HeldMatrices {
  Index m = 0, n = 0, J = 0;
  double h = 0;
  const double *E = nullptr, *L = nullptr, *R = nullptr, *B = nullptr, *N = nullptr, *M = nullptr;
  const double *left = nullptr, *right = nullptr;
  Sets<> steps{}, start{};
};

/// A table of one scene: row j at base + j width. Null: none.
template <class Number>
struct HeldTable {
  Number* base = nullptr;
  Index width = 0;
  constexpr Number* operator()(Index j) const { return base + j * width; }
  constexpr explicit operator bool() const { return base != nullptr; }
};
using HeldRows = HeldTable<double>;
using HeldGiven = HeldTable<const double>;

/// Changes of the matrices, or sums of a gradient with respect to them, one after the other: those of E, L and R (m x m
/// each), of B (m x n), N (n x m) and M (n x n).
struct HeldPacked {
  Index m, n;
  constexpr Index E() const { return 0; }
  constexpr Index L() const { return m * m; }
  constexpr Index R() const { return 2 * m * m; }
  constexpr Index B() const { return 3 * m * m; }
  constexpr Index N() const { return B() + m * n; }
  constexpr Index M() const { return N() + n * m; }
  constexpr Index size() const { return M() + n * n; }
};

/// What is known of a scene.
struct HeldState {
  enum Verdict : int {
    fine = 0,
    unsolved,      ///< the problem of a step was not solved
    undetermined,  ///< an active set does not determine y
    other_steps,   ///< the steps do not give y
    degenerate     ///< y_i = w_i = 0 to rounding
  };
  int verdict = fine;
  unsigned undecided = 0;  ///< bits of the i with y_i = w_i = 0 at t = 0
  Index step = 0;          ///< of the verdict, or of the margin
  Index constraint = -1;   ///< of the margin
  double margin = 1;       ///< as DerivativeMargin
  double residual = 0;     ///< natural map of the rows, of max(1, |N x + g|)
  bool doubtful = false;   ///< a single solve would look again with half the step
};

/// What solutions are checked by (Steps): `rows` are their matrices, with y_unit and w_unit of ones.
struct HeldChecks {
  Matrices<const double*> rows;
  const double* longest = nullptr;  ///< 2^n; null: solutions are not checked
  const double* zeros = nullptr;    ///< m and n
};

/// `fixed`: m where it is known to the compiler, otherwise 0.
template <Index fixed, Index n>
struct HeldSteps {
  static constexpr Index room = fixed > 0 ? fixed : most_held;
  static constexpr double same_solution = 1e-7, nearly_equal = 1e-10, rounding = 1e-12;

  const HeldMatrices& s;
  HeldGiven f, g;  ///< m and n values a row

  constexpr Index m() const { return fixed > 0 ? fixed : s.m; }
  static constexpr double size(double a) { return a < 0 ? -a : a; }
  static constexpr double larger(double a, double b) { return a > b ? a : b; }
  static constexpr double smaller(double a, double b) { return a < b ? a : b; }

  // to <- to + C v, C: rows x cols.
  static constexpr void add(const double* C, Index rows, Index cols, const double* v, double* to) {
    for (Index i = 0; i < rows; ++i) {
      double sum = 0;
      for (Index k = 0; k < cols; ++k) sum += C[i * cols + k] * v[k];
      to[i] += sum;
    }
  }
  // to <- to + C^T v.
  static constexpr void add_transposed(const double* C, Index rows, Index cols, const double* v, double* to) {
    for (Index i = 0; i < rows; ++i)
      for (Index k = 0; k < cols; ++k) to[k] += C[i * cols + k] * v[i];
  }
  // sum <- sum + a b^T.
  static constexpr void add_outer(const double* a, Index rows, const double* b, Index cols, double* sum) {
    for (Index i = 0; i < rows; ++i)
      for (Index k = 0; k < cols; ++k) sum[i * cols + k] += a[i] * b[k];
  }
  static constexpr void copy(const double* from, Index count, double* to) {
    for (Index i = 0; i < count; ++i) to[i] = from ? from[i] : 0;
  }
  static constexpr unsigned set_of(const double* y) {
    unsigned set = 0;
    for (Index i = 0; i < n; ++i) set |= y[i] > 0 ? 1u << i : 0u;
    return set;
  }
  // u_j = B y_j + f_j.
  constexpr void input(Index j, const double* y, double* u) const {
    copy(f ? f(j) : nullptr, m(), u);
    add(s.B, m(), n, y, u);
  }
  // E x + L u_{j-1} + R (u_j without B y_j).
  constexpr void free_state(Index j, const double* x, const double* before, double* to) const {
    for (Index i = 0; i < m(); ++i) to[i] = 0;
    add(s.E, m(), m(), x, to);
    add(s.L, m(), m(), before, to);
    if (f) add(s.R, m(), m(), f(j), to);
  }

  // ---- The solution.

  /// Row 0 of y solves the problem of M at x0.
  constexpr void solve(const double* x0, const HeldRows& y, HeldState& state) const {
    StoredProblem<> first{s.start, nullptr}, next{s.steps, nullptr};
    double x[room], u[room], q[n];
    copy(x0, m(), x);
    first_problem(x, q);
    bool lost = false;
    first.template solve<n>(q, y(0), lost);
    next.set = set_of(y(0));
    for (Index j = 1; j <= s.J && !lost; ++j) {
      double free[room];
      input(j - 1, y(j - 1), u);
      free_state(j, x, u, free);
      copy(g ? g(j) : nullptr, n, q);
      add(s.N, n, m(), free, q);
      next.template solve<n>(q, y(j), lost);
      copy(free, m(), x);
      add(s.right, m(), n, y(j), x);
      if (lost) state.step = j;
    }
    if (lost) state.verdict = HeldState::unsolved;
  }

  // N x0 + g_0. Negative values that rounding explains are zero (core/march/outcome.cpp).
  constexpr void first_problem(const double* x, double* q) const {
    for (Index i = 0; i < n; ++i) {
      const double given = g ? g(0)[i] : 0;
      double sum = given, terms = size(given);
      for (Index k = 0; k < m(); ++k) {
        const double term = s.N[i * m() + k] * x[k];
        sum += term, terms += size(term);
      }
      q[i] = sum < 0 && sum >= -4 * double(m() + 1) * epsilon * terms ? 0 : sum;
    }
  }

  // ---- States and w along y, and whether there is a derivative.

  constexpr void follow(const HeldGiven& y, const double* x0, const HeldRows& x, const HeldRows& w,
                        HeldState& state) const {
    double most_y[n] = {}, most_g[n] = {}, most = 0;
    for (Index j = 0; j <= s.J; ++j)
      for (Index i = 0; i < n; ++i) {
        most_y[i] = larger(most_y[i], size(y(j)[i]));
        most_g[i] = larger(most_g[i], g ? size(g(j)[i]) : 0);
        most = larger(most, most_y[i]);
      }
    copy(x0, m(), x(0));
    double most_x[room] = {}, most_w[n] = {};
    for (Index j = 0; j <= s.J && state.verdict == HeldState::fine; ++j) {
      const double off = follow_step(j, y, x, w, state);
      if (state.verdict == HeldState::fine && !(off <= same_solution * (1e-290 + most))) {
        state.verdict = HeldState::other_steps;
        state.step = j;
      }
      for (Index i = 0; i < m(); ++i) most_x[i] = larger(most_x[i], size(x(j)[i]));
      for (Index i = 0; i < n; ++i) most_w[i] = larger(most_w[i], size(w(j)[i]));
    }
    if (state.verdict == HeldState::fine) find_margin(y, w, most_x, most_y, most_g, most_w, state);
  }

  // x_j and w_j, with the loop closed by the change of y that would make w vanish where y acts. Returns its norm.
  constexpr double follow_step(Index j, const HeldGiven& y, const HeldRows& x, const HeldRows& w,
                               HeldState& state) const {
    StoredProblem<> problem{j > 0 ? s.steps : s.start, nullptr};
    problem.set = set_of(y(j));
    if (!problem.template usable<n>()) {
      state.verdict = HeldState::undetermined;
      state.step = j;
      return 0;
    }
    double norm2 = 0;
    if (j > 0) {
      double u[room], missed[n], off[n];
      input(j - 1, y(j - 1), u);
      free_state(j, x(j - 1), u, x(j));
      add(s.right, m(), n, y(j), x(j));
      copy(g ? g(j) : nullptr, n, missed);
      add(s.M, n, n, y(j), missed);
      add(s.N, n, m(), x(j), missed);
      problem.template respond<n>(missed, off);
      add(s.right, m(), n, off, x(j));
      for (Index i = 0; i < n; ++i) norm2 += off[i] * off[i];
    }
    double q[n], largest = 0, least = 0;
    copy(g ? g(j) : nullptr, n, q);
    add(s.N, n, m(), x(j), q);
    for (Index i = 0; i < n; ++i) largest = larger(largest, size(q[i]));
    copy(q, n, w(j));
    add(s.M, n, n, y(j), w(j));
    for (Index i = 0; i < n; ++i) {
      const double map = smaller(y(j)[i], w(j)[i]);
      least = map == map ? larger(least, size(map)) : map;
    }
    const double missed = least / larger(1, largest);
    if (state.residual == state.residual && !(missed <= state.residual)) state.residual = missed;  // NaN stays
    return std::sqrt(norm2);
  }

  /// Whether perturbations or rounding grow along the solution, or y alternates. `drift`: J+1 rows of m values, which
  /// this writes.
  constexpr void doubt(const HeldChecks& checks, const HeldRows& y, const HeldRows& x, const HeldRows& drift,
                       HeldState& state) const {
    for (Index j = 0; j <= s.J; ++j) {
      for (Index i = 0; i < m(); ++i) drift(j)[i] = 0;
      if (!f || j == 0) continue;
      add(s.L, m(), m(), f(j - 1), drift(j));
      add(s.R, m(), m(), f(j), drift(j));
    }
    const Source<double> given =
        g ? Source<double>{nullptr, g.base, n, 1} : Source<double>{checks.zeros, nullptr, 0, 1};
    const Source<double> own{nullptr, drift.base, m(), 1};
    const Steps<fixed, n, double, const double*> rows{checks.rows, {x.base, m(), 1}, {y.base, n, 1}, own, given, own};
    double largest_x[fixed > 0 ? fixed : most_states];
    rows.check_rows(given, largest_x, state.doubtful);
    if (state.doubtful) return;
    StoredProblem<> growth{s.steps, checks.longest};
    rows.check_growth(growth, largest_x, state.doubtful);
  }

  constexpr void find_margin(const HeldGiven& y, const HeldRows& w, const double* most_x, const double* most_y,
                             const double* most_g, const double* most_w, HeldState& state) const {
    for (Index i = 0; i < n; ++i) {
      double zero_w = most_g[i];
      for (Index k = 0; k < m(); ++k) zero_w += size(s.N[i * m() + k]) * most_x[k];
      for (Index k = 0; k < n; ++k) zero_w += size(s.M[i * n + k]) * most_y[k];
      zero_w *= rounding;
      const double own = s.M[i * n + i], zero_y = own > 0 ? zero_w / own : 0;
      for (Index j = 0; j <= s.J; ++j) {
        const bool active = y(j)[i] > 0;
        const double value = active ? y(j)[i] : w(j)[i], most = active ? most_y[i] : most_w[i];
        const double margin = value > (active ? zero_y : zero_w) ? value / most : 0;
        if (j == 0 && !active && value <= larger(zero_w, nearly_equal * most_w[i])) state.undecided |= 1u << i;
        if (j == 0 && !active && margin <= nearly_equal) continue;
        if (margin < state.margin) state.margin = margin, state.step = j, state.constraint = i;
      }
    }
    if (!(state.margin > nearly_equal)) state.verdict = HeldState::degenerate;
  }

  // ---- Forward.

  struct Change {
    const double* x0;        ///< m
    HeldGiven f, g;          ///< of the sources
    const double* matrices;  ///< HeldPacked
  };
  struct Out {
    HeldRows y, x, w, integral;
  };

  /// False where w of a constraint that is not decided at t = 0 moves.
  constexpr bool forward(const HeldGiven& y, const HeldGiven& x, const HeldState& state, const Change& c,
                         const Out& out) const {
    double direct[room], direct_before[room] = {}, fixed_terms[n], moved[n];
    bool decided = true;
    for (Index j = 0; j <= s.J; ++j) {
      StoredProblem<> problem{j > 0 ? s.steps : s.start, nullptr};
      problem.set = set_of(y(j));
      copy(c.f ? c.f(j) : nullptr, m(), direct);
      copy(c.g ? c.g(j) : nullptr, n, fixed_terms);
      if (c.matrices) add_direct(y(j), x(j), c.matrices, direct, fixed_terms);
      double* const dx = out.x(j);
      double* const dy = out.y(j);
      copy(j == 0 ? c.x0 : nullptr, m(), dx);
      if (j > 0) {
        add(s.E, m(), m(), out.x(j - 1), dx);
        add(s.left, m(), n, out.y(j - 1), dx);
        add(s.L, m(), m(), direct_before, dx);
        add(s.R, m(), m(), direct, dx);
        if (c.matrices) add_of_step(j, y, x, c.matrices, dx);
      }
      copy(fixed_terms, n, moved);
      add(s.N, n, m(), dx, moved);
      problem.template respond<n>(moved, dy);
      if (j > 0) add(s.right, m(), n, dy, dx);
      copy(fixed_terms, n, out.w(j));
      add(s.N, n, m(), dx, out.w(j));
      add(s.M, n, n, dy, out.w(j));
      if (j == 0) decided = stays(state.undecided, dx, dy, fixed_terms, out.w(0));
      for (Index i = 0; i < n && out.integral; ++i)
        out.integral(j)[i] = j > 0 ? out.integral(j - 1)[i] + 0.5 * s.h * (out.y(j - 1)[i] + dy[i]) : 0;
      copy(direct, m(), direct_before);
    }
    return decided;
  }

  // Of dB, dN and dM.
  constexpr void add_direct(const double* y, const double* x, const double* change, double* direct,
                            double* fixed_terms) const {
    const HeldPacked at{m(), n};
    add(change + at.B(), m(), n, y, direct);
    add(change + at.N(), n, m(), x, fixed_terms);
    add(change + at.M(), n, n, y, fixed_terms);
  }
  // Of dE, dL and dR.
  constexpr void add_of_step(Index j, const HeldGiven& y, const HeldGiven& x, const double* change, double* dx) const {
    const HeldPacked at{m(), n};
    double u[room];
    add(change + at.E(), m(), m(), x(j - 1), dx);
    input(j - 1, y(j - 1), u);
    add(change + at.L(), m(), m(), u, dx);
    input(j, y(j), u);
    add(change + at.R(), m(), m(), u, dx);
  }
  constexpr bool stays(unsigned undecided, const double* dx, const double* dy, const double* fixed_terms,
                       const double* dw) const {
    for (Index i = 0; i < n; ++i) {
      if (!(undecided >> i & 1u)) continue;
      double terms = size(fixed_terms[i]);
      for (Index k = 0; k < m(); ++k) terms += size(s.N[i * m() + k] * dx[k]);
      for (Index k = 0; k < n; ++k) terms += size(s.M[i * n + k] * dy[k]);
      if (size(dw[i]) > rounding * terms) return false;
    }
    return true;
  }

  // ---- Backward.

  struct Weights {
    HeldGiven y, x, w, integral;
  };
  struct Gradient {
    double* x0;        ///< m
    HeldRows f, g;     ///< g may have the memory of the weights of w
    double* matrices;  ///< HeldPacked; null: not wanted
  };

  /// False where the gradient is one-sided at t = 0.
  constexpr bool backward(const HeldGiven& y, const HeldGiven& x, const HeldState& state, const Weights& of,
                          const Gradient& bar) const {
    double next[room] = {}, later[n] = {};
    double sums[3 * room * room + 2 * room * n + n * n] = {};
    bool decided = true;
    for (Index j = s.J; j >= 0; --j) {
      double p[room], back[room], of_u[room] = {}, eta[n], mu[n], of_w[n];
      StoredProblem<> problem{j > 0 ? s.steps : s.start, nullptr};
      problem.set = set_of(y(j));
      copy(of.w ? of.w(j) : nullptr, n, of_w);
      copy(of.x ? of.x(j) : nullptr, m(), p);
      add_transposed(s.E, m(), m(), next, p);
      add_transposed(s.N, n, m(), of_w, p);
      add_transposed(s.L, m(), m(), next, of_u);
      copy(of_u, m(), back);
      if (j > 0) add_transposed(s.R, m(), m(), p, back);
      copy(of.y ? of.y(j) : nullptr, n, eta);
      add_transposed(s.B, m(), n, back, eta);
      add_transposed(s.M, n, n, of_w, eta);
      if (of.integral) add_integral(j, of.integral(j), later, eta);
      if (j == 0) decided = balances(state.undecided, back, eta);
      problem.template respond_transposed<n>(eta, mu);
      copy(p, m(), next);
      for (Index i = 0; i < n; ++i) of_w[i] -= mu[i], mu[i] = -mu[i];
      add_transposed(s.N, n, m(), mu, next);
      if (j > 0) add_transposed(s.R, m(), m(), next, of_u);
      copy(of_w, n, bar.g(j));
      copy(of_u, m(), bar.f(j));
      if (bar.matrices) add_sums(j, y, x, of_u, of_w, next, sums);
    }
    copy(next, m(), bar.x0);
    if (bar.matrices) copy(sums, HeldPacked{m(), n}.size(), bar.matrices);
    return decided;
  }

  constexpr void add_integral(Index j, const double* of, double* later, double* eta) const {
    for (Index i = 0; i < n; ++i) {
      eta[i] += 0.5 * s.h * later[i];
      later[i] += of[i];
      if (j > 0) eta[i] += 0.5 * s.h * later[i];
    }
  }
  constexpr void add_sums(Index j, const HeldGiven& y, const HeldGiven& x, const double* of_u, const double* of_w,
                          const double* of_x, double* sums) const {
    const HeldPacked at{m(), n};
    add_outer(of_u, m(), y(j), n, sums + at.B());
    add_outer(of_w, n, x(j), m(), sums + at.N());
    add_outer(of_w, n, y(j), n, sums + at.M());
    if (j == 0) return;
    double u[room];
    add_outer(of_x, m(), x(j - 1), m(), sums + at.E());
    input(j - 1, y(j - 1), u);
    add_outer(of_x, m(), u, m(), sums + at.L());
    input(j, y(j), u);
    add_outer(of_x, m(), u, m(), sums + at.R());
  }
  constexpr bool balances(unsigned undecided, const double* back, const double* eta) const {
    double terms2 = 0, eta2 = 0;
    for (Index i = 0; i < n; ++i) {
      double sum = 0;
      for (Index k = 0; k < m(); ++k) sum += size(s.B[k * n + i] * back[k]);
      terms2 += sum * sum, eta2 += eta[i] * eta[i];
    }
    for (Index i = 0; i < n; ++i)
      if (undecided >> i & 1u && size(eta[i]) > rounding * (std::sqrt(terms2) + std::sqrt(eta2))) return false;
    return true;
  }
};

}  // namespace bromwich::scene_steps
