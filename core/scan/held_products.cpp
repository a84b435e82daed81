#include "core/scan/held_products.hpp"

#include "core/numerics/equilibration.hpp"

#include <Eigen/Dense>

namespace bromwich {

void append_positive(const Vector& y, SetKey& key) {
  for (Index i = 0; i < y.size(); ++i) {
    if (i % 64 == 0) key.push_back(0);
    key.back() |= std::uint64_t(y[i] > 0) << (i % 64);
  }
}

// FNV-1a, a word at a time.
std::uint64_t hash_of(std::uint64_t hash, const SetKey& words) {
  for (const std::uint64_t word : words) {
    hash = (hash ^ word) * 1099511628211ULL;
    hash ^= hash >> 29;
  }
  return hash;
}

Matrix held_solution(const Matrix& W, const Vector& y) {
  std::vector<Index> S;
  for (Index i = 0; i < y.size(); ++i)
    if (y[i] > 0) S.push_back(i);
  Matrix Z = Matrix::Zero(W.rows(), W.cols());
  if (S.empty()) return Z;
  const Matrix on_set = W(S, S);
  if (const auto inverse = regular_inverse(on_set)) {
    Z(S, S) = -*inverse;
  } else {
    const Matrix identity = Matrix::Identity(on_set.rows(), on_set.cols());
    Z(S, S) = -Matrix(Eigen::CompleteOrthogonalDecomposition<Matrix>(on_set).solve(identity));
  }
  return Z;
}

void Powers::apply(Index r, Matrix& D) {
  for (std::size_t k = 0; r > 0; r /= 2, ++k) {
    if (k == squares_.size()) squares_.push_back(squares_.back() * squares_.back());
    if (r % 2 != 0) D = (squares_[k] * D).eval();
  }
}

void HeldProduct::begin(Index m) {
  D_ = Matrix::Identity(m, m);
  run_ = 0;
  hash_ = 14695981039346656037ULL;
}

void HeldProduct::end_run() {
  if (run_ == 0) return;
  power_->apply(run_, D_);
  hash_ = hash_of(hash_of(hash_, key_), {std::uint64_t(run_)});
  run_ = 0;
}

}  // namespace bromwich
