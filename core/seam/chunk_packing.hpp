#pragma once
// Problems of chunk_march.hpp in the padded sizes of core/host/affine_pieces.hpp.

#include "../host/chunk_states.hpp"
#include "chunk_march.hpp"

namespace bromwich::pieces {

/// The place of an unknown: the stages of a padded problem begin at 0 and at u / 2.
inline Index place(Index i, Index n, bool continuous, Index u) { return continuous ? i : i / n * (u / 2) + i % n; }

template <Index m, Index u>
class Packing {
 public:
  Packing(Index n, bool continuous) : n_(n), continuous_(continuous) {}

  Maps<m, u> maps(const ChunkStep& s) const {
    Maps<m, u> a;
    a.h = s.h;
    for (Index i = 0; i < s.see.rows(); ++i) {
      const Index to = at(i);
      for (Index k = 0; k < s.see.cols(); ++k) a.see[k][to] = s.see(i, k), a.drive[to][k] = s.drive(k, i);
      for (Index k = 0; k < s.shown.rows(); ++k) a.shown[to][k] = s.shown(k, i);
      for (Index k = 0; k < s.of_q.cols(); ++k) a.of_q[k][to] = s.of_q(i, k);
      a.q[to] = s.q[i], a.unit[to] = s.unit[i];
    }
    for (Index i = 0; i < s.decay.rows(); ++i) {
      for (Index k = 0; k < s.decay.cols(); ++k) a.decay[k][i] = s.decay(i, k);
      for (Index k = 0; k < s.of_f.cols(); ++k) a.of_f[k][i] = s.of_f(i, k);
      for (Index k = 0; k < s.of_d.cols(); ++k) a.of_d[k][i] = s.of_d(i, k);
      a.f[i] = s.f[i];
      if (s.d.size() > 0) a.d[i] = s.d[i];
    }
    return a;
  }

  Piece<m, u> piece(const ChunkPiece& s) const {
    Piece<m, u> a;
    a.rounding = s.rounding;
    for (Index i = 0; i < s.V.rows(); ++i) {
      a.active |= (s.active >> i & 1u) << at(i);
      a.equal |= (s.equal >> i & 1u) << at(i);
      for (Index k = 0; k < s.V.cols(); ++k) a.V[at(k)][at(i)] = s.V(i, k);
      for (Index k = 0; k < s.K.cols(); ++k) a.K[at(k)][at(i)] = s.K(i, k);
    }
    for (Index i = 0; i < s.P.rows(); ++i)
      for (Index k = 0; k < s.P.cols(); ++k) a.P[k][i] = s.P(i, k);
    return a;
  }

  /// The numbers of a scene; its pointers are left null.
  Scene<m, u> scene(const ChunkMarchProblem& p) const {
    Scene<m, u> g;
    g.most_pieces = ChunkMarch::most_pieces;
    g.kinds = p.kinds;
    g.numbers = p.sources.cols();
    g.states = p.m, g.constraints = p.n;
    g.substitutes_euler = p.substitutes_euler;
    g.rigid = p.rigid;
    for (Index i = 0; i < p.moved.rows(); ++i)
      for (Index k = 0; k < p.moved.cols(); ++k) g.moved[i][k] = p.moved(i, k);
    return g;
  }

  Memory<u> memory(const ChunkMarchProblem& p) const {
    Memory<u> a;
    for (Index i = 0; i < p.regular.size(); ++i) a.regular[i] = p.regular[i];
    a.touching = p.touching;
    return a;
  }

  ChunkMiss miss(const Missed<u>& a) const {
    ChunkMiss to{a.row, a.kind, Vector(continuous_ ? n_ : 2 * n_)};
    for (Index i = 0; i < to.q.size(); ++i) to.q[i] = a.q[at(i)];
    return to;
  }

 private:
  Index at(Index i) const { return place(i, n_, continuous_, u); }

  Index n_;
  bool continuous_;
};

/// make(size<m>, size<u>, rule<continuous>) for the padded sizes of a problem that fits.
template <Index value>
struct Size {
  static constexpr Index is = value;
};
template <bool value>
struct Rule {
  static constexpr bool is = value;
};
template <class Use>
auto with_size(Index needed, const Use& use) {
  if (needed <= 2) return use(Size<2>());
  if (needed <= 4) return use(Size<4>());
  if (needed <= 8) return use(Size<8>());
  return use(Size<16>());
}
template <class Make>
auto with_sizes(const ChunkMarchProblem& p, const Make& make) {
  return with_size(p.m, [&](auto m) {
    return with_size(p.unknowns(),
                     [&](auto u) { return p.continuous ? make(m, u, Rule<true>()) : make(m, u, Rule<false>()); });
  });
}

/// That of a state behind so many steps.
inline double rounding_of(Index steps) { return 64 * epsilon * std::sqrt(double(steps)); }

}  // namespace bromwich::pieces
