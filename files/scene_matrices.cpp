#include "files/scene_matrices.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich {

namespace {

constexpr Index smallest_sparse = 257;   ///< states from which a sparse A is kept sparse
constexpr double largest_density = 0.1;  ///< of a sparse A

bool stays_sparse(const MatrixValue& A) {
  const auto* sparse = std::get_if<SparseMatrix>(&A);
  return sparse && sparse->rows() >= smallest_sparse &&
         double(sparse->nonZeros()) < largest_density * double(sparse->rows()) * double(sparse->cols());
}

bool is_tridiagonal(const SparseMatrix& M) {
  for (Index j = 0; j < M.outerSize(); ++j)
    for (SparseMatrix::InnerIterator entry(M, j); entry; ++entry)
      if (entry.value() != 0 && std::abs(entry.row() - j) > 1) return false;
  return true;
}

constexpr double most_points = 1 << 16;  ///< of a side of a rectangle

/// `entries` of the file, followed by zeros.
Vector of_line(const Section& section, const char* key, Index length) {
  const Vector entries = section.vector(key);
  if (entries.size() > length)
    throw Error(section.where(key), fmt::format("has {} entries", entries.size()),
                fmt::format("give at most {}, the points of a line", length));
  Vector whole = Vector::Zero(length);
  whole.head(entries.size()) = entries;
  return whole;
}

}  // namespace

SparseMatrix sparse_value(const MatrixValue& value) {
  if (const auto* sparse = std::get_if<SparseMatrix>(&value)) return *sparse;
  return std::get<Matrix>(value).sparseView();
}

Matrix dense_value(const MatrixValue& value, const std::string& where) {
  if (const auto* dense = std::get_if<Matrix>(&value)) return *dense;
  if (rows(value) > largest_dense * largest_dense / columns(value))
    throw Error(where, fmt::format("is {} x {} and would be kept densely", rows(value), columns(value)),
                "use a sparse A (coordinate .mtx) with few constraints, or fewer states");
  return Matrix(std::get<SparseMatrix>(value));
}

LcpMatrix lcp_matrix(const MatrixValue& value, const std::string& where, Index smallest) {
  const SparseMatrix M = sparse_value(value);
  const Index n = M.rows();
  if (n < smallest || M.cols() != n || !is_tridiagonal(M)) {
    if (M.cols() == n && stays_sparse(value)) return SparseLcpMatrix(M);
    return dense_value(value, where);
  }
  Tridiagonal t{Vector::Zero(n), Vector::Zero(n), Vector::Zero(n)};
  for (Index i = 0; i < n; ++i) {
    if (i > 0) t.lower[i] = M.coeff(i, i - 1);
    t.diagonal[i] = M.coeff(i, i);
    if (i + 1 < n) t.upper[i] = M.coeff(i, i + 1);
  }
  return t;
}

Dynamics read_dynamics(const Sections& s) {
  const MatrixValue A = s.dynamics.matrix("A");
  const Index m = rows(A);
  const MatrixValue B = s.dynamics.matrix("B"), N = s.complementarity.matrix("N", columns(B), m);
  const bool mass = s.dynamics.has("E");
  const MatrixValue E = mass ? s.dynamics.matrix("E", m, m) : MatrixValue(Matrix());
  if (stays_sparse(A))
    return SparseDynamics{sparse_value(A), sparse_value(B), sparse_value(N), mass ? sparse_value(E) : SparseMatrix()};
  return DenseDynamics{dense_value(A, s.dynamics.where("A")), dense_value(B, s.dynamics.where("B")),
                       dense_value(N, s.complementarity.where("N")),
                       mass ? dense_value(E, s.dynamics.where("E")) : Matrix()};
}

KroneckerDynamics read_rectangle(const Sections& s) {
  for (const auto& [section, key] : {std::pair(&s.dynamics, "A"),
                                     {&s.dynamics, "B"},
                                     {&s.dynamics, "E"},
                                     {&s.dynamics, "F"},
                                     {&s.complementarity, "N"}})
    if (section->has(key))
      throw Error(section->where(key), "is given with a section [kronecker]", "leave it out: [kronecker] says it");
  const Section& section = s.kronecker;
  const auto points = section.one_or_two("points"), spacing = section.one_or_two("spacing"),
             diffusivity = section.one_or_two("diffusivity");
  for (const double count : points)
    if (count != std::floor(count) || count < 1 || count > most_points)
      throw Error(section.where("points"), fmt::format("found {}", count),
                  fmt::format("give whole numbers from 1 to {}", most_points));
  for (const auto& [key, values] : {std::pair("spacing", &spacing), std::pair("diffusivity", &diffusivity)})
    for (const double value : *values)
      if (!(value > 0)) throw Error(section.where(key), fmt::format("found {}", value), "give positive numbers");
  KroneckerDynamics sum;
  sum.along = {Index(points[0]), spacing[0], diffusivity[0]};
  sum.across = {Index(points[1]), spacing[1], diffusivity[1]};
  sum.b = of_line(section, "b", sum.across.points);
  sum.n = of_line(section, "n", sum.across.points);
  return sum;
}

}  // namespace bromwich
