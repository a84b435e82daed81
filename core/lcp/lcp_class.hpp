#pragma once
// Classes of matrices in complementarity problems, and how a class is known.
//
// symbol  meaning
// <M>     comparison matrix: |m_ii| on the diagonal, -|m_ij| off it
// H+      <M> is a nonsingular M-matrix and the diagonal of M is positive
// P       all principal minors positive: exactly one solution for every q
// Z       off-diagonal entries <= 0: a least element where there is a solution
// PSD     y^T M y >= 0: the solutions form a convex set, and its point of least norm is meant
// L       max over active sets S of ||M_SS^{-1}||_inf
//
// H+ and positive definite matrices are P (Cottle, Pang, Stone, The Linear Complementarity Problem, chapter 3). All
// tests hold for any positive scaling of rows and columns that keeps the class: rounding is judged row by row.

#include "matrix.hpp"

#include <optional>
#include <string>

namespace bromwich {

/// Off-diagonal entries all <= 0.
bool is_Z(const LcpMatrix&);

/// H+ (dominance by rows or by columns included) or positive definite symmetric part: each suffices for a P-matrix.
bool is_surely_P(const LcpMatrix&);

/// All principal minors positive beyond rounding, tested by Schur complements in 2^n steps. Precondition: n <= 16.
bool is_P_exact(const Matrix&);

/// H+: u > 0 with <M> u > 0 exists, beyond rounding.
bool is_H_plus(const LcpMatrix&);

/// The symmetric part is positive semidefinite, up to the rounding of M's entries.
bool is_PSD(const LcpMatrix&);

/// P where a sufficient condition or, for n <= 16, the exact test says so; else PSD; else Z where the signs say so and
/// the diagonal is positive; else unknown. A matrix that is PSD and Z but not P (M = 0, [[1,-1],[-1,1]]) is PSD: the
/// least element, where it exists, is the solution of least norm, so nothing is lost. With a zero on the diagonal of a
/// matrix that is only Z the constraint acts through N x, and only the user can say that the least element is meant.
LcpClass classify(const LcpMatrix&);

/// The class by which a solution is selected: `automatic` is classified, and what is both PSD and Z counts as Z.
LcpClass selection_class(const LcpMatrix&, LcpClass);

const char* to_string(LcpClass);

/// The class and how it is known: "P (H+)", "P (as stated)", "Z", ...
std::string describe_class(const LcpMatrix&, LcpClass);

/// Why M is certainly not of the class stated, or nothing.
std::optional<std::string> contradiction(const LcpMatrix&, LcpClass stated);

}  // namespace bromwich
