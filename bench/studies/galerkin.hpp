#pragma once
// Parts of `bench galerkin` and their norm: L2 in time of the Euclidean norm over components.

#include "bench/studies/study.hpp"

namespace bromwich::app {

struct TimeErrors {
  double y_L2 = NAN, x_L2 = NAN, y_at_T = NAN, x_at_T = NAN;
};

/// y is linear on every interval between its rows of `left` and `right` (J x n). x ((J+1) x m) is interpolated by
/// cubics with the values and slopes A x + B y + f at the ends, with an error O(h^4). For scenes with an exact
/// solution.
TimeErrors galerkin_errors(const Scene&, const RowMatrix& left, const RowMatrix& right, const RowMatrix& x);

/// y (J x n) is constant on every step, x linear.
TimeErrors euler_errors(const Scene&, const RowMatrix& y, const RowMatrix& x);

Json to_json(const TimeErrors&);

/// Errors of Galerkin and implicit Euler against steps and time; switches and cost of the control problem.
void study_convergence(const BenchRequest&, Backend&, BenchReport&);

/// Errors of implicit Euler over those of Galerkin on the grids about the step of example 5.1.
void study_ratios(const BenchRequest&, Backend&, BenchReport&);

/// Approximation by the spaces of functions: projections of the exact control (Fig. 3), and the smallest eigenvalue of
/// the operator (Fig. 6).
void study_spaces(const BenchRequest&, Backend&, BenchReport&);

/// Time and memory of an application and a solve over the number of intervals; the periodic state compared to marching.
void study_galerkin_cost(const BenchRequest&, Backend&, BenchReport&);

}  // namespace bromwich::app
