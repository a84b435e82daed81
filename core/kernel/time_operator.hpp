#pragma once
// One dynamics on one time grid: what iteration, multigrid and marching need of A, B and N. With K the discrete
// convolution of the grid,
//
//     w = M y + r + K y,
//
// an operator makes the weights of K, plans that apply it, r, the data of a march, the same for grids of fewer steps,
// and the states behind a solution y. Each kind of dynamics has one: core/kernel/dense_operator.cpp steps the state,
// core/kernel/modal_operator.cpp works in sine modes, core/kernel/lag_operator.cpp tabulates weights from shifted
// solves.

#include "../result/tuning.hpp"
#include "changes.hpp"
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
  std::shared_ptr<SpaceTimeKernel> kernel;
  std::string description;
  double error = 0;            ///< see Result::kernel_error
  SharedWeights weights = {};  ///< that the kernel applies by recurrence; null: by a table
};

/// What a march is made from, see MarchProblem (core/seam/plans.hpp). The weights stay; the rest is of x0, f and g.
struct MarchData {
  std::shared_ptr<Weights> weights;
  double error = NAN;  ///< of the weights, see Result::kernel_error
  std::string description;
  bool compressed = false;  ///< modal: exponentials fitted to the kernel

  SampledSource r = {};                  ///< what the weights leave out; row 0 is not used
  bool r_has_x0 = false;                 ///< x0 is in r
  double error_of_x0 = 0;                ///< modal, compressed: of what x0 adds
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

  /// The problem has other x0, f or g than before.
  virtual void renew(const Changes&) {}
  /// From now on, what x0 and sources need in order to be taken anew is kept.
  void keep_prepared() { keeps_ = true; }
  bool keeps_prepared() const { return keeps_; }

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
  /// r, and the error of x0 in it. `work` is one array of its shape; where f = B phi drives a Kronecker sum it is left
  /// with K phi, and the kernel has been applied to phi last.
  virtual double response(const KernelPlan&, Array& work, Array& r) = 0;
  /// The same in two parts, where x0's can be had apart. r <- what f and g make of it, by way of `input`; `work` as for
  /// `response`.
  virtual bool separates_x0() const { return false; }
  virtual void response_to_sources(const KernelPlan&, Array& /*input*/, Array& /*work*/, Array& /*r*/) {}
  /// r <- known + what x0 adds from row 1 on; returns its error. Row 0 of `known`, which may be r, holds N x0 + g(0).
  /// `zero` holds zeros, and may hold something else afterwards.
  virtual double add_x0(const KernelPlan&, Array& /*zero*/, const Array& /*known*/, Array& /*r*/) { return 0; }

  /// The weights of a grid with `steps` steps, J / steps a power of two, from those of a finer grid or, where null,
  /// from the dynamics.
  virtual SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) = 0;
  /// K from such weights, of the grid of the problem and of any coarser one.
  virtual KernelPlan finest_kernel(const SharedWeights&, ConvolutionChoice) = 0;
  std::unique_ptr<SpaceTimeKernel> kernel_of(const Weights&, Index steps, ConvolutionChoice);
  /// phi with f = B phi, where K carries it to r; r of a coarse grid then holds K phi of that grid.
  virtual const SampledSource* drive() const { return nullptr; }
  /// r of a grid with `steps` steps where it is more than the values of r at the points that the grids share.
  virtual std::optional<RowMatrix> coarse_response(Index /*steps*/) { return std::nullopt; }

  /// Bytes of tables that the operator keeps beside its plans.
  virtual std::size_t bytes_of_tables() const { return 0; }

  /// The weights alone.
  virtual MarchData march_weights(Rule, RecurrenceChoice) = 0;
  /// The rest, for x0, f and g as the problem has them now; what has not changed is there from the last time.
  virtual void add_sources(Rule, MarchData&, const Changes&) = 0;

  /// The states behind y, chosen components: (J+1) x components, row 0 = x0. `defects`: of a result whose steps were
  /// taken in parts.
  virtual RowMatrix states(Rule, const RowMatrix& y, const std::vector<Index>& components,
                           const StepDefects* defects) = 0;

 protected:
  virtual BasisChoice choose_basis() = 0;
  void forget_basis() { basis_.reset(); }
  /// Whether sine modes diagonalise K.
  virtual bool modal() const { return false; }
  /// Whether K is applied by transforms over time.
  virtual bool by_fft(ConvolutionChoice choice) const { return choice == ConvolutionChoice::fft; }

  const DiscreteProblem& p_;

 private:
  std::optional<BasisChoice> basis_;
  bool keeps_ = false;
};

/// Whether stepping m states costs less than transforms over J time points (multiplications of one application of K).
bool scan_is_cheaper(double m, double n, double J);

}  // namespace bromwich
