#pragma once
// How the matrices of a step change with A: E = e^{hA}, L = h (phi_1 - phi_2)(hA), R = h phi_2(hA).

#include "../core/base/types.hpp"

namespace bromwich {

struct StepDirection {
  Matrix decay, left, right;  ///< of E, L and R
};

/// The derivative in the direction D: the upper right blocks of the same functions of [[A, D], [0, A]] (Higham,
/// Functions of Matrices, theorem 3.6). D is scaled to the size of A.
StepDirection step_direction(const Matrix& A, const Matrix& D, double h);

/// The same as one matrix, for many directions of one small A: columns are the entries of A, rows those of E, L and R
/// one after the other, all row by row. Its transpose takes sums of a gradient by E, L and R to one by A.
class StepDirections {
 public:
  StepDirections(const Matrix& A, double h);
  /// 3 m^2 numbers, from m x m.
  void forward(const Matrix& D, double* changes) const;
  /// m x m, from 3 m^2 numbers.
  Matrix backward(const double* sums) const;

 private:
  Index m_;
  Matrix map_;  ///< 3 m^2 x m^2
};

}  // namespace bromwich
