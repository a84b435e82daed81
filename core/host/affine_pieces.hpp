#pragma once
// Steps of one dense scene by the affine pieces of their solutions. Only numbers and pointers: a chunk of time runs in
// a thread of the host, or in a few threads of a device, each with some columns of the derivative.
//
// A step of kind k, driven by the numbers c_j of the sources, takes the state s to
//
//     q = S s + q_j,   Y in SOL(W, q),   s+ = E s + f_j + R Y,   q_j = q + Q c_j,   f_j = f + F c_j.
//
// Radau IIA and implicit Euler: s is x, and Y has y at the stages; y_j is the last one. Continuous y: s = E x + L y of
// the step before, and x_j = s + d_j + R^ y with d_j = d + D c_j (core/march/split_steps.hpp).
//
// On a piece, a polyhedron of q, the solution is one affine map Y = Z q: (Y_S, w_I) = V q for an active set S. A piece
// with a singular W_SS (the solution of least norm) has equations K q = 0 besides. The pieces of a kind are found by
// the host when a step meets a q outside all known ones. The derivative of a step is P = E + R Z S.
//
// symbol        member               shape
// S, E, R       see, decay, drive    u x m, m x m, m x u
// R^            shown                m x u; continuous y
// V, K, P       V, K, P              u x u, u x u, m x m
// Sizes m, u are padded by zeros. Stage a of constraint i is unknown a u/2 + i; implicit Euler has the second half.

#include "affine_maps.hpp"

namespace bromwich::pieces {

/// Continuous y, or stages; with `columns` of the derivative.
template <Index m, Index u, bool continuous, Index columns>
struct Walk {
  static constexpr Index n = continuous ? u : u / 2;
  static constexpr double negligible = 1e-9, much_more = 4;

  const Scene<m, u>& g;
  double s[m] = {}, D[columns > 0 ? columns : 1][m] = {};
  Memory<u> memory = {};
  End<m, u> end = {};
  int piece = 0;  ///< of the last step of kind 0

  static constexpr double size(double a) { return a < 0 ? -a : a; }
  static constexpr double larger(double a, double b) { return a > b ? a : b; }
  constexpr const Piece<m, u>& piece_of(Index kind, int i) const { return g.pieces[kind * g.most_pieces + i]; }

  constexpr void start(const double* from, const Memory<u>& before, Index first_column) {
    for (Index i = 0; i < m; ++i) s[i] = from[i];
    for (Index c = 0; c < columns; ++c)
      for (Index i = 0; i < m; ++i) D[c][i] = i == first_column + c ? 1 : 0;
    memory = before;
    end = {};
    for (Index i = 0; i < u; ++i) end.below[i] = 1e300;
    end.sets = 14695981039346656037ULL;
  }

  // ---- Products with matrices by columns. Sums that are local stay in registers.

  template <Index rows, Index cols>
  static constexpr void add(const double (&A)[cols][rows], const double* x, double* to) {
    double sum[rows];
    for (Index i = 0; i < rows; ++i) sum[i] = to[i];
    for (Index k = 0; k < cols; ++k)
      for (Index i = 0; i < rows; ++i) sum[i] += A[k][i] * x[k];
    for (Index i = 0; i < rows; ++i) to[i] = sum[i];
  }
  static constexpr void add_sizes(const double (&A)[u][u], const double* x, double* to) {
    double sum[u];
    for (Index i = 0; i < u; ++i) sum[i] = to[i];
    for (Index k = 0; k < u; ++k)
      for (Index i = 0; i < u; ++i) sum[i] += size(A[k][i] * x[k]);
    for (Index i = 0; i < u; ++i) to[i] = sum[i];
  }
  template <Index width>
  static constexpr void fold(double* values) {
    if constexpr (width > 0) {
      for (Index i = 0; i < width; ++i) values[i] = larger(values[i], values[i + width]);
      fold<width / 2>(values);
    }
  }
  static constexpr double largest_of(const double* q) {
    double sizes[u];
    for (Index i = 0; i < u; ++i) sizes[i] = size(q[i]);
    fold<u / 2>(sizes);
    return sizes[0];
  }

  // ---- The problem of a step.

  static constexpr bool solves(const Piece<m, u>& p, const double* q, double largest, double* value, unsigned& wrong) {
    wrong = 0;
    for (Index i = 0; i < u; ++i) value[i] = 0;
    add<u>(p.V, q, value);
    const double zero = -p.rounding * largest;
    int below = 0;
    for (Index i = 0; i < u; ++i) below |= value[i] < zero;
    if (below) wrong = negative(p, q, largest, value);
    return wrong == 0 && (p.equal == 0 || holds(p, q, largest));
  }
  static constexpr unsigned negative(const Piece<m, u>& p, const double* q, double largest, const double* value) {
    unsigned wrong = 0;
    double terms[u];
    for (Index i = 0; i < u; ++i) terms[i] = largest;
    add_sizes(p.V, q, terms);
    for (Index i = 0; i < u; ++i)
      if (value[i] < -p.rounding * terms[i]) wrong |= 1u << i;
    return wrong;
  }
  static constexpr bool holds(const Piece<m, u>& p, const double* q, double largest) {
    double sum[u] = {}, terms[u];
    for (Index i = 0; i < u; ++i) terms[i] = largest;
    add<u>(p.K, q, sum);
    add_sizes(p.K, q, terms);
    for (Index i = 0; i < u; ++i)
      if ((p.equal >> i & 1u) && size(sum[i]) > p.rounding * terms[i]) return false;
    return true;
  }

  // Exchanges the wrong signs, then looks at all pieces.
  constexpr bool search(Index kind, const double* q, double largest, double* value, unsigned wrong, int& at) const {
    constexpr int exchanges = 4;
    const int known = g.known[kind];
    for (int k = 0; k < exchanges && wrong != 0; ++k) {
      const unsigned active = piece_of(kind, at).active ^ wrong;
      int found = 0;
      while (found < known && piece_of(kind, found).active != active) ++found;
      if (found == known) break;
      at = found;
      if (solves(piece_of(kind, at), q, largest, value, wrong)) return true;
    }
    for (at = 0; at < known; ++at)
      if (solves(piece_of(kind, at), q, largest, value, wrong)) return true;
    at = 0;
    return false;
  }

  /// Y in scaled units. False: q is outside all known pieces.
  constexpr bool solve(Index kind, const double* q, double* Y, int& at) const {
    const double largest = largest_of(q);
    if (g.known[kind] == 0) return false;
    unsigned wrong = 0;
    if (!solves(piece_of(kind, at), q, largest, Y, wrong) && !search(kind, q, largest, Y, wrong, at)) return false;
    const unsigned active = piece_of(kind, at).active;
    for (Index i = 0; i < u; ++i) Y[i] = (active >> i & 1u) && !(Y[i] < 0) ? Y[i] : 0;
    return true;
  }

  // ---- A step.

  constexpr void see(const Maps<m, u>& a, const double* c, double* q) const {
    for (Index i = 0; i < u; ++i) q[i] = a.q[i];
    add<u>(a.see, s, q);
    for (Index k = 0; k < g.numbers; ++k)
      for (Index i = 0; i < u; ++i) q[i] += a.of_q[k][i] * c[k];
  }
  constexpr void move(const Maps<m, u>& a, const double* c, const double* Y, double* next) const {
    for (Index i = 0; i < m; ++i) next[i] = a.f[i];
    add<m>(a.decay, s, next);
    add<m>(a.drive, Y, next);
    for (Index k = 0; k < g.numbers; ++k)
      for (Index i = 0; i < m; ++i) next[i] += a.of_f[k][i] * c[k];
  }

  /// False: q is outside all known pieces; it is in `missed`.
  constexpr bool step(const Maps<m, u>& a, Index kind, Index j, bool writes, Missed<u>& missed) {
    const double* c = g.sources + j * g.numbers;
    double q[u], Y[u], next[m];
    int at = kind == 0 ? piece : 0;
    see(a, c, q);
    if (!solve(kind, q, Y, at)) return miss(kind, j, q, missed);
    move(a, c, Y, next);
    if (kind == 0) piece = at;
    Index used = kind;
    if constexpr (!continuous) {
      if (g.substitutes_euler && (impacts(Y) || jumps(a, Y, next))) {
        used = kind + g.kinds;
        at = 0;
        see(g.maps[used], c, q);
        if (!solve(used, q, Y, at)) return miss(used, j, q, missed);
        move(g.maps[used], c, Y, next);
        ++end.jumps;
      }
    }
    const Maps<m, u>& taken = used == kind ? a : g.maps[used];
    if (writes) record(taken, used, c, Y, next, j);
    follow(piece_of(used, at));
    end.sets = (end.sets ^ std::uint64_t(used * g.most_pieces + at)) * 1099511628211ULL;
    if constexpr (!continuous) pass(taken, used, Y);
    for (Index i = 0; i < m; ++i) {
      s[i] = next[i];
      end.size[i] = larger(end.size[i], size(s[i]));
    }
    return true;
  }

  constexpr bool miss(Index kind, Index j, const double* q, Missed<u>& missed) const {
    for (Index i = 0; i < u; ++i) missed.q[i] = q[i];
    missed.kind = kind, missed.row = j;
    return false;
  }

  constexpr void follow(const Piece<m, u>& p) {
    for (Index k = 0; k < columns; ++k) {
      double moved[m] = {};
      add<m>(p.P, D[k], moved);
      for (Index i = 0; i < m; ++i) D[k][i] = moved[i];
    }
  }

  constexpr void record(const Maps<m, u>& a, Index used, const double* c, const double* Y, const double* next,
                        Index j) const {
    double* const x = g.x + j * g.x_apart;
    double* const y = g.y + j * g.y_apart;
    const Index first = continuous ? 0 : n;
    for (Index i = 0; i < n && i < g.constraints; ++i) y[i] = Y[first + i] * a.unit[first + i];
    if constexpr (continuous) {
      double shown[m];
      for (Index i = 0; i < m; ++i) shown[i] = s[i] + a.d[i];
      add<m>(a.shown, Y, shown);
      for (Index k = 0; k < g.numbers; ++k)
        for (Index i = 0; i < m; ++i) shown[i] += a.of_d[k][i] * c[k];
      for (Index i = 0; i < m && i < g.states; ++i) x[i] = shown[i];
    } else {
      for (Index i = 0; i < m && i < g.states; ++i) x[i] = next[i];
      if (!g.impulse) return;
      const double of_last = used < g.kinds ? 0.25 : 1;
      for (Index i = 0; i < n && i < g.constraints; ++i)
        g.impulse[j * g.y_apart + i] = a.h * ((1 - of_last) * Y[i] * a.unit[i] + of_last * y[i]);
    }
  }

  // ---- Jumps of the state: StageSteps::impacts, jumps and moves.

  constexpr void pass(const Maps<m, u>& a, Index used, const double* Y) {
    memory.touching = 0;
    for (Index i = 0; i < n; ++i) memory.touching |= Y[n + i] > 0 ? 1u << i : 0u;
    if (!g.substitutes_euler || used >= g.kinds) return;
    for (Index i = 0; i < n; ++i) {
      const double y = Y[n + i] * a.unit[n + i];
      memory.regular[i] = larger(memory.regular[i], y);
      end.memory.regular[i] = larger(end.memory.regular[i], y);
    }
  }
  constexpr bool impacts(const double* Y) const {
    const unsigned looked_at = g.rigid & ~memory.touching;
    if (looked_at == 0) return false;
    for (Index i = 0; i < n; ++i)
      if ((looked_at >> i & 1u) && larger(Y[i], Y[n + i]) > 0) return true;
    return false;
  }
  constexpr bool exceeds_regular(Index i, double y) {
    const bool exceeds = y > much_more * memory.regular[i];
    if (exceeds)
      end.below[i] = y / much_more < end.below[i] ? y / much_more : end.below[i];
    else if (y > much_more * end.memory.regular[i])
      end.least[i] = larger(end.least[i], y / much_more);
    return exceeds;
  }
  constexpr bool jumps(const Maps<m, u>& a, const double* Y, const double* next) {
    double most = 0;
    for (Index i = 0; i < u; ++i) most = larger(most, Y[i] * a.unit[i]);
    const double zero = negligible * most;
    const bool part = a.h < g.maps[0].h / 2;
    bool released = false;
    for (Index i = 0; i < n; ++i) {
      const double first = Y[i] * a.unit[i], last = Y[n + i] * a.unit[n + i];
      if (!(first > zero)) continue;
      if (part && last < first / 2 && exceeds_regular(i, first)) return true;
      released = released || !(last > zero);
    }
    return released && large(a, Y, next, zero);
  }
  constexpr bool large(const Maps<m, u>& a, const double* Y, const double* next, double zero) {
    double largest = 0;
    for (Index i = 0; i < n; ++i)
      if (is_released(a, Y, i, zero) && exceeds_regular(i, Y[i] * a.unit[i])) return true;
    for (Index i = 0; i < m; ++i) largest = larger(largest, larger(size(s[i]), size(next[i])));
    for (Index i = 0; i < m; ++i) {
      double moved = 0;
      for (Index k = 0; k < n; ++k)
        if (is_released(a, Y, k, zero)) moved += g.moved[i][k] * Y[k] * a.unit[k];
      if (a.h * size(moved) > 0.25 * larger(larger(size(s[i]), size(next[i])), 0.01 * largest)) return true;
    }
    return false;
  }
  static constexpr bool is_released(const Maps<m, u>& a, const double* Y, Index i, double zero) {
    return Y[i] * a.unit[i] > zero && !(Y[n + i] * a.unit[n + i] > zero);
  }

  // ---- A chunk, from behind row `first` to row `last`. `main` is the maps of kind 0.

  constexpr bool march(const Maps<m, u>& main, Index first, Index last, bool writes, Missed<u>& missed) {
    for (Index j = first + 1; j <= last; ++j) {
      const Index kind = g.kind_of ? g.kind_of[j] : 0;
      if (!(kind == 0 ? step(main, 0, j, writes, missed) : step(g.maps[kind], kind, j, writes, missed))) return false;
    }
    for (Index i = 0; i < m; ++i) end.s[i] = s[i];
    end.memory.touching = memory.touching;
    end.complete = true;
    return true;
  }
};

}  // namespace bromwich::pieces
