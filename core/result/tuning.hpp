#pragma once
// Options for studies of the methods. The defaults suit all other uses.

#include "../base/types.hpp"

namespace bromwich {

enum class ConvolutionChoice { automatic, scan, fft };
enum class RecurrenceChoice { automatic, modal, compressed };

struct Tuning {
  /// How contour and multigrid evaluate K * y: recurrences in time (`scan`), or FFTs of the lag weights. Where only one
  /// of them applies it is taken. Default: chosen by the form of the dynamics and by predicted operations.
  ConvolutionChoice convolution = ConvolutionChoice::automatic;
  /// Exponentials that march carries in a Kronecker sum: one for each eigenvalue (`modal`), or the fewer ones of the
  /// compressed kernel. Default: compressed, where there are many eigenvalues and it halves their number at least.
  RecurrenceChoice recurrence = RecurrenceChoice::automatic;
  /// Radau IIA takes steps in which the state jumps by implicit Euler; false: by both stages, for comparisons.
  bool substitutes_euler = true;
  /// Cycles in w take implicit Euler; false: the two stages of Radau IIA, as march does, where the problem allows it.
  bool dual_by_euler = false;
  /// P of contour-literal, whose contours have P + 1 nodes: 2 to 400. Default: that of the paper.
  Index literal_nodes = 25;
  /// Multigrid may stop earlier than Options::iteration_tolerance says, where what the cycles would still change is
  /// below this part of the discretisation error, both estimated. From 0 to below 1; 0 (the default): the iteration
  /// tolerance alone decides. Error control sets it by itself.
  double algebraic_share = 0;
  /// y where the functional iteration starts: (J+1) x n, in the units of the scene. Null (the default): it starts from
  /// the constant x0, as it always does for M of class Z, whose least solution is reached from there. Has to live as
  /// long as the solve; a Solver copies it.
  const RowMatrix* first_iterate = nullptr;
};

}  // namespace bromwich
