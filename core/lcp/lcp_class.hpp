#pragma once
// Classes of matrices in complementarity problems, and tests for them.
//
// symbol  meaning
// <M>     comparison matrix: |m_ii| on the diagonal, -|m_ij| off it
// H+      <M> is a nonsingular M-matrix and the diagonal of M is positive
// P       all principal minors positive: exactly one solution for every q
// Z       off-diagonal entries <= 0: a feasible problem has a least solution
// PSD     y^T M y >= 0: the solutions form a convex set; its point of least norm is selected
// L       max over active sets S of ||M_SS^{-1}||_inf
//
// H+ and positive definite matrices are P (Cottle, Pang, Stone, The Linear Complementarity Problem, chapter 3). The
// tests are invariant under positive scalings of rows and columns that keep the class: rounding is judged per row.

#include "matrix.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// Off-diagonal entries all <= 0.
bool is_Z(const LcpMatrix&);

/// H+ (this includes dominance by rows or columns) or positive definite symmetric part: each is sufficient for P.
bool is_surely_P(const LcpMatrix&);

/// All principal minors positive beyond rounding, tested by Schur complements in 2^n steps. Precondition: n <= 16.
bool is_P_exact(const Matrix&);

/// H+: u > 0 with <M> u > 0 exists, beyond rounding.
bool is_H_plus(const LcpMatrix&);

/// The symmetric part is positive semidefinite, up to the rounding of M's entries.
bool is_PSD(const LcpMatrix&);

/// The first of P (a sufficient condition or, for n <= 16, the exact test), PSD, Z with a positive diagonal, unknown. A
/// matrix that is PSD and Z but not P (M = 0, [[1,-1],[-1,1]]) is classified as PSD: if the least element exists it is
/// the solution of least norm. If a matrix that is only Z has a zero on the diagonal, the constraint acts through N x,
/// and the user has to state whether the least element is wanted.
LcpClass classify(const LcpMatrix&);

/// The class as stated; `automatic` is classified.
LcpClass known_class(const LcpMatrix&, LcpClass stated);

/// The class by which a solution is selected: `automatic` is classified; a matrix that is PSD and Z counts as Z.
LcpClass selection_class(const LcpMatrix&, LcpClass);

/// The names of the classes that a user may state: "auto", "P", ...
std::vector<std::string> lcp_class_names();

/// The class and its justification: "P (H+)", "P (as stated)", "Z", ...
std::string describe_class(const LcpMatrix&, LcpClass);

/// The reason why M is certainly not of the stated class, or nothing.
std::optional<std::string> contradiction(const LcpMatrix&, LcpClass stated);

}  // namespace bromwich
