// V of sparse and supplied dynamics: the n x n entries of V^ at points of the region that the rule sees, and one fit of
// all of them with poles that they share.

#include "core/base/text.hpp"
#include "core/dual/dual_weights.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

namespace bromwich {

namespace {

constexpr Index most_fitted = 256;          ///< constraints: V has n^2 entries for every lag
constexpr double most_table = 4e9;          ///< bytes of all tables
constexpr double density_of_points = 0.5;   ///< each costs a factorization
constexpr double accepted_entries = 5e-10;  ///< error of a fit, relative to the largest entry at a point
constexpr double followed = 2;              ///< radians: a larger turn from point to point may be another
constexpr Index looked_at = 24;             ///< points where the reason of a refusal is looked for
constexpr Index modes_of_sweep = 12;        ///< evenly among those of V_0
constexpr Index most_localised = 24;  ///< besides: those of a few constraints, as of a contact far from all others
constexpr double localised = 0.5;     ///< the sum of the fourth powers of a normalised mode: its inverse counts entries

// N (zE - A)^{-1} B at all points, by one call.
std::vector<ComplexMatrix> transfer_at(const DiscreteProblem& p, const std::vector<Complex>& points) {
  const Index n = p.scene.constraints();
  const ComplexVector nodes = Eigen::Map<const ComplexVector>(points.data(), Index(points.size()));
  const ComplexMatrix rows = p.backend.resolvent(p.scene.dynamics, nodes);
  std::vector<ComplexMatrix> values;
  for (Index i = 0; i < rows.rows(); ++i) {
    ComplexMatrix K(n, n);
    for (Index r = 0; r < n; ++r) K.row(r) = rows.row(i).segment(r * n, n);
    values.push_back(std::move(K));
  }
  return values;
}

bool is_singular(const ComplexMatrix& symbol) {
  const ComplexMatrix scaled = symbol.rowwise().lpNorm<1>().cwiseInverse().asDiagonal() * symbol;
  if (!scaled.allFinite()) return true;
  const Eigen::PartialPivLU<ComplexMatrix> lu(scaled);
  // The estimate of the condition can miss a pivot that is 0, as that of a constraint that is given twice.
  const bool zero = lu.matrixLU().diagonal().cwiseAbs().minCoeff() == 0;
  return zero || !(lu.rcond() > 1e3 * epsilon);
}

// Poles of the fit from the known spectrum to what an M close to zero makes of it.
PoleSum fit_inverse(const DiscreteProblem& p, const Matrix& M, Index stages) {
  const Index n = M.rows();
  const FitRegion region{stages == 2, p.h, p.scene.T, 0, 0, density_of_points};
  const SparseMatrix NB = p.scene.dynamics->outputs() * p.scene.dynamics->rates_of_inputs(p.h);
  double direct = 0, least = INFINITY;
  for (Index i = 0; i < n; ++i) {
    direct = std::max(direct, std::abs(NB.coeff(i, i)));
    least = std::min(least, std::abs(M(i, i)));
  }
  const Spectrum spectrum = p.scene.dynamics->spectrum();
  const double near = std::max(spectrum.radius, 2 / p.h), slowest = 0.05 / p.scene.T;
  const double fastest = 4 * std::clamp(direct / std::max(least, 1e-300), near, 1e4 * near);
  std::vector<Complex> points;
  fit_poles(
      [&points](Complex z) -> ComplexVector {
        points.push_back(z);
        return ComplexVector::Constant(1, 1.0 / (1.0 + z));
      },
      1, region, slowest, fastest, true);
  const std::vector<ComplexMatrix> K = transfer_at(p, points);
  std::size_t next = 0;
  return fit_poles(
      [&](Complex) -> ComplexVector {
        const Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> V =
            (M.cast<Complex>() + K[next++]).partialPivLu().inverse();
        return Eigen::Map<const ComplexVector>(V.data(), V.size());
      },
      n* n, region, slowest, fastest, true);
}

// Twice the change of the argument of det(M + K) over the upper half of the boundary.
std::string why_no_fit(const DiscreteProblem& p, const Matrix& M, Index stages, double error) {
  std::vector<Complex> points = rule_boundary(stages, p.h, p.J, looked_at);
  const std::vector<ComplexMatrix> K = transfer_at(p, points);
  double turned = 0;
  bool known = true;
  Complex before = 0;
  for (const ComplexMatrix& k : K) {
    Complex now = (M.cast<Complex>() + k).determinant();
    now /= std::abs(now);
    const double turn = before != 0.0 ? std::arg(now / before) : 0;
    known = known && std::abs(turn) < followed;
    turned += turn;
    before = now;
  }
  if (known && std::abs(turned) > std::numbers::pi)
    return "V grows: M + N (zI - A)^{-1} B has zeros in the right half-plane";
  return text("V is no short sum of decaying exponentials: the best one misses %.1e of it", error);
}

Matrix matrix_of(const LagTable& table, Index lag) {
  return Eigen::Map<const RowMatrix>(table.W.row(lag).data(), table.outputs, table.inputs);
}

Matrix step_block(const StageTables& tables) {
  const auto part = [&](int a, int b) { return matrix_of(std::get<LagTable>(tables.parts[a][b]), 0); };
  const Index n = std::get<LagTable>(tables.parts[0][0]).inputs;
  Matrix block(2 * n, 2 * n);
  block << 0.75 * part(0, 0), 0.75 * part(0, 1), 0.25 * part(1, 0), 0.25 * part(1, 1);
  return block;
}

bool is_positive_definite(const Matrix& V0) {
  return Eigen::LLT<Matrix>(Matrix(V0 + V0.transpose())).info() == Eigen::Success;
}

// Lambda = diag V^(1/h), and the fit of Lambda^{-1} V^.
Vector scale_rows(PoleSum& sum, double h) {
  const Index n = Index(std::llround(std::sqrt(double(sum.functions()))));
  const Matrix V0 = matrix_of(euler_table(sum, n, h, 1), 0);
  const Vector scale = V0.diagonal();
  if (!(scale.minCoeff() > 0)) return {};
  for (Index i = 0; i < n; ++i)
    for (Index k = i * n; k < (i + 1) * n; ++k) {
      sum.coefficients.col(k) /= scale[i];
      sum.constant[k] /= scale[i];
      sum.linear[k] /= scale[i];
    }
  return scale;
}

// t with V_ij/V_ji = t_i/t_j where units made a symmetric matrix unsymmetric, along the strongest couplings.
Vector symmetry_of(const Matrix& V) {
  Vector t = Vector::Ones(V.rows());
  for (Index j = 1; j < V.rows(); ++j) {
    Index k = 0;
    V.row(j).head(j).transpose().cwiseProduct(V.col(j).head(j)).maxCoeff(&k);
    const double ratio = V(j, k) / V(k, j);
    if (ratio > 0 && std::isfinite(ratio)) t[j] = t[k] * ratio;
  }
  return t;
}

// The modes from which sweeps are chosen: some evenly in their order, and those of a few constraints alone, whose V^
// may be unlike that of their neighbours in the order.
std::vector<Index> chosen_modes(const Matrix& vectors) {
  const Index n = vectors.cols(), even = std::min(n, modes_of_sweep);
  std::vector<Index> modes;
  for (Index i = 0; i < even; ++i) modes.push_back(even > 1 ? i * (n - 1) / (even - 1) : 0);
  std::vector<std::pair<double, Index>> alone;
  for (Index l = 0; l < n; ++l) {
    const double fourth = vectors.col(l).cwiseAbs2().cwiseAbs2().sum() / std::pow(vectors.col(l).squaredNorm(), 2);
    if (fourth > localised) alone.emplace_back(-fourth, l);
  }
  std::sort(alone.begin(), alone.end());
  for (Index i = 0; i < std::min(Index(alone.size()), most_localised); ++i)
    modes.push_back(alone[std::size_t(i)].second);
  return modes;
}

// x^T T^{-1/2} V^ T^{1/2} x for some eigenvectors x of its symmetric part at z = 1/h, T = diag t.
ModeSymbols symbols_of(const PoleSum& sum, const Vector& t, double h) {
  const Index n = t.size(), K = sum.rates.size();
  const Vector root = t.cwiseSqrt();
  const auto symmetric = [&](const Matrix& scaled) {
    return Matrix(root.cwiseInverse().asDiagonal() * scaled * root.asDiagonal());
  };
  const Matrix V0 = symmetric(matrix_of(euler_table(sum, n, h, 1), 0));
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(Matrix(0.5 * (V0 + V0.transpose())));
  const std::vector<Index> chosen = chosen_modes(eigen.eigenvectors());
  const Index modes = Index(chosen.size());
  auto of_modes = std::make_shared<PoleSum>();
  of_modes->rates = sum.rates;
  of_modes->coefficients.resize(K, modes);
  of_modes->constant.resize(modes);
  of_modes->linear.resize(modes);
  for (Index i = 0; i < modes; ++i) {
    const Vector x = eigen.eigenvectors().col(chosen[std::size_t(i)]);
    const auto quotient = [&](const Vector& entries) {
      return x.dot(symmetric(Eigen::Map<const RowMatrix>(entries.data(), n, n)) * x);
    };
    for (Index k = 0; k < K; ++k) of_modes->coefficients(k, i) = quotient(sum.coefficients.row(k).transpose());
    of_modes->constant[i] = quotient(sum.constant);
    of_modes->linear[i] = quotient(sum.linear);
  }
  return [of_modes](Complex z) {
    ComplexVector values = of_modes->constant.cast<Complex>() + z * of_modes->linear.cast<Complex>();
    for (Index k = 0; k < of_modes->rates.size(); ++k)
      values += of_modes->coefficients.row(k).transpose().cast<Complex>() / (z - of_modes->rates[k]);
    return values;
  };
}

// Sweeps by blocks, SOL(P, .) with a multiple P of V_0, since the entries of V_0 differ too much for one d: the
// multiple and the forecast from V_0^{-1} V^ in the modes of V_0.
std::tuple<Matrix, double, double> block_divisor(const PoleSum& fit, const Matrix& V0, double h) {
  const Index n = V0.rows();
  const Eigen::EigenSolver<Matrix> eigen(V0);
  const ComplexMatrix X = eigen.eigenvectors(), left = X.inverse();
  const std::vector<Index> chosen = chosen_modes(X.cwiseAbs());
  const Index modes = Index(chosen.size());
  const auto relative = [&](Complex z) {
    ComplexVector values(modes);
    ComplexVector entries = fit.constant.cast<Complex>() + z * fit.linear.cast<Complex>();
    for (Index k = 0; k < fit.rates.size(); ++k)
      entries += fit.coefficients.row(k).transpose().cast<Complex>() / (z - fit.rates[k]);
    using Rows = Eigen::Matrix<Complex, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const Eigen::Map<const Rows> V(entries.data(), n, n);
    for (Index i = 0; i < modes; ++i) {
      const Index l = chosen[std::size_t(i)];
      const ComplexVector seen = V * X.col(l);
      values[i] = (left.row(l) * seen)(0, 0) / eigen.eigenvalues()[l];
    }
    return values;
  };
  const SweepChoice choice = choose_sweep(relative, h, 1, dual_sweeps, 1, false);
  return {Matrix(choice.shift * V0), choice.contraction, choice.smoothing};
}

DualChoice with_fit(const DiscreteProblem& p, Index stages, std::shared_ptr<const PoleSum> fit, const Vector& scale,
                    ModeSymbols symbols) {
  const Index n = p.scene.constraints();
  if (double(stages * stages) * double(p.J) * double(n * n) * 8 > most_table)
    return refused_dual("its tables for all lags do not fit into memory");
  DualWeights weights;
  Matrix V0;
  if (stages == 2) {
    weights.stage_tables = stage_tables(*fit, n, p.h, p.J);
    V0 = step_block(*weights.stage_tables);
  } else {
    LagTable table = euler_table(*fit, n, p.h, p.J);
    V0 = matrix_of(table, 0);
    std::tie(weights.P, weights.contraction, weights.smoothing) = block_divisor(*fit, V0, p.h);
    const RowMatrix P = std::get<Matrix>(weights.P);
    table.W.row(0) -= Eigen::Map<const Eigen::RowVectorXd>(P.data(), n * n);
    weights.weights = share_weights(std::move(table));
  }
  const Vector t = symmetry_of(matrix_of(euler_table(*fit, n, p.h, 1), 0));
  const Vector rows = stages == 2 ? Vector(t.cwiseInverse().replicate(2, 1)) : Vector(t.cwiseInverse());
  if (!is_positive_definite(rows.asDiagonal() * V0)) return refused_dual("the problem of a step is not known to be P");
  weights.row_scale = scale;
  weights.symbols = symbols ? std::move(symbols) : symbols_of(*fit, t, p.h);
  if (stages == 2) {
    const SweepChoice choice = choose_sweep(weights.symbols, p.h, stages, dual_sweeps, 1);
    weights.P = Tridiagonal{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
    weights.stage_divisors = choice.stages;
    weights.contraction = choice.contraction;
  }
  weights.error = fit->error;
  weights.description = text("V: %ld poles shared by all entries", long(fit->rates.size()));
  weights.fit = std::move(fit);
  return {std::move(weights), ""};
}

}  // namespace

DualChoice fitted_dual_weights(const DiscreteProblem& p, Index stages, const DualWeights* finer) {
  if (finer) return with_fit(p, stages, finer->fit, finer->row_scale, finer->symbols);
  const Index n = p.scene.constraints();
  if (n > most_fitted) return refused_dual(text("sparse dynamics with more than %ld constraints", long(most_fitted)));
  const Matrix M = to_dense(p.scene.M);
  const std::vector<ComplexMatrix> K = transfer_at(p, {1 / p.h, 0.2718 / p.h});
  if (is_singular(M.cast<Complex>() + K[0]) && is_singular(M.cast<Complex>() + K[1]))
    return refused_dual("M + K has no inverse: constraints repeat each other");
  const Matrix rates = p.scene.dynamics->rates_of_inputs(p.h), N = p.scene.dynamics->outputs();
  if (!has_relative_degree_one(M, N * rates, N.cwiseAbs() * rates.cwiseAbs())) return refused_dual(two_derivatives);
  auto fit = std::make_shared<PoleSum>(fit_inverse(p, M, stages));
  if (!(fit->error <= accepted_entries)) return refused_dual(why_no_fit(p, M, stages, fit->error));
  const Vector scale = scale_rows(*fit, p.h);
  if (scale.size() == 0) return refused_dual("M + W_0 is not positive");
  return with_fit(p, stages, std::move(fit), scale, {});
}

}  // namespace bromwich
