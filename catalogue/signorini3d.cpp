// Heat conduction in the unit cube with a unilateral (Signorini) condition on the face x1 = 0: `signorini` with one
// direction more. Finite differences on a Q x Q x Q grid, dx = 1/(Q+1).
//
// symbol  here            meaning
// V       state           temperature at the interior points, lines of x1 stacked over x3 and x2 (x2 slowest)
// Y       y               boundary value shifted by the obstacle psi, Y = V(0, x2, x3) - psi
// A1      -               second difference / dx^2; A = c (A1 ⊗ I ⊗ I + I ⊗ A1 ⊗ I + I ⊗ I ⊗ A1),
//                         M = 2 I - dx^2 (A1 ⊗ I + I ⊗ A1): 6 on the diagonal, -1 for each of four neighbours
// B, N    I ⊗ b, I ⊗ n^T  b = c/dx^2 e_1, n = -2 e_1
// f, g    B psi, M psi
// V(0)    x0              8 Π x_i (1 - x_i)
//
// psi is 4/(1+t) in a frame along the edges of the face, and a wave in each quadrant of its middle, whose phases let
// the contact rotate through the quadrants:
//
//     psi = 4/(1+t)                  where max(|x2 - 1/2|, |x3 - 1/2|) >= 1/4,
//     psi = sin(2 pi t - k pi/2)     elsewhere, k = 0 (x2, x3 < 1/2), 1 (x2 >= 1/2 alone), 2 (both), 3 (x3 alone).

#include "catalogue/recipes.hpp"
#include "core/scene/separable.hpp"

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

namespace bromwich {
namespace {

constexpr double most_points_of_edge = 511;

SparseMatrix five_points(Index Q) {
  SparseMatrix M(Q * Q, Q * Q);
  M.reserve(Eigen::VectorXi::Constant(Q * Q, 5));
  for (Index i = 0; i < Q * Q; ++i) {
    M.insert(i, i) = 6;
    if (i >= Q) M.insert(i - Q, i) = -1;
    if (i + Q < Q * Q) M.insert(i + Q, i) = -1;
    if (i % Q > 0) M.insert(i - 1, i) = -1;
    if (i % Q + 1 < Q) M.insert(i + 1, i) = -1;
  }
  M.makeCompressed();
  return M;
}

/// psi(t, x2, x3) at the Q^2 points of the face: shapes of the frame, of sin 2 pi t and of cos 2 pi t.
SeparableSource face_obstacle(Index Q) {
  const Index cells = Q + 1;
  Matrix shapes = Matrix::Zero(Q * Q, 3);
  const auto outside = [cells](Index i) { return std::abs(4 * i - 2 * cells) >= cells; };  // in units of dx/4: exact
  for (Index i = 1; i <= Q; ++i)
    for (Index j = 1; j <= Q; ++j) {
      const Index at = (i - 1) * Q + j - 1;
      const bool upper2 = 2 * i >= cells, upper3 = 2 * j >= cells;
      if (outside(i) || outside(j))
        shapes(at, 0) = 1;
      else if (upper2 == upper3)
        shapes(at, 1) = upper2 ? -1 : 1;  // sin(2 pi t - pi) = -sin 2 pi t
      else
        shapes(at, 2) = upper2 ? -1 : 1;  // sin(2 pi t - pi/2) = -cos 2 pi t
    }
  return {shapes, [](double t, Eigen::Ref<Vector> a) {
            const double angle = 2 * std::numbers::pi * t;
            a << 4 / (1 + t), std::sin(angle), std::cos(angle);
          }};
}

Scene build_signorini3d(const ParameterValues& values) {
  const double given = values.at("Q");
  if (!(given >= 1 && given <= most_points_of_edge) || given != std::floor(given))
    throw Error("Q", "found " + number_text(given), "give an integer from 1 to 511");
  const Index Q = Index(given);
  Scene scene;
  scene.dynamics = heat_with_boundary_value(Q, 3, positive_parameter(values, "c"));
  SparseMatrix M = five_points(Q);
  const SeparableSource psi = face_obstacle(Q);
  scene.f = psi;
  scene.breakpoints_are_all = true;
  scene.f_entry = SourceEntry::through_B;
  scene.g = SeparableSource{M * psi.shapes, psi.time};
  scene.M = SparseLcpMatrix(std::move(M));
  scene.lcp_class = LcpClass::P;  // strictly diagonally dominant with positive diagonal
  const Vector line = bump(Q);
  scene.x0.resize(Q * Q * Q);
  for (Index i = 0; i < Q; ++i)
    for (Index j = 0; j < Q; ++j) scene.x0.segment((i * Q + j) * Q, Q) = 8 * line[i] * line[j] * line;
  scene.T = positive_parameter(values, "T");
  scene.default_steps = 256;
  return scene;
}

}  // namespace

SceneRecipe signorini3d_recipe() {
  return {"signorini3d",
          "heat in a cube with a unilateral condition on one face, Q x Q x Q interior points",
          {{"Q", 31, "interior points per edge, 1 to 511"}, {"c", 2e-3, "diffusivity"}, {"T", 4, "final time"}},
          build_signorini3d};
}

}  // namespace bromwich
