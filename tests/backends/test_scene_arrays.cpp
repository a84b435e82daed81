// Contract of scenes in arrays on every backend: solutions are those of single solves, derivatives those of
// SolutionDerivative, scene by scene; one that has none spoils nothing.

#include "batch/array_scenes.hpp"
#include "batch/batch_derivative.hpp"
#include "core/base/error.hpp"
#include "core/solve/solve.hpp"
#include "derivatives/solution_derivative.hpp"
#include "tests/support/backends.hpp"
#include "tests/support/run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bromwich::scene_arrays_test {
namespace {

using reference::Random;
using scene_steps::HeldPacked;
using scene_steps::HeldState;

constexpr Index scenes = 40, steps = 50;  // above a warp
// J roundings of a stable recurrence, in another order of operations, times the condition of the problems.
constexpr double same = 1e-12;

// M = P P^T + I, A stable.
Scene drawn(Index m, Index n) {
  Random random{unsigned(10 * m + n)};
  Scene scene;
  DenseDynamics d{random.matrix(m, m), random.matrix(m, n), random.matrix(n, m)};
  d.A -= 2 * std::sqrt(double(m)) * Matrix::Identity(m, m);
  scene.dynamics = d;
  const Matrix P = random.matrix(n, n);
  scene.M = Matrix(P * P.transpose() + Matrix::Identity(n, n));
  scene.x0 = random.vector(m);
  scene.T = 3;
  return scene;
}

// Scene k has x0, f and g of its own.
Scene scene_of(const Scene& common, Index k) {
  Scene scene = common;
  const Index m = scene.states(), n = scene.constraints();
  const double part = 0.05 * double(k);
  scene.x0 *= 1 - part;
  scene.f = [m, part](double t, Eigen::Ref<Vector> f) {
    for (Index i = 0; i < m; ++i) f[i] = std::cos(2 * t + double(i) + part);
  };
  scene.g = [n, part](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = std::sin(3 * t + double(i) - part) - 0.2;
  };
  return scene;
}

RowMatrix sampled(const TimeFunction& function, Index cols, double T) {
  RowMatrix rows(steps + 1, cols);
  Vector v(cols);
  for (Index j = 0; j <= steps; ++j) {
    function(T * double(j) / double(steps), v);
    rows.row(j) = v.transpose();
  }
  return rows;
}

double apart(const RowMatrix& a, const RowMatrix& b) {
  if (a.rows() != b.rows() || a.cols() != b.cols()) return INFINITY;
  return (a - b).cwiseAbs().maxCoeff<Eigen::PropagateNaN>() / std::max(1e-300, b.cwiseAbs().maxCoeff());
}

// Sources of all scenes, and the derivative of each alone.
struct Alone {
  std::vector<Result> results;
  std::vector<SolutionDerivative> derivatives;
  RowMatrix x0, f, g;

  Alone(const Scene& common, Index K) {
    const Index m = common.states(), n = common.constraints(), rows = steps + 1;
    x0.resize(K, m), f.resize(K * rows, m), g.resize(K * rows, n);
    for (Index k = 0; k < K; ++k) {
      const Scene scene = scene_of(common, k);
      x0.row(k) = scene.x0.transpose();
      f.middleRows(k * rows, rows) = sampled(scene.f, m, scene.T);
      g.middleRows(k * rows, rows) = sampled(scene.g, n, scene.T);
      results.push_back(run(scene, marched(steps)));
      derivatives.emplace_back(scene, results.back());
    }
  }
};

constexpr std::pair<Index, Index> sizes[] = {{1, 1}, {3, 2}, {4, 4}, {5, 3}, {8, 8}};

class BackendSceneArrays : public BackendTest {
 protected:
  std::unique_ptr<Array> table(Index rows, Index cols) { return backend->array(rows, cols); }
  RowMatrix of(const Array& all, Index k) { return host(all).middleRows(k * (steps + 1), steps + 1); }
};

TEST_P(BackendSceneArrays, AreSolvedAsTheyAreAlone) {
  for (const auto& [m, n] : sizes) {
    const Scene common = drawn(m, n);
    const Alone alone(common, scenes);
    const auto x0 = device(alone.x0), f = device(alone.f), g = device(alone.g);
    ArrayScenes together(common, *backend, steps, scenes);
    const std::vector<std::string> failures = together.solve({x0.get(), f.get(), g.get()});
    Index switching = 0;
    for (Index k = 0; k < scenes; ++k) {
      const Result& one = alone.results[std::size_t(k)];
      ASSERT_EQ(one.status, Status::solved) << one.reason;
      ASSERT_EQ(failures[std::size_t(k)], "");
      ASSERT_EQ(together.reasons()[std::size_t(k)], "");
      EXPECT_LE(apart(of(together.y(), k), one.y), same) << m << " " << n << ", scene " << k;
      EXPECT_LE(apart(of(together.x(), k), one.x), same) << m << " " << n << ", scene " << k;
      const DerivativeMargin margin = alone.derivatives[std::size_t(k)].margin();
      EXPECT_NEAR(together.margins()[std::size_t(k)].margin, margin.margin, 1e-9);
      EXPECT_EQ(together.margins()[std::size_t(k)].constraint, margin.constraint);
      switching += (one.y.array() > 0).any() && (one.y.array() == 0).any();
    }
    EXPECT_GT(switching, 0) << m << " " << n;
  }
}

TEST_P(BackendSceneArrays, HaveTheGradientsThatTheyHaveAlone) {
  for (const auto& [m, n] : sizes) {
    const Scene common = drawn(m, n);
    const Alone alone(common, scenes);
    const Index rows = scenes * (steps + 1);
    const auto x0 = device(alone.x0), f = device(alone.f), g = device(alone.g);
    ArrayScenes together(common, *backend, steps, scenes);
    together.solve({x0.get(), f.get(), g.get()});
    Random random(7);
    const RowMatrix of_y = random.matrix(rows, n), of_w = random.matrix(rows, n),
                    shared_x = random.matrix(steps + 1, m), of_integral = random.matrix(rows, n);
    const auto y = device(of_y), x = device(shared_x), w = device(of_w), integral = device(of_integral);
    const auto bar_x0 = table(scenes, m), bar_f = table(rows, m), bar_g = table(rows, n);
    ArrayScenes::ByMatrices by;
    const auto reasons =
        together.vjp({y.get(), x.get(), w.get(), integral.get()}, {bar_x0.get(), bar_f.get(), bar_g.get()}, &by);
    for (Index k = 0; k < scenes; ++k) {
      ASSERT_EQ(reasons[std::size_t(k)], "");
      const auto part = [&](const RowMatrix& all) { return RowMatrix(all.middleRows(k * (steps + 1), steps + 1)); };
      const DataChange one =
          alone.derivatives[std::size_t(k)].vjp({part(of_y), shared_x, part(of_w), part(of_integral)});
      const std::string where = std::to_string(m) + " " + std::to_string(n) + ", scene " + std::to_string(k);
      EXPECT_LE(apart(host(*bar_x0).row(k), RowMatrix(one.x0.transpose())), same) << where;
      EXPECT_LE(apart(of(*bar_f, k), one.f), same) << where;
      EXPECT_LE(apart(of(*bar_g, k), one.g), same) << where;
      // The derivative of e^{hA} is one product of stored directions here, and one exponential there.
      EXPECT_LE(apart(by.A[std::size_t(k)], one.A), same) << where;
      EXPECT_LE(apart(by.B[std::size_t(k)], one.B), same) << where;
      EXPECT_LE(apart(by.N[std::size_t(k)], one.N), same) << where;
      EXPECT_LE(apart(by.M[std::size_t(k)], one.M), same) << where;
    }
  }
}

TEST_P(BackendSceneArrays, ChangeAsTheyDoAlone) {
  for (const auto& [m, n] : sizes) {
    const Scene common = drawn(m, n);
    const DenseDynamics& d = *common.dynamics->small_state();
    const Alone alone(common, scenes);
    const Index rows = scenes * (steps + 1);
    const auto x0 = device(alone.x0), f = device(alone.f), g = device(alone.g);
    const SceneArraysProblem problem = scene_arrays_problem(d, to_dense(common.M), common.T, steps);
    const auto plan = make_scene_arrays(*backend, problem, scenes);
    const auto y = table(rows, n), x = table(rows, m), w = table(rows, n);
    plan->solve({x0.get(), f.get(), g.get()}, *y);
    plan->follow({x0.get(), f.get(), g.get()}, *y, *x, *w);
    Random random(8);
    const StepDirections directions(d.A, problem.h);
    const HeldPacked at{m, n};
    std::vector<DataChange> changes;
    RowMatrix packed = RowMatrix::Zero(scenes, at.size());
    const RowMatrix df = random.matrix(rows, m), dg = random.matrix(steps + 1, n), dx0 = random.matrix(scenes, m);
    for (Index k = 0; k < scenes; ++k) {
      DataChange c{dx0.row(k).transpose(),
                   df.middleRows(k * (steps + 1), steps + 1),
                   dg,
                   random.matrix(m, m),
                   random.matrix(m, n),
                   random.matrix(n, m),
                   random.matrix(n, n)};
      directions.forward(c.A, packed.row(k).data());
      const auto pack = [&](const Matrix& from, Index first) {
        Eigen::Map<RowMatrix>(packed.row(k).data() + first, from.rows(), from.cols()) = from;
      };
      pack(c.B, at.B()), pack(c.N, at.N()), pack(c.M, at.M());
      changes.push_back(std::move(c));
    }
    const auto given_x0 = device(dx0), given_f = device(df), given_g = device(dg), matrices = device(packed);
    const auto dy = table(rows, n), dx = table(rows, m), dw = table(rows, n), integral = table(rows, n);
    const std::vector<char> decided = plan->forward({{given_x0.get(), given_f.get(), given_g.get()}, matrices.get()},
                                                    {dy.get(), dx.get(), dw.get(), integral.get()});
    for (Index k = 0; k < scenes; ++k) {
      ASSERT_TRUE(decided[std::size_t(k)]);
      const SolutionChange one = alone.derivatives[std::size_t(k)].jvp(changes[std::size_t(k)]);
      EXPECT_LE(apart(of(*dy, k), one.y), same) << m << " " << n << ", scene " << k;
      EXPECT_LE(apart(of(*dx, k), one.x), same) << m << " " << n << ", scene " << k;
      EXPECT_LE(apart(of(*dw, k), one.w), same) << m << " " << n << ", scene " << k;
      EXPECT_LE(apart(of(*integral, k), one.integral), same) << m << " " << n << ", scene " << k;
    }
  }
}

// Scene 1 has NaN in x0, scene 2 starts at y = w = 0 and moves away, scene 3 stays at y = w = 0.
TEST_P(BackendSceneArrays, SpoilNothingWhereOneFails) {
  Scene common;
  common.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  common.M = Matrix{{1}};
  common.x0 = Vector{{-1}};
  common.T = 2;
  constexpr Index K = 40;
  RowMatrix x0 = RowMatrix::Constant(K, 1, -1);
  x0(1, 0) = std::numeric_limits<double>::quiet_NaN();
  x0(2, 0) = x0(3, 0) = 0;
  RowMatrix g = RowMatrix::Zero(K * (steps + 1), 1);
  for (Index j = 0; j <= steps; ++j) g(2 * (steps + 1) + j, 0) = -std::sin(0.05 * double(j));
  const auto given_x0 = device(x0), given_g = device(g);
  ArrayScenes together(common, *backend, steps, K);
  const auto failures = together.solve({given_x0.get(), nullptr, given_g.get()});
  const RowMatrix weights = RowMatrix::Ones(steps + 1, 1);
  const auto of_y = device(weights);
  const auto bar_x0 = table(K, 1), bar_f = table(K * (steps + 1), 1), bar_g = table(K * (steps + 1), 1);
  const auto reasons = together.vjp({of_y.get()}, {bar_x0.get(), bar_f.get(), bar_g.get()}, nullptr);
  for (Index k = 0; k < K; ++k) {
    EXPECT_EQ(failures[std::size_t(k)].empty(), k != 1) << k << failures[std::size_t(k)];
    EXPECT_EQ(together.reasons()[std::size_t(k)].empty(), k != 1 && k != 3) << k << together.reasons()[std::size_t(k)];
    EXPECT_EQ(reasons[std::size_t(k)].empty(), k == 0 || k > 3) << k << reasons[std::size_t(k)];
    if (k > 3) {
      EXPECT_EQ(of(*bar_g, k), of(*bar_g, 0)) << k;
      EXPECT_TRUE(of(*bar_g, k).allFinite());
    }
  }
  EXPECT_NE(reasons[2].find("one-sided"), std::string::npos) << reasons[2];
  EXPECT_NE(reasons[3].find("not differentiable here"), std::string::npos) << reasons[3];
}

// x' = 4 x from x0 > 0, where y acts: perturbations grow e^12 times. x' = -x from x0 < 0.
TEST_P(BackendSceneArrays, DoubtWhatGrows) {
  Scene common;
  common.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{5}}, Matrix{{-1}}};
  common.M = Matrix{{1}};
  common.x0 = Vector{{-1}};
  common.T = 3;
  constexpr Index K = 40;
  RowMatrix x0 = RowMatrix::Constant(K, 1, -1);
  x0(5, 0) = 1;
  const auto given_x0 = device(x0);
  ArrayScenes together(common, *backend, steps, K);
  const auto failures = together.solve({given_x0.get()});
  for (Index k = 0; k < K; ++k) EXPECT_EQ(failures[std::size_t(k)].empty(), k != 5) << k << failures[std::size_t(k)];
  EXPECT_NE(failures[5].find("too coarse"), std::string::npos) << failures[5];
  EXPECT_NE(together.reasons()[5].find("not solved"), std::string::npos) << together.reasons()[5];
}

// x0 of each scene and, with `own`, its sources; scene 3 has NaN in x0.
Batch batch_of_scenes(const Scene& common, bool own) {
  Batch batch;
  batch.common = scene_of(common, 0);
  batch.scenes = scenes;
  batch.x0.resize(scenes, common.states());
  for (Index k = 0; k < scenes; ++k) {
    const Scene scene = scene_of(common, k);
    batch.x0.row(k) = scene.x0.transpose();
    if (!own) continue;
    batch.f.push_back(scene.f), batch.g.push_back(scene.g);
  }
  batch.x0(3, 0) = std::numeric_limits<double>::quiet_NaN();
  return batch;
}

// Whether both have reasons for the same scenes.
void expect_same_reasons(const std::vector<std::string>& a, const std::vector<std::string>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t k = 0; k < a.size(); ++k) EXPECT_EQ(a[k].empty(), b[k].empty()) << k << a[k] << b[k];
}

TEST_P(BackendSceneArrays, DifferentiateABatchAsSingleScenes) {
  const auto cpu = make_cpu_backend(2);
  for (const auto& [m, n] : {std::pair<Index, Index>(1, 1), {4, 4}, {5, 3}})
    for (const bool own : {false, true}) {
      const Batch batch = batch_of_scenes(drawn(m, n), own);
      const BatchResult result = solve_batch(batch, *cpu, marched(steps));
      const BatchDerivative alone(batch, result), together(batch, result, {}, backend.get());
      EXPECT_EQ(alone.side_by_side(), 0);
      EXPECT_EQ(together.side_by_side(), scenes - 1) << m << " " << n << own;
      expect_same_reasons(together.reason(), alone.reason());
      Random random(9);
      std::vector<DataChange> changes;
      std::vector<SolutionChange> functions;
      for (Index k = 0; k < scenes; ++k) {
        changes.push_back({random.vector(m),
                           random.matrix(steps + 1, m),
                           {},
                           random.matrix(m, m),
                           random.matrix(m, n),
                           random.matrix(n, m),
                           random.matrix(n, n)});
        functions.push_back({random.matrix(steps + 1, n), random.matrix(steps + 1, m), {}, {}});
      }
      const auto one = alone.jvp(changes), other = together.jvp(changes);
      const auto back = alone.vjp(functions), bar = together.vjp(functions);
      expect_same_reasons(other.reason, one.reason);
      expect_same_reasons(bar.reason, back.reason);
      for (std::size_t k = 0; k < std::size_t(scenes); ++k) {
        const SolutionChange &a = other.value[k], &b = one.value[k];
        const DataChange &c = bar.value[k], &d = back.value[k];
        if (k == 3) {
          EXPECT_TRUE(a.y.array().isNaN().all() && c.x0.array().isNaN().all());
          continue;
        }
        for (const double off :
             {apart(a.y, b.y), apart(a.x, b.x), apart(a.w, b.w), apart(a.integral, b.integral), apart(c.x0, d.x0),
              apart(c.f, d.f), apart(c.g, d.g), apart(c.A, d.A), apart(c.B, d.B), apart(c.N, d.N), apart(c.M, d.M)})
          EXPECT_LE(off, same) << m << " " << n << ", scene " << k;
        EXPECT_NEAR(together.margin()[k].margin, alone.margin()[k].margin, 1e-9);
      }
    }
}

// Two start at y = w = 0, one of them stays there; f jumps inside a step in the second batch.
TEST_P(BackendSceneArrays, LeaveToSingleScenesWhatIsTheirs) {
  const auto cpu = make_cpu_backend(1);
  Batch batch;
  batch.common.dynamics = DenseDynamics{Matrix{{-1}}, Matrix{{1}}, Matrix{{1}}};
  batch.common.M = Matrix{{1}};
  batch.common.x0 = Vector{{-1}};
  batch.common.T = 2;
  batch.scenes = scenes;
  batch.x0 = RowMatrix::Constant(scenes, 1, -1);
  batch.x0(2, 0) = batch.x0(5, 0) = 0;
  for (Index k = 0; k < scenes; ++k)
    batch.g.push_back([k](double t, Eigen::Ref<Vector> g) { g[0] = k == 2 ? -std::sin(t) : 0.0; });
  for (const bool jumps : {false, true}) {
    if (jumps) {
      batch.common.f = [](double t, Eigen::Ref<Vector> f) { f[0] = t < 0.95 ? 0.0 : 0.5; };
      batch.common.breakpoints = {0.95};
    }
    const BatchResult result = solve_batch(batch, *cpu, marched(steps));
    const BatchDerivative alone(batch, result), together(batch, result, {}, backend.get());
    EXPECT_EQ(together.side_by_side(), jumps ? 0 : scenes - 1);
    expect_same_reasons(together.reason(), alone.reason());
    DataChange c;
    c.x0 = Vector{{1}};
    SolutionChange of;
    of.y = RowMatrix::Ones(steps + 1, 1);
    const auto one = alone.jvp({c}), other = together.jvp({c});
    const auto back = alone.vjp({of}), bar = together.vjp({of});
    expect_same_reasons(other.reason, one.reason);
    expect_same_reasons(bar.reason, back.reason);
    for (std::size_t k = 0; k < std::size_t(scenes); ++k) {
      if (!one.reason[k].empty()) continue;
      EXPECT_LE(apart(other.value[k].y, one.value[k].y), same) << k;
      EXPECT_LE(apart(bar.value[k].g, back.value[k].g), same) << k;
    }
    if (jumps) continue;
    c.x0 = Vector{{1, 1}};
    EXPECT_THROW(together.jvp({c}), Error);
    of.y = RowMatrix::Ones(steps, 1);
    EXPECT_THROW(together.vjp({of}), Error);
  }
}

TEST_P(BackendSceneArrays, RefuseWhatTheyDoNotTake) {
  Scene scene = drawn(9, 2);
  EXPECT_THROW(ArrayScenes(scene, *backend, steps, 2), Error) << "nine states";
  scene = drawn(3, 2);
  EXPECT_THROW(ArrayScenes(scene, *backend, 0, 2), Error) << "no steps";
  scene.M = Matrix::Zero(2, 2);
  EXPECT_THROW(ArrayScenes(scene, *backend, steps, 2), Error) << "y may jump";
  scene = drawn(3, 2);
  ArrayScenes together(scene, *backend, steps, 1);
  const auto bar_x0 = table(1, 3), bar_f = table(steps + 1, 3), bar_g = table(steps + 1, 2);
  EXPECT_THROW(together.vjp({}, {bar_x0.get(), bar_f.get(), bar_g.get()}, nullptr), Error) << "before a solve";
}

INSTANTIATE_TEST_SUITE_P(Contract, BackendSceneArrays, testing::ValuesIn(backend_cases()), backend_case_name);

}  // namespace
}  // namespace bromwich::scene_arrays_test
