#include "core/events/stage_systems.hpp"

#include "core/numerics/sectorial.hpp"

#include <Eigen/Dense>

#include <algorithm>

namespace bromwich {

namespace {

constexpr Index s = StageSystems::degree, lanes = (s + 1) / 2;
using Lanes = Eigen::Array<double, lanes, 1>;

/// Collocation's eigenvalues and eigenvectors, a lane for each.
struct Eigenvectors {
  Lanes re, im;
  Eigen::Matrix<double, s + 1, s> left;   ///< real and imaginary parts of the rows of W^{-1}
  Eigen::Matrix<double, s, s + 1> right;  ///< of the columns of W, for the real part of a product
  Eigen::Matrix<double, s, s> stages;     ///< S itself

  Eigenvectors() {
    const Collocation& c = Collocation::get();
    stages = c.integrals.leftCols(s) * c.stages.leftCols(s).inverse();
    const auto& all = c.eigenvalues;
    for (Index k = 0; k < lanes; ++k) {
      const Collocation::Eigenvalue& e = all[std::size_t(k)];
      re[k] = e.value.real(), im[k] = e.value.imag();
      left.row(k) = e.left.real().transpose(), left.row(lanes + k) = e.left.imag().transpose();
      right.col(k) = e.weight * e.right.real(), right.col(lanes + k) = -e.weight * e.right.imag();
    }
  }
};

const Eigenvectors& eigenvectors() {
  static const Eigenvectors all;
  return all;
}

template <class Complex>
[[gnu::always_inline]] inline Complex product(const Complex& a, const Complex& b) {
  return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}
template <class Complex>
[[gnu::always_inline]] inline void subtract_product(const Complex& a, const Complex& b, Complex& from) {
  from.re += a.im * b.im - a.re * b.re;
  from.im -= a.re * b.im + a.im * b.re;
}
template <class Complex>
Complex inverse(const Complex& a) {
  const Lanes by = (a.re.square() + a.im.square()).inverse();
  return {a.re * by, -a.im * by};
}
// Exchanges the lanes in which `where` is 1, the others have 0.
template <class Complex>
[[gnu::always_inline]] inline void exchange(const Lanes& where, Complex& a, Complex& b) {
  const Lanes stay = 1 - where;
  const Complex first{stay * a.re + where * b.re, stay * a.im + where * b.im};
  b = {stay * b.re + where * a.re, stay * b.im + where * a.im};
  a = first;
}

// The states on which each depends, itself among them: 1 where it does.
Matrix dependence(const Matrix& A) {
  Matrix all = (A.array() != 0).cast<double>();
  all.diagonal().setOnes();
  for (Index k = 0; k < A.rows(); ++k)
    for (Index i = 0; i < A.rows(); ++i)
      if (all(i, k) != 0) all.row(i) = all.row(i).cwiseMax(all.row(k));
  return all;
}

// Strongly connected blocks of states. Those that depend on fewer come first.
std::vector<std::vector<Index>> blocks_of(const Matrix& depends) {
  std::vector<std::vector<Index>> blocks;
  for (Index i = 0; i < depends.rows(); ++i) {
    const auto is_mine = [&](const std::vector<Index>& b) { return depends(i, b[0]) != 0 && depends(b[0], i) != 0; };
    const auto mine = std::find_if(blocks.begin(), blocks.end(), is_mine);
    if (mine == blocks.end())
      blocks.push_back({i});
    else
      mine->push_back(i);
  }
  std::stable_sort(blocks.begin(), blocks.end(),
                   [&](const auto& a, const auto& b) { return depends.row(a[0]).sum() < depends.row(b[0]).sum(); });
  return blocks;
}

}  // namespace

StageSystems::StageSystems(const Matrix& A) {
  const Matrix depends = dependence(A);
  std::vector<char> is_before(std::size_t(A.rows()), 0);
  for (const std::vector<Index>& states : blocks_of(depends)) {
    std::vector<Index> others;
    for (Index k = 0; k < A.rows(); ++k)
      if (is_before[std::size_t(k)] && !A(states, k).isZero(0)) others.push_back(k);
    for (const Index i : states) is_before[std::size_t(i)] = 1;
    parts_.push_back({states, others, A(states, others), Block(A(states, states))});
  }
}

void StageSystems::solve(double h, const AtStages& right, AtStages& x) {
  x.resize(Eigen::NoChange, right.cols());
  for (Part& part : parts_) {
    part_ = right(Eigen::all, part.states);
    if (!part.others.empty()) {
      driven_.noalias() = x(Eigen::all, part.others) * part.by_others.transpose();
      part_.noalias() += h * (eigenvectors().stages * driven_);
    }
    part.block.solve(h, part_);
    x(Eigen::all, part.states) = part_;
  }
}

StageSystems::Block::Block(const Matrix& A) : H_(A) {
  const Index m = A.rows();
  const Balanced b = balanced(A);
  to_ = b.D.cwiseInverse().asDiagonal();
  from_ = b.D.asDiagonal();
  H_ = b.A;
  if (m > 2) {
    const Eigen::HessenbergDecomposition<Matrix> decomposition(b.A);
    const Matrix Q = decomposition.matrixQ();
    H_ = decomposition.matrixH();
    to_ = to_ * Q;
    from_ = Q.transpose() * from_;
  }
  upper_.resize(std::size_t(m * (m + 1) / 2));
  for (auto* all : {&multipliers_, &inverse_}) all->resize(std::size_t(m));
  exchanged_.resize(std::size_t(m));
}

// An entry of I - z H.
StageSystems::ComplexLanes StageSystems::Block::shifted(Index row, Index column) const {
  const double h = H_(row, column), one = row == column;
  return {one - h * z_.re, -h * z_.im};
}

// With partial pivoting in each lane. Row k of U is what is left of row k and row k+1 with the larger first entry.
void StageSystems::Block::factor(double h) {
  const Eigenvectors& e = eigenvectors();
  h_ = h;
  z_ = {h * e.re, h * e.im};
  const Index m = H_.rows();
  ComplexLanes* row = upper_.data();
  for (Index j = 0; j < m; ++j) row[j] = shifted(0, j);
  for (Index k = 0; k + 1 < m; ++k) {
    ComplexLanes* next = row + (m - k);
    ComplexLanes below = shifted(k + 1, k);
    const Lanes mine = row[0].re.square() + row[0].im.square(), other = below.re.square() + below.im.square();
    const Lanes where = (other > mine).cast<double>();
    exchange(where, row[0], below);
    const std::size_t at = std::size_t(k);
    exchanged_[at] = where;
    inverse_[at] = inverse(row[0]);
    multipliers_[at] = product(below, inverse_[at]);
    for (Index j = 1; j < m - k; ++j) {
      ComplexLanes& left = next[j - 1];
      left = shifted(k + 1, k + j);
      exchange(where, row[j], left);
      subtract_product(multipliers_[at], row[j], left);
    }
    row = next;
  }
  inverse_[std::size_t(m - 1)] = inverse(row[0]);
}

void StageSystems::Block::solve(double h, AtStages& x) {
  const Index m = H_.rows();
  if (h != h_) factor(h);
  const Eigenvectors& e = eigenvectors();
  sides_.noalias() = e.left * (x * to_);
  const auto side = [this](Index k) {
    return ComplexLanes{sides_.col(k).head<lanes>().array(), sides_.col(k).tail<lanes>().array()};
  };
  const auto put = [this](Index k, const ComplexLanes& value) { sides_.col(k) << value.re, value.im; };
  for (Index k = 0; k + 1 < m; ++k) {
    ComplexLanes upper = side(k), lower = side(k + 1);
    exchange(exchanged_[std::size_t(k)], upper, lower);
    subtract_product(multipliers_[std::size_t(k)], upper, lower);
    put(k, upper), put(k + 1, lower);
  }
  const ComplexLanes* row = upper_.data() + upper_.size();
  for (Index k = m - 1; k >= 0; --k) {
    row -= m - k;
    ComplexLanes value = side(k);
    for (Index j = k + 1; j < m; ++j) subtract_product(row[j - k], side(j), value);
    put(k, product(value, inverse_[std::size_t(k)]));
  }
  x.noalias() = e.right * (sides_ * from_);
}

}  // namespace bromwich
