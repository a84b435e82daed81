#include "core/events/propagators.hpp"

#include <Eigen/Dense>

#include <cmath>

namespace bromwich {

namespace {

constexpr Index degree = Collocation::degree;
constexpr std::size_t most_kept = 4000000;  ///< numbers
constexpr Index most_columns = 128;
constexpr Index few = 16;  ///< states whose products cost less without packing

// by * (columns of c), where both have few rows, known when this is compiled.
template <class By, class Polynomials, class Product>
void multiply_columns(const By& by, const Polynomials& c, Product& product) {
  product.resize(Eigen::NoChange, c.cols());
  for (Index i = 0; i < c.cols(); ++i) product.col(i).noalias() = by * c.col(i);
}

}  // namespace

double Propagators::grid_length(double longest) const {
  const double half = longest_ * std::exp2(std::floor(std::log2(longest / longest_)));
  return longest >= 1.5 * half ? 1.5 * half : half;
}

double Propagators::grid_length_above(double length) const {
  const double half = longest_ * std::exp2(std::floor(std::log2(length / longest_)));
  return length <= half ? half : (length <= 1.5 * half ? 1.5 : 2) * half;
}

StageSystems& Propagators::systems_of(const SwitchedMode& mode, double& work) {
  const auto known = systems_.find(&mode);
  if (known != systems_.end()) return known->second;
  const Index m = mode.A.rows();
  kept_ += StageSystems::size(m);
  work += 10 * std::pow(double(m), 3);
  return systems_.emplace(&mode, mode.A).first->second;
}

// Z = X - x0 with Z' = A_S Z + input. So rounding is relative to the change of x: errors of many short steps would add
// up otherwise.
void Propagators::collocate(const SwitchedMode& mode, double h, const LegendreCoefficients& input,
                            LegendreCoefficients& z, double& work) {
  const Collocation& c = Collocation::get();
  StageSystems& systems = systems_of(mode, work);
  const Collocation::Stages integrals = h * c.integrals;
  const Eigen::Matrix<double, degree + 1, degree> from_stages = c.coefficients.rightCols<degree>();
  multiply_columns(integrals, input, right_);
  left_ = right_;
  change_.setZero(degree, input.cols());
  // Twice: the eigenvectors of the Radau matrix are ill-conditioned, and solutions are known beside the largest state.
  for (int refined = 0; refined < 2; ++refined) {
    systems.solve(h, left_, part_);
    change_ += part_;
    multiply_columns(from_stages, change_, z);
    if (refined > 0) break;
    multiply_columns(integrals, z, part_);
    left_ = right_ - change_;
    if (input.cols() <= few)
      left_ += part_.lazyProduct(mode.A.transpose());
    else
      left_.noalias() += part_ * mode.A.transpose();
  }
}

// The same. Z is linear in the coefficients of the input. Once steps of one length have been taken as often as there
// are columns, these are kept: periodic sources that are lines take few of them.
void Propagators::propagate(const SwitchedMode& mode, double h, const LegendreCoefficients& input, Index degrees,
                            LegendreCoefficients& z, double& work) {
  const Index m = input.cols();
  if (degrees * m > most_columns) return collocate(mode, h, input, z, work);
  Recurring& of = recurring_[{&mode, h}];
  if (of.used++ < degrees * m) return collocate(mode, h, input, z, work);
  while (Index(of.columns.size()) < degrees) {
    LegendreCoefficients unit = LegendreCoefficients::Zero(input.rows(), m);
    Matrix& all = of.columns.emplace_back(input.rows() * m, m);
    kept_ += std::size_t(all.size());
    for (Index i = 0; i < m; ++i) {
      unit(Index(of.columns.size()) - 1, i) = 1;
      collocate(mode, h, unit, z, work);
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
  if (kept_ > most_kept) systems_.clear(), recurring_.clear(), kept_ = 0;
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
  const Collocation::Square cut = c.from_samples.lazyProduct(at_samples);
  change = whole_;
  transform(cut, change);
  return whole_;
}

}  // namespace bromwich
