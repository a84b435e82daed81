#pragma once
// One dynamics on one time grid: all that the methods need of A, B and N, and nothing else. With K the discrete
// convolution of the grid,
//
//     w = M y + r + K y,
//
// an operator makes the weights of K, plans that apply it, r, the data of a march, the same for grids of fewer steps,
// and the states behind a solution y. Each kind of dynamics has one: core/kernel/dense_operator.cpp steps the state,
// core/kernel/modal_operator.cpp works in sine modes, core/kernel/lag_operator.cpp tabulates weights from shifted
// solves.

#include "../result/options.hpp"
#include "discrete_problem.hpp"
#include "ringing.hpp"
#include "space_time_kernel.hpp"
#include "weights.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// K on the backend, and how it was made.
struct KernelPlan {
  std::unique_ptr<SpaceTimeKernel> kernel;
  std::string description;
  double error = 0;  ///< see Result::kernel_error
  /// The recurrence of the kernel with x0 in its start; none: the response to x0 is a table over time.
  std::optional<Recurrence> started = {};
};

/// What a march is made from, see MarchProblem (core/seam/backend.hpp).
struct MarchData {
  SharedWeights weights;
  SampledSource r;     ///< what the weights leave out; row 0 is not used
  double error = NAN;  ///< of the weights, see Result::kernel_error
  std::string description;
  Vector start = {};                     ///< dense: what x0 and f_0 add to z_0
  RowMatrix forcing = {};                ///< dense: what f adds to z_j, the sources times source_input^T
  Matrix source_input = {};              ///< dense
  const SampledSource* drive = nullptr;  ///< modal: phi with f = B phi

  std::size_t bytes() const;
};

class TimeOperator {
 public:
  /// The problem has to outlive the operator.
  explicit TimeOperator(const DiscreteProblem& p) : p_(p) {}
  virtual ~TimeOperator() = default;
  TimeOperator(const TimeOperator&) = delete;
  TimeOperator& operator=(const TimeOperator&) = delete;

  const DiscreteProblem& problem() const { return p_; }

  /// Whether y that is linear from step to step is safe here. Made once.
  const BasisChoice& basis();
  /// Why there are no weights for such a y; empty where there are.
  virtual std::string missing_weights() { return ""; }
  /// Whether stepping the state with a y that may jump costs so much more than the weights that those are taken as long
  /// as they do not ring.
  virtual bool prefers_weights() const { return false; }
  /// Whether implicit Euler has data for a march too; otherwise it steps the state.
  virtual bool marches_by_euler() const { return true; }
  /// Whether steps whose sources are rough can be taken in parts.
  virtual bool takes_parts() const { return false; }

  /// K for the functional iteration.
  virtual KernelPlan kernel(ConvolutionChoice) = 0;
  /// r. `work` is one array of its shape; where f = B phi drives a Kronecker sum it is left with K phi, and the kernel
  /// has been applied to phi last.
  virtual std::unique_ptr<Array> response(KernelPlan&, Array& work) = 0;

  /// The weights of a grid with `steps` steps, J / steps a power of two, from those of a finer grid or, where null,
  /// from the dynamics.
  virtual SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) = 0;
  /// K from such weights, of the grid of the problem and of any coarser one.
  virtual KernelPlan finest_kernel(const Weights&, ConvolutionChoice) = 0;
  virtual std::unique_ptr<SpaceTimeKernel> kernel_of(const Weights&, Index steps, ConvolutionChoice);
  /// phi with f = B phi, where K carries it to r; r of a coarse grid then holds K phi of that grid.
  virtual const SampledSource* drive() const { return nullptr; }
  /// r of a grid with `steps` steps where it is more than the values of r at the points that the grids share.
  virtual std::optional<RowMatrix> coarse_response(Index /*steps*/) { return std::nullopt; }

  /// Bytes of tables that the operator keeps beside its plans.
  virtual std::size_t bytes_of_tables() const { return 0; }

  virtual MarchData march_data(Rule, RecurrenceChoice) = 0;

  /// The states behind y, chosen components: (J+1) x components, row 0 = x0. `defects`: of a result whose steps were
  /// taken in parts.
  virtual RowMatrix states(Rule, const RowMatrix& y, const std::vector<Index>& components,
                           const StepDefects* defects) = 0;

 protected:
  virtual BasisChoice choose_basis() = 0;
  /// Whether sine modes diagonalise K.
  virtual bool modal() const { return false; }
  /// Whether K is applied by transforms over time.
  virtual bool by_fft(ConvolutionChoice choice) const { return choice == ConvolutionChoice::fft; }

  const DiscreteProblem& p_;

 private:
  std::optional<BasisChoice> basis_;
};

/// Whether stepping m states costs less than transforms over J time points (multiplications of one application of K).
bool scan_is_cheaper(double m, double n, double J);

}  // namespace bromwich
