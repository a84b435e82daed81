#pragma once
// Diagonal scaling that makes the rows and columns of a matrix comparable, and condition estimates.

#include "../base/types.hpp"

#include <Eigen/LU>

#include <optional>

namespace bromwich {

struct Equilibration {
  Vector rows;     ///< R
  Vector columns;  ///< C
};

/// R and C with the largest entry of every row and column of R A C between about 1/2 and 2; 1 for zero rows, columns.
/// Powers of two: scaling causes no rounding.
Equilibration equilibrate(const Matrix& A);

/// The same, with the largest entry of each row and column of R A C given by `largest(e, rows, columns)`.
template <typename Largest>
Equilibration equilibrate(Index rows, Index columns, const Largest& largest);

/// R A C.
Matrix scaled(const Matrix& A, const Equilibration&);

/// A^{-1} of a real or complex matrix; equilibrated first if A looks singular, as units of the unknowns do not count.
/// Empty if A is singular to rounding.
template <typename Square>
std::optional<Square> regular_inverse(const Square& A);

/// A^{-1} after scaling rows, then columns, to a largest entry of 1. Empty if a row or column is zero, or if the
/// reciprocal condition of the scaled matrix is not above `least_condition`.
std::optional<Matrix> scaled_inverse(const Matrix& A, double least_condition);

/// Estimate of 1/(||A||_1 ||A^{-1}||_1) from A = LU; 0 if a pivot is zero or not finite, which Eigen's estimate can
/// miss (0/0 in its computation).
double reciprocal_condition(const Eigen::PartialPivLU<Matrix>&);

/// One sweep of equilibration: divides by the square roots of the largest entries of rows and columns.
void divide_by_roots(const Vector& largest, Vector& factors);
/// To the nearest powers of two.
void round_to_powers_of_two(Vector& factors);

template <typename Largest>
Equilibration equilibrate(Index rows, Index columns, const Largest& largest) {
  Equilibration e{Vector::Ones(rows), Vector::Ones(columns)};
  if (rows == 0 || columns == 0) return e;
  Vector of_rows, of_columns;
  for (int sweep = 0; sweep < 8; ++sweep) {  // the logarithms of the largest entries halve in each
    largest(e, of_rows, of_columns);
    divide_by_roots(of_rows, e.rows);
    divide_by_roots(of_columns, e.columns);
  }
  round_to_powers_of_two(e.rows);
  round_to_powers_of_two(e.columns);
  return e;
}

template <typename Square>
std::optional<Square> regular_inverse(const Square& A) {
  const Eigen::PartialPivLU<Square> lu(A);
  if (A.rows() == 0 || lu.rcond() >= epsilon) return lu.inverse();
  const Equilibration e = equilibrate(Matrix(A.cwiseAbs()));
  const Eigen::PartialPivLU<Square> balanced(Square(e.rows.asDiagonal() * A * e.columns.asDiagonal()));
  if (!(balanced.rcond() >= epsilon)) return std::nullopt;
  return e.columns.asDiagonal() * balanced.inverse() * e.rows.asDiagonal();
}

}  // namespace bromwich
