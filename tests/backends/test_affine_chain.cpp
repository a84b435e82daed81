// Contract of affine chains on every backend: states against one dense system, sizes and signs of v against their
// definition.

#include "core/host/affine_chain.hpp"
#include "tests/support/backends.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

using reference::Random;

// 300 states of size 1, each with an error of a few hundred roundings of the dense system.
constexpr double same_chain = 1e-11;

struct ChainProblem {
  std::vector<AffineMap> maps;
  std::vector<int> map_of;
  RowMatrix F, q;
  BoundaryCondition ends;

  std::vector<const AffineMap*> pointers() const {
    std::vector<const AffineMap*> list;
    for (const AffineMap& map : maps) list.push_back(&map);
    return list;
  }
};

// `growth` 1: maps roughly keep sizes. Runs of 150 intervals share a map; the others vary.
ChainProblem chain_problem(Index N, Index m, Index n, double growth) {
  Random random(unsigned(N + 10 * m + 100 * n));
  ChainProblem p;
  for (int kind = 0; kind < 3; ++kind) {
    const Matrix P = growth * Matrix(random.matrix(m, m)) / std::sqrt(double(m));
    SetWords active(std::size_t(words_of_set(n)), 0);
    for (Index i = 0; i < n; ++i)
      if ((i + kind) % 3 == 0) active[std::size_t(i / 64)] |= std::uint64_t(1) << (i % 64);
    p.maps.push_back({P, random.matrix(m, n), random.matrix(n, m), random.matrix(n, n), active});
  }
  for (Index k = 0; k < N; ++k) p.map_of.push_back(int(k < 150 ? 0 : k % 3));
  p.F = random.matrix(N, m);
  p.q = random.matrix(N, n);
  p.ends = {Matrix::Identity(m, m), 0.5 * Matrix(random.matrix(m, m)) / double(m), random.vector(m)};
  return p;
}

// All states from one dense system.
RowMatrix dense_states(const ChainProblem& p) {
  const Index N = p.F.rows(), m = p.F.cols(), size = (N + 1) * m;
  Matrix system = Matrix::Identity(size, size);
  Vector right(size);
  for (Index k = 1; k <= N; ++k) {
    const AffineMap& map = p.maps[std::size_t(p.map_of[std::size_t(k - 1)])];
    system.block(k * m, (k - 1) * m, m, m) = -map.P;
    right.segment(k * m, m) = p.F.row(k - 1).transpose() - map.G * p.q.row(k - 1).transpose();
  }
  system.topLeftCorner(m, m) = p.ends.E0;
  system.topRightCorner(m, m) += p.ends.ET;
  right.head(m) = p.ends.b;
  const Vector x = system.partialPivLu().solve(right);
  return Eigen::Map<const RowMatrix>(x.data(), N + 1, m);
}

class BackendAffineChain : public BackendTest {};
INSTANTIATE_TEST_SUITE_P(Contract, BackendAffineChain, testing::ValuesIn(backend_cases()), backend_case_name);

TEST_P(BackendAffineChain, SolvesBetweenTwoEnds) {
  struct Shape {
    Index N, m, n;
  };
  for (const auto& [N, m, n] :
       {Shape{1, 1, 1}, {7, 4, 2}, {128, 3, 10}, {129, 2, 70}, {300, 4, 5}, {20, 33, 3}, {60000, 1, 3}}) {
    SCOPED_TRACE("N = " + std::to_string(N) + ", m = " + std::to_string(m) + ", n = " + std::to_string(n));
    // No growth, and growth by 4^128 within a block, which only single steps can represent.
    for (const double growth : {0.7, 4.}) {
      if (growth > 1 && N > 300) continue;  // values up to e^{60000}; blocks are scaled by the largest of all times
      const ChainProblem p = chain_problem(N, m, n, growth);
      const auto chain = backend->affine_chain({N, m, n});
      chain->set_sources(p.F, p.q);
      chain->set_maps(p.pointers(), p.map_of);
      ASSERT_TRUE(solve_chain(*chain, N, p.ends, 1e-14));
      const ActiveSizes sizes = chain->evaluate();
      EXPECT_TRUE(sizes.finite);
      RowMatrix x, v;
      chain->download(x, v);
      if (growth < 1 && N <= 300) {  // the dense system loses digits with growth
        EXPECT_LE(distance(x, dense_states(p)), same_chain * std::max(1., x.cwiseAbs().maxCoeff()));
      }
      // Relative to the terms of a row. The smallest blocks have eight steps, in which rounding grows by growth^8.
      const double step_rounding = std::max(same_chain, 100 * epsilon * std::pow(growth, 8));
      double active = 0, inactive = 0;
      SetWords wrong;
      chain->wrong_signs(0.5, 0.25, wrong);
      ASSERT_EQ(Index(wrong.size()), N * words_of_set(n));
      EXPECT_LE((p.ends.E0 * x.row(0).transpose() + p.ends.ET * x.row(N).transpose() - p.ends.b).norm(),
                same_chain * std::max(1., x.row(N).norm()));
      for (Index k = 0; k < N; ++k) {
        const AffineMap& map = p.maps[std::size_t(p.map_of[std::size_t(k)])];
        const Vector now = x.row(k).transpose(), q = p.q.row(k).transpose();
        const Vector next = map.P * now + p.F.row(k).transpose() - map.G * q, expected = map.X * now + map.Q * q;
        const Vector size = map.P.cwiseAbs() * now.cwiseAbs() + p.F.row(k).transpose().cwiseAbs() +
                            map.G.cwiseAbs() * q.cwiseAbs(),
                     size_of_v = map.X.cwiseAbs() * now.cwiseAbs() + map.Q.cwiseAbs() * q.cwiseAbs();
        EXPECT_LE((next - x.row(k + 1).transpose()).cwiseAbs().maxCoeff(), step_rounding * size.maxCoeff()) << k;
        EXPECT_LE((expected - v.row(k).transpose()).cwiseAbs().maxCoeff(), step_rounding * size_of_v.maxCoeff()) << k;
        for (Index i = 0; i < n; ++i) {
          const bool on = contains(map.active.data(), i);
          (on ? active : inactive) = std::max(on ? active : inactive, std::abs(v(k, i)));
          EXPECT_EQ(contains(&wrong[std::size_t(k * words_of_set(n))], i), v(k, i) < (on ? -0.5 : -0.25))
              << k << ' ' << i;
        }
      }
      EXPECT_EQ(sizes.active, active);
      EXPECT_EQ(sizes.inactive, inactive);
    }
  }
}

TEST_P(BackendAffineChain, SaysWhatIsNotDeterminedOrFinite) {
  ChainProblem p = chain_problem(40, 2, 3, 0.7);
  const auto chain = backend->affine_chain({40, 2, 3});
  chain->set_sources(p.F, p.q);
  chain->set_maps(p.pointers(), p.map_of);
  const Matrix row{{1, 0}, {1, 0}};
  EXPECT_FALSE(solve_chain(*chain, 40, {row, Matrix::Zero(2, 2), Vector::Ones(2)}, 1e-14));
  ASSERT_TRUE(solve_chain(*chain, 40, p.ends, 1e-14));
  p.q(17, 1) = NAN;
  chain->set_sources(RowMatrix::Zero(40, 2), p.q);
  chain->set_maps(p.pointers(), p.map_of);
  EXPECT_FALSE(solve_chain(*chain, 40, p.ends, 1e-14) && chain->evaluate().finite);
}

}  // namespace
}  // namespace bromwich
