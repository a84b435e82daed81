#include "core/scene/descriptor.hpp"

#include "core/base/text.hpp"

#include <Eigen/Dense>
#include <Eigen/SparseLU>

#include <algorithm>
#include <cmath>

namespace bromwich {
namespace {

constexpr Index largest_index_told = 512;  // states; the index of a singular E takes dense factorizations

/// ||X^{-1}||_1 from below, by solves with X and X^T (Higham, Accuracy and Stability, algorithm 15.4).
double norm_of_inverse(Eigen::SparseLU<SparseMatrix>& factors, Index m) {
  const auto signs = [](const Vector& v) { return Vector(v.unaryExpr([](double a) { return a < 0 ? -1. : 1.; })); };
  Vector v = factors.solve(Vector(Vector::Constant(m, 1. / double(m))));
  double norm = v.lpNorm<1>();
  for (int k = 0; k < 5; ++k) {
    const Vector slope = factors.transpose().solve(signs(v));
    Index j = 0;
    slope.cwiseAbs().maxCoeff(&j);
    v = factors.solve(Vector(Vector::Unit(m, j)));
    const double next = v.lpNorm<1>();
    if (!(next > norm)) break;
    norm = next;
  }
  const Vector wave = Vector::NullaryExpr(
      m, [m](Index i) { return (i % 2 == 0 ? 1. : -1.) * (1 + double(i) / double(std::max<Index>(m - 1, 1))); });
  return std::max(norm, 2 * factors.solve(wave).lpNorm<1>() / (3 * double(m)));
}

}  // namespace

bool is_diagonal(const SparseMatrix& X) {
  for (Index j = 0; j < X.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(X, j); entry; ++entry)
      if (entry.row() != j && entry.value() != 0) return false;
  return true;
}

DescriptorUnits units_of(const SparseMatrix& X) {
  const auto root = [](double largest) { return largest > 0 ? 1 / std::sqrt(largest) : 1.; };
  DescriptorUnits units{Vector::Ones(X.rows()), Vector::Ones(X.cols())};
  for (int sweep = 0; sweep < 8; ++sweep) {  // the logarithms of the largest entries halve in each
    Vector rows = Vector::Zero(X.rows()), columns = Vector::Zero(X.cols());
    for (Index j = 0; j < X.outerSize(); ++j)
      for (SparseMatrix::InnerIterator entry(X, j); entry; ++entry) {
        const double size = std::abs(entry.value()) * units.rows[entry.row()] * units.columns[j];
        rows[entry.row()] = std::max(rows[entry.row()], size);
        columns[j] = std::max(columns[j], size);
      }
    units.rows = units.rows.cwiseProduct(rows.unaryExpr(root));
    units.columns = units.columns.cwiseProduct(columns.unaryExpr(root));
  }
  return units;
}

SparseMatrix DescriptorUnits::scaled(const SparseMatrix& X) const {
  return rows.asDiagonal() * X * columns.asDiagonal();
}

double reciprocal_condition(const SparseMatrix& X) {
  double norm = 0;
  for (Index j = 0; j < X.outerSize(); ++j) {
    double column = 0;
    for (SparseMatrix::InnerIterator entry(X, j); entry; ++entry) column += std::abs(entry.value());
    norm = std::max(norm, column);
  }
  if (!(norm > 0)) return 0;
  SparseMatrix compressed = X;
  compressed.prune(0., 0.);
  compressed.makeCompressed();
  Eigen::SparseLU<SparseMatrix> factors(compressed);
  if (factors.info() != Eigen::Success) return 0;
  const double inverse = norm_of_inverse(factors, X.rows());
  return std::isfinite(inverse) ? 1 / (norm * inverse) : 0;
}

bool is_regular(const SparseMatrix& X) {
  const Index m = X.rows();
  if (!is_diagonal(X)) return reciprocal_condition(units_of(X).scaled(X)) > double(m) * epsilon;
  for (Index i = 0; i < m; ++i)
    if (X.coeff(i, i) == 0) return false;
  return true;
}

std::string describe_singular(const SparseMatrix& E, const SparseMatrix& A) {
  const Index m = E.rows();
  if (m > largest_index_told) return text("of %td rows", m);
  const DescriptorUnits units = units_of(E);
  const Eigen::JacobiSVD<Matrix> svd(Matrix(units.scaled(E)), Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector& sizes = svd.singularValues();
  const double smallest = 8 * double(m) * epsilon * sizes[0];  // is_regular judges by an estimate
  const Index rank = (sizes.array() > smallest).count(), k = std::max<Index>(m - rank, 1);
  const std::string found = text("of rank %td of %td", m - k, m);
  const double A_size = A.norm(), E_size = E.norm(), unit = A_size > 0 && E_size > 0 ? A_size / E_size : 1;
  bool regular_pencil = false;  // for one s is enough
  for (const double s : {0.7312, -1.3179, 3.9041})
    regular_pencil = regular_pencil || is_regular(SparseMatrix(s * unit * E - A));
  if (!regular_pencil) return found + ", and det(s E - (J - R) Q) = 0 for all s: the equations do not determine x";
  const Matrix U = svd.matrixU().rightCols(k).transpose(), V = svd.matrixV().rightCols(k), scaled_A(units.scaled(A));
  Matrix algebraic = U * scaled_A * V;
  const Matrix rounding = 8 * double(m) * epsilon * (U.cwiseAbs() * scaled_A.cwiseAbs() * V.cwiseAbs());
  algebraic = (algebraic.array().abs() > rounding.array()).select(algebraic, 0.);
  return found + ", a differential-algebraic system of " +
         (is_regular(SparseMatrix(algebraic.sparseView())) ? "index 1" : "index 2 or more");
}

}  // namespace bromwich
