#include "core/events/propagators.hpp"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr std::size_t most_kept = 4000000;  ///< numbers in the factors
constexpr Index most_columns = 128;

}  // namespace

Propagators::Propagators(const SystemMatrices& system, double longest) : longest_(longest) {
  const auto is_position = [&](Index i) {
    const auto apart = [&](Index k) { return system.A(i, k) == 0 && system.A(k, i) == 0; };
    return system.B.row(i).isZero(0) && apart(i) && std::all_of(positions_.begin(), positions_.end(), apart);
  };
  for (Index i = 0; i < system.states(); ++i) (is_position(i) ? positions_ : others_).push_back(i);
  by_others_ = system.A(positions_, others_);
}

double Propagators::grid_length(double longest) const {
  const double half = longest_ * std::exp2(std::floor(std::log2(longest / longest_)));
  return longest >= 1.5 * half ? 1.5 * half : half;
}

double Propagators::grid_length_above(double length) const {
  const double half = longest_ * std::exp2(std::floor(std::log2(length / longest_)));
  return length <= half ? half : (length <= 1.5 * half ? 1.5 : 2) * half;
}

// I - z A_S, z = h lambda, for the eigenvalues lambda of the Radau matrix. With positions Q and other states V it is
//
//     [I, -z A_QV; -z A_VQ, I - z A_VV],
//
// and that for V alone is I - z A_VV - z^2 A_VQ A_QV.
Propagators::Propagator& Propagators::propagator(const SwitchedMode& mode, double h, double& work) {
  const auto known = propagators_.find({&mode, h});
  if (known != propagators_.end()) return known->second;
  if (kept_ > most_kept) propagators_.clear(), kept_ = 0;
  kept_ += 2 * others_.size() * others_.size() * Collocation::get().eigenvalues.size();
  Propagator& made = propagators_[{&mode, h}];
  made.by_positions = mode.A(others_, positions_);
  const Matrix A = mode.A(others_, others_), twice = made.by_positions * by_others_;
  const ComplexMatrix identity = ComplexMatrix::Identity(A.rows(), A.rows());
  for (const auto& e : Collocation::get().eigenvalues) {
    const Complex z = h * e.value;
    made.factors.emplace_back(identity - z * A.cast<Complex>() - (z * z) * twice.cast<Complex>());
  }
  work += 12 * std::pow(double(A.rows()), 3);
  return made;
}

// (I - z A_S)^{-1} of the right-hand side, z = h lambda.
ComplexVector Propagators::solve(const Propagator& of, Complex z, std::size_t k, const ComplexVector& right) const {
  const ComplexVector of_positions = right(positions_);
  const ComplexVector others =
      of.factors[k].solve(ComplexVector(right(others_) + z * (of.by_positions * of_positions)));
  ComplexVector all(right.size());
  all(others_) = others;
  all(positions_) = of_positions + z * (by_others_ * others);
  return all;
}

// Z = X - x0 with Z' = A_S Z + input. So rounding is relative to the change of x: errors of many short steps would add
// up otherwise.
void Propagators::collocate(const SwitchedMode& mode, double h, const Propagator& of, const LegendreCoefficients& input,
                            LegendreCoefficients& z) const {
  const Collocation& c = Collocation::get();
  using AtStages = Eigen::Matrix<double, degree, Eigen::Dynamic>;
  const AtStages right = h * (c.integrals * input);  // degree x m
  AtStages change = AtStages::Zero(degree, input.cols()), left = right;
  // Twice: the eigenvectors of the Radau matrix are ill-conditioned.
  for (int refined = 0; refined < 2; ++refined) {
    for (std::size_t k = 0; k < of.factors.size(); ++k) {
      const auto& e = c.eigenvalues[k];
      const ComplexVector at = solve(of, h * e.value, k, left.transpose().cast<Complex>() * e.left);
      change += e.weight * (e.right * at.transpose()).real();
    }
    z = c.coefficients.rightCols(degree) * change;
    if (refined == 0) left = right - change + h * (c.integrals * z) * mode.A.transpose();
  }
}

// The same. Z is linear in the coefficients of the input. Once a propagator has been used as often as it has columns,
// these are kept: periodic sources that are lines take few of them.
void Propagators::propagate(const SwitchedMode& mode, double h, const LegendreCoefficients& input, Index degrees,
                            LegendreCoefficients& z, double& work) {
  const Index m = input.cols();
  Propagator& of = propagator(mode, h, work);
  if (degrees * m > most_columns || of.used++ < degrees * m) return collocate(mode, h, of, input, z);
  while (Index(of.columns.size()) < degrees) {
    LegendreCoefficients unit = LegendreCoefficients::Zero(input.rows(), m);
    Matrix& all = of.columns.emplace_back(input.rows() * m, m);
    for (Index i = 0; i < m; ++i) {
      unit(Index(of.columns.size()) - 1, i) = 1;
      collocate(mode, h, of, unit, z);
      all.col(i) = z.reshaped();
      unit.col(i).setZero();
    }
  }
  z.resize(Eigen::NoChange, m);
  Eigen::Map<Vector> all(z.data(), z.size());
  all.setZero();
  for (Index k = 0; k < degrees; ++k) all.noalias() += of.columns[std::size_t(k)] * input.row(k).transpose();
}

// Where the input is a line, the step of the next length of the grid is cut.
const LegendreCoefficients& Propagators::move(const SwitchedMode& mode, double h, LegendreCoefficients& input,
                                              LegendreCoefficients& change, double& work) {
  Index degrees = input.rows();
  while (degrees > 1 && (input.row(degrees - 1).array() == 0).all()) --degrees;
  const double length = degrees <= 2 ? grid_length_above(h) : h, longer = length / h;
  input.row(0) += (longer - 1) * input.row(1);
  input.row(1) *= longer;
  propagate(mode, length, input, degrees, whole_, work);
  if (longer == 1) {
    change = whole_;
    return whole_;
  }
  const Collocation& c = Collocation::get();
  Collocation::Square at_samples;
  for (Index k = 0; k < c.samples.size(); ++k) at_samples.row(k) = legendre(c.samples[k] / longer).transpose();
  const Collocation::Square cut = c.from_samples * at_samples;
  change.noalias() = cut * whole_;
  return whole_;
}

}  // namespace bromwich
