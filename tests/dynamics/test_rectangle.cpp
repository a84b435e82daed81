// Rectangles and boxes: which are Kronecker sums in modes, the same as those written out, and solves of both.

#include "core/dynamics/rectangle.hpp"

#include "core/base/error.hpp"
#include "core/dynamics/dynamics.hpp"
#include "core/dynamics/sparse.hpp"
#include "core/lcp/stencil.hpp"
#include "tests/support/run.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace bromwich {
namespace {

GridLine line(Index points, EndCondition first, EndCondition last) {
  return {points, GridLine::spacing_of(points, 1, first, last), 0.05, 0, first, last};
}

// 24 x 24 points: above 512 states.
Rectangle rectangle(EndCondition first, EndCondition last, double reaction) {
  Rectangle r;
  r.along = line(24, dirichlet, dirichlet), r.across = line(24, first, last), r.reaction = reaction;
  r.b = r.n = Vector::Zero(24);
  r.b[0] = 1 / r.across.spacing, r.n[0] = 1.5, r.n[1] = -0.5;
  return r;
}

Rectangle written_out(Rectangle r) {
  r.written_out = true;
  return r;
}

SparseMatrix matrix_of(const Dynamics& d) {
  if (const auto* modes = get_if<KroneckerDynamics>(&d)) return to_sparse(*modes).A;
  return get<SparseDynamics>(d).A;
}

Scene contact_on(const Rectangle& r, double compliance) {
  Scene scene;
  scene.name = "rectangle";
  scene.dynamics = r;
  const Index n = r.lines() * r.sides(), points = r.across.points;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.g = [n](double t, Eigen::Ref<Vector> g) {
    for (Index i = 0; i < n; ++i) g[i] = 0.3 * std::sin(4 * t + 0.2 * double(i)) - 0.1;
  };
  scene.x0 = Vector::NullaryExpr(
      r.states(), [&](Index i) { return 0.2 * std::cos(double(i % points) / 9) + 0.01 * double(i % 7); });
  scene.T = 1;
  return scene;
}

TEST(Rectangle, TakesModesWhereThereAreSome) {
  const auto in_modes = [](const Rectangle& r) { return holds<KroneckerDynamics>(Dynamics(r)); };
  EXPECT_TRUE(in_modes(rectangle(dirichlet, dirichlet, 0)));
  for (const auto& [first, last] : {std::pair(neumann, dirichlet),
                                    {dirichlet, neumann},
                                    {neumann, neumann},
                                    {EndCondition(2.), EndCondition(0.3)}}) {
    EXPECT_TRUE(in_modes(rectangle(first, last, 0)));
    EXPECT_TRUE(in_modes(rectangle(first, last, 0.8)));
  }
  EXPECT_TRUE(in_modes(rectangle(neumann, dirichlet, -0.1))) << "it decays all the same";
  EXPECT_FALSE(in_modes(rectangle(neumann, neumann, -3))) << "it grows";
  Rectangle r = rectangle(neumann, dirichlet, 0);
  r.along.last = neumann;
  EXPECT_TRUE(in_modes(r));
  r.along.points = 4097;
  EXPECT_FALSE(r.in_modes()) << "the matrix of its modes is too large";
  r.along.last = dirichlet;
  EXPECT_TRUE(r.in_modes());
  r = rectangle(neumann, dirichlet, 0);
  r.far_b = r.b, r.far_n = r.n;
  EXPECT_FALSE(in_modes(r)) << "two sides";
  r = rectangle(neumann, dirichlet, 0);
  r.across.advection = 0.1;
  EXPECT_FALSE(in_modes(r));
  r = rectangle(neumann, dirichlet, 0);
  r.along.points = 20;
  EXPECT_FALSE(in_modes(r)) << "480 states are dense, for all methods";
}

TEST(Rectangle, ModesAreThoseOfTheMatrix) {
  for (const auto& [first, last] :
       {std::pair(neumann, dirichlet), {neumann, neumann}, {EndCondition(2.), EndCondition(0.3)}}) {
    const Rectangle r = rectangle(first, last, 0.8);
    const SparseMatrix difference = matrix_of(Dynamics(r)) - matrix_of(Dynamics(written_out(r)));
    // Sums of a few terms of the diagonal's size, in another order.
    EXPECT_LE(Matrix(difference).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(), 16 * epsilon * 4 * 0.05 * 25 * 25);
  }
}

// y, w and states of both kinds. Each has weights of its own: a fit of exponentials beside the eigenvalues of the whole
// matrix, each to 1e-12 or better, their sums over the steps and the constraint in M + W_0 amplify below 1e4.
TEST(Rectangle, ModesSolveWhatTheMatricesDo) {
  constexpr double same = 1e-8;
  for (const double compliance : {0.0, 0.7})
    for (const auto& [first, last] : {std::pair(neumann, dirichlet),
                                      {neumann, neumann},
                                      {EndCondition(2.), EndCondition(0.3)},
                                      {dirichlet, neumann}}) {
      Rectangle r = rectangle(first, last, 0.8);
      r.n = Vector::Unit(24, 0);
      for (const Method method : {Method::march, Method::euler}) {
        if (method == Method::euler && (compliance == 0 || !last)) continue;
        Options options = options_for(method, 64);
        options.states = StateSelection::list;
        options.components = {0, 5, 23, 24 * 11 + 3, 24 * 24 - 1};
        const Result modes = run(contact_on(r, compliance), options),
                     sparse = run(contact_on(written_out(r), compliance), options);
        ASSERT_EQ(modes.status, Status::solved) << modes.reason;
        ASSERT_EQ(sparse.status, Status::solved) << sparse.reason;
        const std::string what = std::string(to_string(method)) + ", compliance " + std::to_string(compliance) +
                                 (first ? ", first " + std::to_string(*first) : "") + ": " + modes.kernel + " / " +
                                 sparse.kernel;
        if (method == Method::march) {
          ASSERT_EQ(modes.continuous, sparse.continuous) << what;
        }
        EXPECT_GT((modes.y.array() > 0).count(), 100) << what;
        EXPECT_LE((modes.y - sparse.y).bottomRows(64).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
                  same * sparse.y.maxCoeff())
            << what;
        EXPECT_LE(distance(modes.x, sparse.x), same * (1 + sparse.x.cwiseAbs().maxCoeff<Eigen::PropagateNaN>()))
            << what;
      }
    }
}

// Sweeps and cycles of both forms, against marching in modes with the same weights.
TEST(Rectangle, AllMethodsTakeReflectingEnds) {
  const Rectangle r = rectangle(neumann, EndCondition(0.3), 0.2);
  const Scene stiff = contact_on(r, 3);
  const RowMatrix known = solved_y(stiff, Method::march, 128);
  for (const Method method : {Method::contour, Method::multigrid})
    EXPECT_LE((solved_y(stiff, method, 128) - known).bottomRows(128).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
              1e-7 * known.maxCoeff())
        << to_string(method);
  // Cycles in w step implicit Euler or Radau stages: of the order of the step, which is what method euler differs by.
  const Scene rigid = contact_on(r, 0);
  const RowMatrix cycled = solved_y(rigid, Method::dual, 128), euler = solved_y(rigid, Method::euler, 128),
                  march = solved_y(rigid, Method::march, 128);
  EXPECT_LE((cycled - march).bottomRows(128).cwiseAbs().mean(),
            1.1 * (euler - march).bottomRows(128).cwiseAbs().mean());
}

// Ends of the sides beside the contact. Tolerances as above.
TEST(Rectangle, ModesTakeAllEndsAlongTheContact) {
  constexpr double same = 1e-8;
  for (const auto& [first, last] : {std::pair(neumann, neumann),
                                    {neumann, dirichlet},
                                    {EndCondition(2.), EndCondition(0.3)},
                                    {dirichlet, EndCondition(5.)}})
    for (const double compliance : {0.0, 0.7}) {
      Rectangle r = rectangle(neumann, EndCondition(0.4), 0.3);
      r.n = Vector::Unit(24, 0);
      r.along = line(26, first, last);
      ASSERT_TRUE(holds<KroneckerDynamics>(Dynamics(r)));
      Options options = options_for(Method::march, 64);
      options.states = StateSelection::list;
      options.components = {0, 5, 23, 24 * 11 + 3, 24 * 26 - 1};
      const Result modes = run(contact_on(r, compliance), options),
                   sparse = run(contact_on(written_out(r), compliance), options);
      ASSERT_EQ(modes.status, Status::solved) << modes.reason;
      ASSERT_EQ(sparse.status, Status::solved) << sparse.reason;
      ASSERT_EQ(modes.continuous, sparse.continuous);
      EXPECT_GT((modes.y.array() > 0).count(), 100);
      EXPECT_LE(distance(modes.y.bottomRows(64), sparse.y.bottomRows(64)), same * sparse.y.maxCoeff()) << modes.kernel;
      EXPECT_LE(distance(modes.x, sparse.x), same * (1 + sparse.x.cwiseAbs().maxCoeff())) << modes.kernel;
    }
}

// M of the same ends is diagonal in the modes, a multiple of the identity in any, a stencil with Dirichlet ends in
// none.
TEST(Rectangle, AllMethodsTakeAllEndsAlongTheContact) {
  Rectangle r = rectangle(neumann, EndCondition(0.3), 0.2);
  r.along = line(26, neumann, EndCondition(1.5));
  SecondDifference ends = r.in_modes()->along;
  ends.decay = 0;
  const double scale = ends.diffusivity / (ends.spacing * ends.spacing);
  const auto tridiagonal = [&](double first, double last) {
    Tridiagonal M{Vector::Constant(26, -0.5), Vector::Constant(26, 4), Vector::Constant(26, -0.5)};
    M.diagonal[0] -= 0.5 * first, M.diagonal[25] -= 0.5 * last;
    return M;
  };
  EXPECT_LE((*eigenvalues_in(ends.basis(), tridiagonal(ends.first, ends.last)) -
             (3 - 0.5 / scale * ends.eigenvalues().array()).matrix())
                .cwiseAbs()
                .maxCoeff(),
            1e-13);
  EXPECT_FALSE(eigenvalues_in(ends.basis(), tridiagonal(0, 0)));
  for (const LcpMatrix& M :
       {LcpMatrix(contact_on(r, 3).M), LcpMatrix(tridiagonal(ends.first, ends.last)), LcpMatrix(tridiagonal(0, 0))}) {
    Scene stiff = contact_on(r, 3), sparse = contact_on(written_out(r), 3);
    stiff.M = sparse.M = M;
    const RowMatrix known = solved_y(stiff, Method::march, 128);
    EXPECT_GT((known.array() > 0).count(), 100);
    EXPECT_LE(distance(known.bottomRows(128), solved_y(sparse, Method::march, 128).bottomRows(128)),
              1e-8 * known.maxCoeff());
    for (const Method method : {Method::contour, Method::multigrid})
      EXPECT_LE(distance(solved_y(stiff, method, 128).bottomRows(128), known.bottomRows(128)), 1e-7 * known.maxCoeff())
          << to_string(method);
  }
  const Scene rigid = contact_on(r, 0);
  const RowMatrix cycled = solved_y(rigid, Method::dual, 128), euler = solved_y(rigid, Method::euler, 128),
                  march = solved_y(rigid, Method::march, 128);
  EXPECT_LE((cycled - march).bottomRows(128).cwiseAbs().mean(),
            1.1 * (euler - march).bottomRows(128).cwiseAbs().mean());
}

Rectangle box(Index along, Index beside, Index across, EndCondition first) {
  Rectangle r;
  r.along = line(along, dirichlet, dirichlet), r.across = line(across, first, dirichlet);
  r.beside = {line(beside, dirichlet, dirichlet)};
  r.beside[0].diffusivity = 0.08;
  r.b = r.n = Vector::Unit(across, 0);
  r.b *= 5;
  return r;
}

// The Laplacian of a box entry by entry, from its points.
TEST(Rectangle, BoxesAreSumsOfThreeDirections) {
  const Rectangle r = box(3, 2, 4, dirichlet);
  ASSERT_TRUE(holds<KroneckerDynamics>(Dynamics(r)));
  const auto number = [](Index i, Index j, Index k) { return (i * 2 + j) * 4 + k; };
  Matrix expected = Matrix::Zero(24, 24);
  const auto couple = [&](Index a, Index b, const GridLine& d) {
    expected(a, b) += d.diffusivity / (d.spacing * d.spacing);
  };
  for (Index i = 0; i < 3; ++i)
    for (Index j = 0; j < 2; ++j)
      for (Index k = 0; k < 4; ++k) {
        const Index at = number(i, j, k);
        for (const GridLine* d : {&r.along, &r.beside[0], &r.across})
          expected(at, at) -= 2 * d->diffusivity / (d->spacing * d->spacing);
        for (const Index s : {-1, 1}) {
          if (i + s >= 0 && i + s < 3) couple(at, number(i + s, j, k), r.along);
          if (j + s >= 0 && j + s < 2) couple(at, number(i, j + s, k), r.beside[0]);
          if (k + s >= 0 && k + s < 4) couple(at, number(i, j, k + s), r.across);
        }
      }
  for (const Rectangle& each : {r, written_out(r)})
    EXPECT_LE((Matrix(matrix_of(Dynamics(each))) - expected).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
              8 * epsilon * expected.cwiseAbs().maxCoeff<Eigen::PropagateNaN>());
  const Dynamics sparse{written_out(r)};
  EXPECT_EQ(get<SparseDynamics>(sparse).B.coeff(number(2, 1, 0), 2 * 2 + 1), 5) << "face index: along slowest";
}

TEST(Rectangle, BoxesAreSolvedInModes) {
  for (const EndCondition& first : {EndCondition(dirichlet), EndCondition(neumann), EndCondition(0.5)}) {
    Rectangle r = box(4, 5, 26, first);
    if (first && *first > 0) r.along = line(4, neumann, neumann), r.beside[0] = line(5, dirichlet, EndCondition(2.));
    ASSERT_TRUE(holds<KroneckerDynamics>(Dynamics(r)));
    for (const double compliance : {0.5, 4.0}) {
      const Scene modes = contact_on(r, compliance), sparse = contact_on(written_out(r), compliance);
      const RowMatrix known = solved_y(sparse, Method::march, 48);
      EXPECT_GT((known.array() > 0).count(), 100);
      EXPECT_LE((solved_y(modes, Method::march, 48) - known).bottomRows(48).cwiseAbs().maxCoeff<Eigen::PropagateNaN>(),
                1e-8 * known.maxCoeff());
      if (compliance < 1) continue;
      EXPECT_LE(distance(solved_y(modes, Method::multigrid, 48).bottomRows(48), known.bottomRows(48)),
                1e-7 * known.maxCoeff());
    }
  }
}

TEST(Rectangle, BadDirectionsAreNamed) {
  const auto refusal = [](const Rectangle& r) -> std::string {
    try {
      Dynamics made{r};
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  Rectangle r = box(3, 2, 4, dirichlet);
  r.beside[0].spacing = 0;
  EXPECT_TRUE(refusal(r).starts_with("beside[0].spacing: is 0; give a positive")) << refusal(r);
  r = box(3, 2, 4, dirichlet);
  r.across.first = -1;
  EXPECT_TRUE(refusal(r).starts_with("across.first: is -1; give a Robin coefficient")) << refusal(r);
  KroneckerDynamics d = *box(3, 2, 4, dirichlet).in_modes();
  d.along.first = 1.5;
  EXPECT_THROW(Dynamics(d)->validate(false), Error);
  d = *box(3, 2, 4, dirichlet).in_modes();
  d.across.last = 1.5;
  EXPECT_THROW(Dynamics(d)->validate(false), Error);
}

// A diagonal M on a face is a stencil, however it is stored.
TEST(Rectangle, ADiagonalMatrixIsAStencilOnAFace) {
  const Tridiagonal same{Vector::Zero(6), Vector::Constant(6, 0.3), Vector::Zero(6)};
  const auto found = stencil_of(same, {2, 3});
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->centre, 0.3);
  Tridiagonal other = same;
  other.diagonal[4] = 0.4;
  EXPECT_FALSE(stencil_of(other, {2, 3}).has_value());
  other = same;
  other.upper[2] = other.lower[3] = 0.1;  // across the end of a row of the face
  EXPECT_FALSE(stencil_of(other, {2, 3}).has_value());
}

}  // namespace
}  // namespace bromwich
