// The contours of contour-literal for the remarks of the paper of Wu and Chen, against dense exponentials: Remarks 2.1
// and 2.4 where the printed contour does not enclose the spectrum, Remark 2.3 for e^{At} x0, and the nodes that a step
// asks for. Errors only; no times.

#include "bench/studies/study.hpp"
#include "core/numerics/literal_contour.hpp"
#include "core/numerics/matrix_phi.hpp"

#include <fmt/format.h>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <cmath>
#include <numbers>

namespace bromwich::app {

namespace {

Matrix damped(double degrees) { return Matrix{{0, 1}, {-1, -2 * std::cos(degrees * std::numbers::pi / 180)}}; }

struct Case {
  const char* name;
  Matrix A;
};

std::vector<Case> cases() {
  Matrix all = Matrix::Zero(5, 5);
  all.topLeftCorner(2, 2) = damped(90);
  all.bottomRightCorner(3, 3) << 0, 1, 0, 0, 1.5, 1, 0, 0, -4;
  all.bottomLeftCorner(3, 2).setOnes();
  return {{"zero, twice", Matrix{{0, 1}, {0, 0}}},
          {"imaginary", damped(90)},
          {"unstable", Matrix{{1.5, 1}, {0, -4}}},
          {"all of them", all},
          {"44.5 degrees", damped(44.5)},
          {"70 degrees", damped(70)},
          {"85 degrees", damped(85)}};
}

/// The error of ∫_0^t e^{A(t-s)} ds, relative to t or to the integral where that grows.
double error_of(const Contour& contour, const Matrix& A, double t) {
  const ComplexMatrix unit = ComplexMatrix::Identity(A.rows(), A.cols());
  ComplexMatrix sum = ComplexMatrix::Zero(A.rows(), A.cols());
  for (Index p = 0; p < contour.nodes.size(); ++p) {
    const Complex z = contour.nodes[p];
    sum += contour.weights[p] * (std::exp(z * t) - 1.0) / z * (z * unit - A.cast<Complex>()).inverse();
  }
  const Matrix exact = t * matrix_phi(t * A).phi1;
  return (sum.real() - exact).cwiseAbs().maxCoeff() / std::max(t, exact.cwiseAbs().maxCoeff());
}

double printed_rate(Index P) { return std::exp(-2.06 * std::sqrt(double(P))) / std::sqrt(double(P)); }

void around_spectra(BenchReport& report, std::vector<std::vector<std::string>>& lines) {
  for (const auto& [name, A] : cases())
    for (const Index P : {9, 16, 25, 49, 64, 100}) {
      const ComplexVector eigenvalues = Eigen::EigenSolver<Matrix>(A, false).eigenvalues();
      double worst = 0;
      Index nodes = 0;
      for (int i = 0; i <= 40; ++i) {
        const double t = std::pow(10, -2 + i / 10.);
        const Contour contour = contour_around(eigenvalues, P, t);
        worst = std::max(worst, error_of(contour, A, t)), nodes = std::max(nodes, contour.nodes.size());
      }
      report.rows.push_back({{"part", "around"},
                             {"spectrum", name},
                             {"P", P},
                             {"most_nodes", nodes},
                             {"error", worst},
                             {"printed_rate", printed_rate(P)}});
      lines.push_back(
          {name, fmt::format("{}", P), fmt::format("{}", nodes), scientific(worst), scientific(printed_rate(P))});
    }
}

void initial_values(BenchReport& report, std::vector<std::vector<std::string>>& lines) {
  for (const Index P : {4, 6, 8, 10, 12, 14, 16, 20}) {
    const Contour contour = window_contour(initial_value_parameters(P), 1);
    double worst = 0;
    for (int i = 0; i <= 500; ++i) {
      const double a = -std::pow(10.0, -3 + i / 50.0);
      const double sum =
          (contour.weights.array() * contour.nodes.array().exp() / (contour.nodes.array() - a)).sum().real();
      worst = std::max(worst, std::abs(sum - std::exp(a)));
    }
    report.rows.push_back(
        {{"part", "initial"}, {"P", P}, {"error", worst}, {"printed_rate", std::exp(-2.32 * double(P))}});
    lines.push_back({"e^{At} x0, real", fmt::format("{}", P), fmt::format("{}", P + 1), scientific(worst),
                     scientific(std::exp(-2.32 * double(P)))});
  }
}

/// The fewest nodes with an error of at most h, real spectra.
void nodes_of_steps(BenchReport& report) {
  for (int decade = 1; decade <= 10; ++decade) {
    const double h = std::pow(10, -decade);
    Index rate = 2, found = 2;
    while (printed_rate(rate) > h) ++rate;
    const auto error = [](Index P) {
      const Contour contour = literal_contour(P, 1);
      double worst = 0;
      for (int i = 0; i <= 160; ++i)
        worst = std::max(worst, error_of(contour, Matrix{{-std::pow(10, -2 + i / 20.)}}, 1));
      return worst;
    };
    while (found < 400 && error(found) > h) ++found;
    report.rows.push_back({{"part", "nodes of a step"}, {"h", h}, {"by_the_rate", rate}, {"found", found}});
  }
}

}  // namespace

BenchReport bench_contours(const BenchRequest& request, Backend&) {
  refuse_scene(request);
  BenchReport report;
  std::vector<std::vector<std::string>> lines{{"spectrum", "P", "nodes", "error", "printed rate"}};
  around_spectra(report, lines);
  initial_values(report, lines);
  nodes_of_steps(report);
  report.details = {{"around",
                     "largest error of the integral of e^{As} over [0, t], t = 0.01 to 100, relative to t or to the "
                     "integral where that grows"},
                    {"initial", "largest error of e^{a}, a = -1e-3 to -1e7"},
                    {"nodes of a step",
                     "fewest P with an error of the integral of e^{as} over [0, 1] of at most h, a = -0.01 "
                     "to -1e6, and by e^{-2.06 sqrt P}/sqrt P"}};
  print_with_notes(table(lines), report);
  return report;
}

}  // namespace bromwich::app
