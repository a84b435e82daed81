// Properties of the spaces of functions in time, independent of a method: projections of the exact control, and
// monotonicity of the operator.

#include "app/commands.hpp"
#include "bench/studies/galerkin.hpp"
#include "catalogue/catalogue.hpp"
#include "core/galerkin/discretisation.hpp"
#include "core/galerkin/uniqueness.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace bromwich::app {

namespace {

constexpr Index most_dense_steps = 32;
constexpr Index pieces = 12;  ///< of an interval, with three Gauss points each

/// u of the bridge at the Gauss points of one interval, with their places and weights on [0, 1].
struct Sampled {
  std::array<double, 3 * pieces> s, weight, u;
};

Sampled sample(const Scene& scene, Index k, Index J) {
  const std::array<double, 3> node{0.5 - std::sqrt(0.15), 0.5, 0.5 + std::sqrt(0.15)}, weight{5. / 18, 4. / 9, 5. / 18};
  Sampled at;
  Vector x(scene.states()), y(1);
  for (Index c = 0; c < pieces; ++c)
    for (std::size_t p = 0; p < 3; ++p) {
      const std::size_t i = std::size_t(3 * c) + p;
      at.s[i] = (double(c) + node[p]) / pieces;
      at.weight[i] = weight[p] / pieces;
      scene.exact(scene.T * (double(k) + at.s[i]) / double(J), x, y);
      at.u[i] = y[0];
    }
  return at;
}

/// (∫ u (1-s), ∫ u s) on [0, 1].
Eigen::Vector2d moments(const Sampled& at) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < at.s.size(); ++i) sum += at.weight[i] * at.u[i] * Eigen::Vector2d(1 - at.s[i], at.s[i]);
  return sum;
}

/// ∫ (a (1-s) + b s - u)^2 on [0, 1].
double squared_distance(const Sampled& at, double a, double b) {
  double sum = 0;
  for (std::size_t i = 0; i < at.s.size(); ++i)
    sum += at.weight[i] * std::pow(a * (1 - at.s[i]) + b * at.s[i] - at.u[i], 2);
  return sum;
}

/// The nearest a, b >= 0 in the mass matrix [2 1; 1 2]/6.
Eigen::Vector2d nearest_linear(const Eigen::Vector2d& moment) {
  Eigen::Vector2d ends = Eigen::Matrix2d{{4, -2}, {-2, 4}} * moment;
  if (ends[0] < 0) return {0, std::max(3 * moment[1], 0.)};
  if (ends[1] < 0) return {std::max(3 * moment[0], 0.), 0};
  return ends;
}

/// The nearest continuous one: J+1 values v >= 0 with the tridiagonal mass matrix (condition number 3), by projected
/// Gauss-Seidel.
Vector nearest_continuous(const std::vector<Eigen::Vector2d>& moment) {
  const Index J = Index(moment.size());
  Vector right = Vector::Zero(J + 1), v = Vector::Zero(J + 1);
  for (Index k = 0; k < J; ++k) right.segment(k, 2) += moment[std::size_t(k)];
  for (int sweep = 0; sweep < 500; ++sweep) {
    double change = 0;
    for (Index j = 0; j <= J; ++j) {
      const double beside = (j > 0 ? v[j - 1] : 0) + (j < J ? v[j + 1] : 0);
      const double diagonal = j == 0 || j == J ? 2 : 4;
      const double value = std::max((6 * right[j] - beside) / diagonal, 0.);
      change = std::max(change, std::abs(value - v[j]));
      v[j] = value;
    }
    if (change <= 1e-15) break;
  }
  return v;
}

void project(const Scene& bridge, const char* grid, Index J, std::vector<std::vector<std::string>>& text,
             BenchReport& report) {
  std::vector<Eigen::Vector2d> moment;
  double constant = 0, discontinuous = 0, continuous = 0;
  for (Index k = 0; k < J; ++k) {
    const Sampled at = sample(bridge, k, J);
    moment.push_back(moments(at));
    constant += squared_distance(at, moment.back().sum(), moment.back().sum());
    const Eigen::Vector2d ends = nearest_linear(moment.back());
    discontinuous += squared_distance(at, ends[0], ends[1]);
  }
  const Vector v = nearest_continuous(moment);
  for (Index k = 0; k < J; ++k) continuous += squared_distance(sample(bridge, k, J), v[k], v[k + 1]);
  const double h = bridge.T / double(J);
  const auto norm = [h](double sum) { return std::sqrt(h * sum); };
  report.rows.push_back({{"part", "projection"},
                         {"scene", "bridge"},
                         {"grid", grid},
                         {"steps", J},
                         {"h", h},
                         {"constant", norm(constant)},
                         {"continuous", norm(continuous)},
                         {"discontinuous", norm(discontinuous)}});
  text.push_back({grid, fmt::format("{}", J), scientific(norm(constant)), scientific(norm(continuous)),
                  scientific(norm(discontinuous))});
}

/// Smallest eigenvalue of the symmetric part for the matrix that the paper prints: below the diagonal it treats the
/// response of the state as constant after an interval, [N; N] H instead of C E^{k'-k-1} H.
double smallest_eigenvalue_as_printed(const Scene& scene, Index J) {
  const GalerkinProblem p = galerkin_problem(scene, J);
  const auto& [E, H, C, D, M] = p.first_step();
  const Index m = p.states(), block = p.unknowns(), n = block / 2, size = J * block;
  std::vector<Matrix> power{Matrix::Identity(m, m)};
  for (Index k = 0; k < J; ++k) power.push_back(E * power.back());
  const Matrix ends = (p.boundary.E0 + p.boundary.ET * power.back()).partialPivLu().solve(p.boundary.ET);
  Matrix constant(block, m);
  const Matrix N = to_dense(scene.dynamics).N;
  constant << N, N;
  Matrix L(size, size), mass = Matrix::Zero(size, size);
  for (Index row = 0; row < J; ++row)
    for (Index column = 0; column < J; ++column) {
      auto entry = L.block(row * block, column * block, block, block);
      entry = -C * power[std::size_t(row)] * ends * power[std::size_t(J - column - 1)] * H;
      if (row == column) entry += D;
      if (row > column) entry += constant * H;
    }
  for (Index k = 0; k < J; ++k)
    for (Index i = 0; i < n; ++i) {
      const Index left = k * block + i, right = left + n;
      mass(left, left) = mass(right, right) = 2. / 3;
      mass(left, right) = mass(right, left) = 1. / 3;
    }
  const Matrix symmetric = (L + L.transpose()) / 2;
  return Eigen::GeneralizedSelfAdjointEigenSolver<Matrix>(symmetric, mass, Eigen::EigenvaluesOnly)
      .eigenvalues()
      .minCoeff();
}

struct Operator {
  const char* scene;
  double regularisation, lambda;  ///< added to M; weight e^{-2 lambda t}
  bool as_printed;
  std::vector<double> horizons;
};

/// The paper shows its game with M + 0.1 I; the bridge is monotone only in a weighted norm.
void eigenvalues(const BenchRequest& request, BenchReport& report) {
  constexpr double pi = std::numbers::pi;
  std::vector<std::vector<std::string>> text{{"scene", "M +", "lambda", "T", "steps", "smallest eigenvalue"}};
  for (const auto& [name, regularisation, lambda, as_printed, horizons] :
       {Operator{"nash-game", 0.1, 0, false, {1, 0.5, 0.25, 0.1}},
        Operator{"nash-game", 0.1, 0, true, {1, 0.5, 0.25, 0.1}},
        Operator{"bridge", 0, 0, false, {3 * pi, 1.5 * pi, 1, 0.5}}, Operator{"bridge", 0, 1, false, {3 * pi}}}) {
    std::string found;
    for (const double T : horizons) {
      double smallest = NAN;
      for (const Index J : request.quick ? std::vector<Index>{8, 32} : std::vector<Index>{8, 16, 32, 64, 128, 256}) {
        Scene scene = make_scene(name);
        const Index n = scene.constraints();
        scene.T = T;
        scene.M = Matrix(to_dense(scene.M) + regularisation * Matrix::Identity(n, n));
        if (as_printed && J > most_dense_steps) break;
        smallest =
            as_printed ? smallest_eigenvalue_as_printed(scene, J) : smallest_symmetric_eigenvalue(scene, J, lambda);
        report.rows.push_back({{"part", "eigenvalue"},
                               {"scene", name},
                               {"regularisation", regularisation},
                               {"lambda", lambda},
                               {"as_printed", as_printed},
                               {"T", T},
                               {"steps", J},
                               {"smallest", smallest}});
        text.push_back({std::string(name) + (as_printed ? ", matrix of the paper" : ""),
                        fmt::format("{} I", regularisation), fmt::format("{}", lambda), fmt::format("{:.4g}", T),
                        fmt::format("{}", J), fmt::format("{:.4f}", smallest)});
      }
      found += fmt::format("{}{:.3f} at T = {:.3g}", found.empty() ? "" : ", ", smallest, T);
    }
    report.notes.push_back(fmt::format("smallest eigenvalue of the symmetric part, {}{}, M + {} I, lambda = {}: {}",
                                       name, as_printed ? " with the matrix that the paper prints" : "", regularisation,
                                       lambda, found));
  }
  print("smallest eigenvalue of the symmetric part\n" + table(text) + "\n");
}

}  // namespace

void study_spaces(const BenchRequest& request, Backend&, BenchReport& report) {
  const Scene bridge = make_scene("bridge");
  std::vector<std::vector<std::string>> text{{"grid", "steps", "constant", "continuous", "discontinuous"}};
  for (int k = 0; k < (request.quick ? 3 : 9); ++k) {
    project(bridge, "kinks on nodes", Index(24) << k, text, report);
    project(bridge, "kinks off nodes", Index(25) << k, text, report);
  }
  print("bridge, distance of the control from nonnegative functions\n" + table(text) + "\n");
  eigenvalues(request, report);
}

}  // namespace bromwich::app
