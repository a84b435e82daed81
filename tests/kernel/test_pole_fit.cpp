// Few poles in place of lag weights: weights, sources, components and coarser grids against the eigenvectors of a dense
// pencil, whole solves against dense twins, and what a fit refuses.

#include "core/base/error.hpp"
#include "core/host/stage_step.hpp"
#include "core/kernel/discretise.hpp"
#include "core/kernel/operators.hpp"
#include "core/kernel/pole_fit.hpp"
#include "core/kernel/pole_plans.hpp"
#include "core/kernel/wide_system.hpp"
#include "core/numerics/phi.hpp"
#include "core/solve/solve.hpp"
#include "cpu/cpu_backend.hpp"
#include "tests/support/dense_twin.hpp"

#include <gtest/gtest.h>
#include <Eigen/Eigenvalues>

#include <cmath>
#include <numbers>

namespace bromwich {
namespace {

using Triplets = std::vector<Eigen::Triplet<double>>;

SparseMatrix sparse_of_triplets(Index rows, Index cols, const Triplets& entries) {
  SparseMatrix A(rows, cols);
  A.setFromTriplets(entries.begin(), entries.end());
  return A;
}

// Diffusion with a varying coefficient on G x H cells, the G contacts along one side; `wind` along it. E is diagonal
// and not constant.
SparseDynamics plate(Index G, Index H, double wind = 0) {
  const double c = double(G) * double(G);
  Triplets A, E, B, N;
  const auto coefficient = [&](Index i, Index j) {
    return 0.1 * c * (1 + 0.6 * std::sin(3 * double(i) / double(G)) * std::cos(5 * double(j) / double(H)));
  };
  for (Index i = 0; i < G; ++i)
    for (Index j = 0; j < H; ++j) {
      const Index r = i * H + j;
      double sum = 0;
      const auto link = [&](bool inside, Index k, double across) {
        const double a = coefficient(i, j) + across;
        sum += a;
        if (inside) A.emplace_back(r, k, a + (k > r ? -wind : wind) * (k == r + H || k == r - H));
      };
      link(i > 0, r - H, i > 0 ? coefficient(i - 1, j) : 0);
      link(i + 1 < G, r + H, i + 1 < G ? coefficient(i + 1, j) : 0);
      if (j > 0) link(true, r - 1, coefficient(i, j - 1));  // the side j = 0 is insulated
      link(j + 1 < H, r + 1, j + 1 < H ? coefficient(i, j + 1) : 0);
      A.emplace_back(r, r, -sum);
      E.emplace_back(r, r, 1 + 0.5 * std::sin(double(i + 2 * j)));
    }
  for (Index i = 0; i < G; ++i) {
    B.emplace_back(i * H, i, double(G));
    N.emplace_back(i, i * H, 1.0);
  }
  const Index m = G * H;
  return {sparse_of_triplets(m, m, A), sparse_of_triplets(m, G, B), sparse_of_triplets(G, m, N),
          sparse_of_triplets(m, m, E)};
}

Scene contact(const SparseDynamics& d, double compliance) {
  const Index m = d.A.rows(), n = d.N.rows();
  Scene scene;
  scene.name = "plate";
  scene.dynamics = d;
  scene.M = Tridiagonal{Vector::Zero(n), Vector::Constant(n, compliance), Vector::Zero(n)};
  scene.f_entry = SourceEntry::through_F;
  scene.F = Matrix(Matrix::Ones(m, 2)).sparseView();
  for (Index i = 0; i < m; ++i) scene.F.coeffRef(i, 1) = std::cos(std::numbers::pi * double(i) / double(m));
  scene.f = [](double t, Eigen::Ref<Vector> phi) { phi << -1 - 2 * std::sin(9 * t), 3 * std::cos(7 * t); };
  scene.g = [](double, Eigen::Ref<Vector> g) { g.setConstant(0.02); };
  scene.x0 = Vector::Constant(m, 0.1);
  scene.T = 1;
  return scene;
}

// (zE - A)^{-1} = Q (z - lambda)^{-1} Q^T for symmetric A and E.
struct Modes {
  Vector lambda;
  Matrix NQ, QB, QF, Qx, Qc;

  Modes(const Scene& scene, const std::vector<Index>& components) {
    const auto& d = get<SparseDynamics>(scene.dynamics);
    const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> eigen(Matrix(d.A), Matrix(d.E));
    lambda = eigen.eigenvalues();
    const Matrix& Q = eigen.eigenvectors();
    NQ = d.N * Q;
    QB = Q.transpose() * d.B;
    QF = Q.transpose() * scene.F;
    Qx = Q.transpose() * (d.E * scene.x0);
    Qc = Q(components, Eigen::all);
  }
  Matrix at(const Matrix& outputs, const Eigen::ArrayXd& f, const Matrix& inputs) const {
    return outputs * f.matrix().asDiagonal() * inputs;
  }
  // The largest weighted |H|, to which the error of a fit is relative.
  double scale(double h) const {
    double largest = 0;
    for (double w = 0.1; w < 20 / h; w *= 1.1) {
      const ComplexVector r = (Complex(0, w) - lambda.array().cast<Complex>()).inverse().matrix();
      const double size = (NQ.cast<Complex>() * r.asDiagonal() * QB.cast<Complex>()).cwiseAbs().maxCoeff();
      largest = std::max(largest, std::sqrt(std::min(1.0, w * h)) * size);
    }
    return largest;
  }
};

constexpr Index G = 18, H = 16, J = 128;

struct Fitted {
  Scene scene = contact(plate(G, H), 0.05);
  std::unique_ptr<Backend> backend = make_cpu_backend(2);
  std::vector<Index> components{0, 5 * H + 3, G* H - 1};
  DiscreteProblem problem = discretise(scene, *backend, J, false);
  PoleFit fit = fit_pole_model(problem, components);
  Modes modes{scene, components};
};

RowMatrix convolved(Backend& backend, const PoleRecurrence& r, const RowMatrix& y) {
  const auto in = backend.array(y.rows(), y.cols()), out = backend.array(y.rows(), y.cols());
  backend.upload(y, *in);
  make_pole_convolution(backend, r, y.rows())->apply(*in, *out, 0);
  RowMatrix v;
  backend.download(*out, v);
  return v;
}

// |F_d| <= h min(1, 4/|hz|^2) on the axis, and weights sqrt(min(1, |hz|)): an error eps of the weighted H in units of
// its largest value s leaves (2/pi)(2 + 4) eps s < 4 eps s in a weight.
void expect_weights(Fitted& f, Index steps) {
  const PoleRecurrence r{f.fit.model, f.scene.T / double(steps)};
  const double allowed = 4 * accepted_pole_error * f.modes.scale(f.problem.h) * (double(J) / double(steps));
  const Eigen::ArrayXd x = r.h * f.modes.lambda.array();
  const ArrayPhi phi = array_phi(x);
  for (const Index column : {Index(0), G / 2, G - 1}) {
    RowMatrix y = RowMatrix::Zero(steps + 1, G);
    y(1, column) = 1;
    const RowMatrix v = convolved(*f.backend, r, y);
    y.setZero();
    y(0, column) = 1;
    const RowMatrix from_start = convolved(*f.backend, r, y);
    for (const Index d : {Index(0), Index(1), Index(2), Index(7), steps - 1}) {
      const Eigen::ArrayXd factor =
          d == 0 ? Eigen::ArrayXd(r.h * phi.phi2) : Eigen::ArrayXd(r.h * (double(d - 1) * x).exp() * phi.phi1.square());
      const Vector exact = f.modes.at(f.modes.NQ, factor, f.modes.QB.col(column));
      EXPECT_LE((v.row(d + 1).transpose() - exact).cwiseAbs().maxCoeff(), allowed) << steps << " " << d;
      if (d == 0) continue;
      const Eigen::ArrayXd start = r.h * (double(d - 1) * x).exp() * (phi.phi1 - phi.phi2);
      const Vector S = f.modes.at(f.modes.NQ, start, f.modes.QB.col(column));
      EXPECT_LE((from_start.row(d).transpose() - S).cwiseAbs().maxCoeff(), allowed) << steps << " " << d;
    }
  }
}

TEST(PoleFit, WeightsAgreeWithThoseOfTheEigenvectorsOnAllGrids) {
  Fitted f;
  ASSERT_TRUE(f.fit.model) << f.fit.reason;
  EXPECT_LE(f.fit.model->error, accepted_pole_error);
  EXPECT_TRUE((f.fit.model->poles.array() < 0).all());
  EXPECT_LE(f.fit.nodes, 56);
  expect_weights(f, J);
  expect_weights(f, J / 4);
}

// The constraints' block of a model at z, from its definition.
ComplexMatrix model_at(const PoleModel& m, Complex z) {
  ComplexMatrix in_P = ComplexMatrix::Zero(m.n, m.n);
  for (Index i = 0; i < m.driven; ++i)
    in_P.col(m.direction[std::size_t(i)]) += m.output.col(i).head(m.n).cast<Complex>() / (z - m.poles[i]);
  return in_P * m.basis.transpose().cast<Complex>() + m.direct.topLeftCorner(m.n, m.n).cast<Complex>();
}

// Largest weighted error on the curve of core/kernel/pole_fit.hpp, at 60 points of each of its parts, relative to the
// largest weighted value.
double error_on_curve(const Fitted& f, const PoleModel& model) {
  const double h = f.problem.h;
  double worst = 0, largest = 0;
  for (int part = 0; part < 3; ++part)
    for (int i = 0; i <= 60; ++i) {
      const double at = i / 60.0;
      Complex hz(0, 0.3 * h * std::pow(8 / (0.3 * h), at));
      if (part == 1) hz = std::polar(8.0, std::numbers::pi / 2 * at);
      if (part == 2) hz = Complex(0, 8) + std::polar(20 * at, 140 * std::numbers::pi / 180);
      const double weight = std::sqrt(std::min(1.0, std::abs(hz))) * std::exp(std::min(0.0, hz.real()));
      const ComplexVector r = (hz / h - f.modes.lambda.array().cast<Complex>()).inverse().matrix();
      const ComplexMatrix exact = f.modes.NQ.cast<Complex>() * r.asDiagonal() * f.modes.QB.cast<Complex>();
      worst = std::max(worst, weight * (model_at(model, hz / h) - exact).cwiseAbs().maxCoeff());
      largest = std::max(largest, weight * exact.cwiseAbs().maxCoeff());
    }
  return worst / largest;
}

// The error of a fit is the largest at eight nodes that had no part in it; between them it is hardly ten times as
// large, with any number of poles. (The other way it may be larger than on the curve by its other blocks: sources, x0.)
TEST(PoleFit, TheErrorOfHeldOutNodesHoldsOnTheWholeCurve) {
  Fitted f;
  for (const Index most : {Index(16), Index(24), Index(32), Index(200)}) {
    const PoleFit fit = fit_pole_model(f.problem, {}, {most, INFINITY});
    ASSERT_TRUE(fit.model) << fit.reason;
    EXPECT_EQ(fit.error, fit.model->error);
    EXPECT_LE(error_on_curve(f, *fit.model), 10 * fit.error) << most << " poles";
    if (most == 200) {
      EXPECT_LE(fit.error, accepted_pole_error);
    } else {
      EXPECT_LE(fit.model->distinct, most);
    }
  }
}

TEST(PoleFit, TooFewPolesAreRefused) {
  Fitted f;
  double before = INFINITY;
  for (const Index most : {Index(16), Index(24)}) {
    const PoleFit fit = fit_pole_model(f.problem, {}, {most});
    EXPECT_FALSE(fit.model) << most;
    EXPECT_GT(fit.error, accepted_pole_error);
    EXPECT_LT(fit.error, before) << "more poles, smaller error";
    EXPECT_NE(fit.reason.find("real poles miss H(z) by"), std::string::npos) << fit.reason;
    before = fit.error;
  }
}

TEST(PoleFit, SlowPolesHaveFewerDirections) {
  Fitted f;
  ASSERT_TRUE(f.fit.model) << f.fit.reason;
  EXPECT_LT(f.fit.model->driven, f.fit.model->distinct * G * 9 / 10);
}

TEST(PoleFit, ImplicitPartAndAlternatingSumAgreeWithTheWeights) {
  Fitted f;
  ASSERT_TRUE(f.fit.model) << f.fit.reason;
  const PoleRecurrence r{f.fit.model, f.problem.h};
  const ArrayPhi phi = array_phi(r.h * f.modes.lambda.array());
  const double allowed = 4 * accepted_pole_error * f.modes.scale(r.h);
  const Matrix W0 = f.modes.at(f.modes.NQ, r.h * phi.phi2, f.modes.QB);
  EXPECT_LE((implicit_part(r) - W0).cwiseAbs().maxCoeff(), allowed);
  // Σ_d (-1)^d W_d, of which every term has an error of its own: e^{hs} < 1, so that the sum has at most J of them.
  const Matrix alternating =
      f.modes.at(f.modes.NQ, r.h * (phi.phi2 - phi.phi1.square() / (1 + phi.exponential)), f.modes.QB);
  EXPECT_LE((at_minus_one(r) - alternating).cwiseAbs().maxCoeff(), double(J) * allowed);
}

TEST(PoleFit, SourcesInitialStateAndComponents) {
  Fitted f;
  ASSERT_TRUE(f.fit.model) << f.fit.reason;
  const PoleRecurrence r{f.fit.model, f.problem.h};
  const RowMatrix phi_values = f.problem.f.table();
  const RowMatrix found = free_response(*f.backend, r, phi_values, J + 1);
  const ArrayPhi phi = array_phi(r.h * f.modes.lambda.array());
  Vector z = f.modes.Qx;
  double worst = 0, largest = 0;
  for (Index j = 1; j <= J; ++j) {
    z = (phi.exponential * z.array() +
         r.h * (phi.phi1 - phi.phi2) * (f.modes.QF * phi_values.row(j - 1).transpose()).array() +
         r.h * phi.phi2 * (f.modes.QF * phi_values.row(j).transpose()).array())
            .matrix();
    Vector exact(G + 3);
    exact << f.modes.NQ * z, f.modes.Qc * z;
    worst = std::max(worst, (found.row(j).transpose() - exact).cwiseAbs().maxCoeff());
    largest = std::max(largest, exact.cwiseAbs().maxCoeff());
  }
  EXPECT_LE(worst, 4 * double(J) * accepted_pole_error * largest);  // at most J weights of sources
  const RowMatrix y = RowMatrix::Random(J + 1, G);
  const RowMatrix seen = seen_components(*f.backend, r, y);
  z.setZero();
  worst = largest = 0;
  for (Index j = 1; j <= J; ++j) {
    z = (phi.exponential * z.array() + r.h * (phi.phi1 - phi.phi2) * (f.modes.QB * y.row(j - 1).transpose()).array() +
         r.h * phi.phi2 * (f.modes.QB * y.row(j).transpose()).array())
            .matrix();
    const Vector exact = f.modes.Qc * z;
    worst = std::max(worst, (seen.row(j).transpose() - exact).cwiseAbs().maxCoeff());
    largest = std::max(largest, exact.cwiseAbs().maxCoeff());
  }
  EXPECT_LE(worst, 4 * double(J) * accepted_pole_error * largest);
}

// A perturbation of w by delta moves y by delta / compliance at most where the rest of the operator is monotone; what a
// fit changes in w is at most kernel_error W_max Σ_j |y_j|.
TEST(PoleFit, MarchesAgreeWithTheDenseTwin) {
  for (const double compliance : {0.05, 0.0}) {
    Scene scene = contact(plate(40, 16), compliance);  // 640 states: above those written out as dense
    const auto backend = make_cpu_backend(2);
    Options options;
    options.method = Method::march;
    options.steps = 700;  // 40^2 * 701 weights: above those tabulated
    const Result poles = solve(scene, *backend, options), dense = solve(dense_twin(scene), *backend, options);
    ASSERT_EQ(poles.status, Status::solved) << poles.reason;
    ASSERT_EQ(dense.status, Status::solved) << dense.reason;
    EXPECT_NE(poles.kernel.find("poles"), std::string::npos) << poles.kernel;
    EXPECT_LE(poles.kernel_error, accepted_pole_error);
    const double sum = dense.y.cwiseAbs().rowwise().maxCoeff().sum(), largest = dense.y.cwiseAbs().maxCoeff();
    EXPECT_GT((dense.y.array() > 0).count(), 1000);
    if (compliance > 0) {
      const Modes modes(scene, {});
      const ArrayPhi phi = array_phi(scene.T / 700 * modes.lambda.array());
      const double W = modes.at(modes.NQ, scene.T / 700 * phi.phi2, modes.QB).cwiseAbs().maxCoeff();
      EXPECT_LE((poles.y - dense.y).cwiseAbs().maxCoeff(), 10 * poles.kernel_error * W * sum / compliance);
    } else {
      // Radau IIA on both; W_0^{-1} takes the place of 1/compliance, and W_max W_0^{-1} is below 10 for a diffusion
      // across cells of this size.
      EXPECT_LE((poles.y - dense.y).cwiseAbs().maxCoeff(), 10 * 10 * poles.kernel_error * sum);
    }
    EXPECT_GT(largest, 0.1);
  }
}

TEST(PoleFit, TheIterationAndItsResidualUseThePoles) {
  Scene scene = contact(plate(40, 16), 5);
  const auto backend = make_cpu_backend(2);
  Options options;
  options.method = Method::contour;
  options.steps = 700;
  const Result iterated = solve(scene, *backend, options);
  options.method = Method::march;
  const Result marched = solve(scene, *backend, options);
  ASSERT_EQ(iterated.status, Status::solved) << iterated.reason;
  EXPECT_NE(iterated.kernel.find("poles"), std::string::npos) << iterated.kernel;
  // The same discrete problem, iterated to 1e-12 of its largest value.
  EXPECT_LE((iterated.y - marched.y).cwiseAbs().maxCoeff(), 1e-10 * std::max(1.0, marched.y.cwiseAbs().maxCoeff()));
}

// Cell Peclet numbers above 1: eigenvalues far from the real axis, of which real poles have none.
TEST(PoleFit, ComplexSpectraKeepTheirLagWeights) {
  const SparseDynamics d = plate(G, H, 60);
  const Matrix rates = Matrix(d.E).inverse() * Matrix(d.A);
  ASSERT_GT(Eigen::EigenSolver<Matrix>(rates).eigenvalues().imag().maxCoeff(), 20);
  Scene scene = contact(d, 0.05);
  scene.T = 0.25;  // the waves are not damped yet
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem problem = discretise(scene, *backend, J, false);
  const PoleFit fit = fit_pole_model(problem, {});
  EXPECT_FALSE(fit.model);
  EXPECT_GT(fit.error, accepted_pole_error);
  const auto op = make_pole_operator(problem);
  const std::string missing = op->missing_weights();
  EXPECT_TRUE(missing.empty()) << missing;
  EXPECT_FALSE(op->poles());
  const KernelWeights weights = op->kernel_weights(ConvolutionChoice::automatic);
  EXPECT_EQ(weights.description.find("poles"), std::string::npos) << weights.description;
}

TEST(PoleFit, SmallTablesStayTables) {
  const Scene scene = contact(plate(G, H), 0.05);
  const auto backend = make_cpu_backend(1);
  EXPECT_FALSE(poles_pay(discretise(scene, *backend, J, false)));
  EXPECT_TRUE(poles_pay(discretise(scene, *backend, 4096, false)));
}

TEST(PoleFit, IsolatedNodesAndManySources) {
  // A contact on a state that nothing else touches: E x' = y there, with the eigenvalue 0.
  SparseDynamics d = plate(G, H);
  for (Index j = 0; j < d.A.outerSize(); ++j)
    for (SparseMatrix::InnerIterator a(d.A, j); a; ++a)
      if (a.row() == 0 || j == 0) a.valueRef() = 0;
  Scene scene = contact(d, 0.05);
  const auto backend = make_cpu_backend(1);
  const DiscreteProblem problem = discretise(scene, *backend, J, false);
  const PoleFit fit = fit_pole_model(problem, {});
  // Its response does not decay: 1/z is no sum of the candidates, the slowest of which is 0.3/T.
  EXPECT_TRUE(fit.model || fit.error > accepted_pole_error);
  if (fit.model) {
    EXPECT_NEAR(
        std::abs(model_at(*fit.model, {0, 2})(0, 0)) * 2 * std::abs(get<SparseDynamics>(scene.dynamics).E.coeff(0, 0)),
        double(G), 1e-6 * double(G));
  }
  scene.F = SparseMatrix(G * H, 65);
  scene.f = [](double, Eigen::Ref<Vector> phi) { phi.setOnes(); };
  const PoleFit wide = fit_pole_model(discretise(scene, *backend, J, false), {});
  EXPECT_FALSE(wide.model);
  EXPECT_EQ(wide.reason, "f has many columns");
}

}  // namespace
}  // namespace bromwich
