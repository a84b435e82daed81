#pragma once
// One dynamics on one time grid: what iteration, multigrid and marching need to know of A, B and N. With K the discrete
// convolution of the grid,
//
//     w = M y + r + K y,
//
// an operator makes the weights of K, plans that apply it, r, the data of a march, the same for coarser grids, and the
// states of a solution y. There is one for each kind of dynamics: core/kernel/dense_operator.cpp steps the state,
// core/kernel/modal_operator.cpp works in sine modes, core/kernel/lag_operator.cpp tabulates weights from shifted
// solves.

#include "bromwich/options.hpp"
#include "changes.hpp"
#include "discrete_problem.hpp"
#include "ringing.hpp"
#include "space_time_kernel.hpp"
#include "transposed_kernel.hpp"
#include "weights.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// K on the backend, and its origin.
struct KernelPlan {
  std::shared_ptr<SpaceTimeKernel> kernel;
  std::string description;
  double error = 0;            ///< see Result::kernel_error
  SharedWeights weights = {};  ///< of a kernel applied by recurrence; null: by a table
};

/// The weights that a kernel applies, in the form in which it does: a recurrence as a scan, a table by FFT.
struct KernelWeights {
  SharedWeights weights;
  std::string description;
  double error = 0;  ///< see Result::kernel_error
};

/// Input of MarchProblem (core/seam/plans.hpp). The weights stay; the rest depends on x0, f and g.
struct MarchData {
  std::shared_ptr<Weights> weights;
  double error = NAN;  ///< of the weights, see Result::kernel_error
  std::string description;
  bool compressed = false;  ///< modal: exponentials fitted to the kernel

  SampledSource r = {};                  ///< part outside the weights; row 0 is not used
  bool r_has_x0 = false;                 ///< x0 is in r
  double error_of_x0 = 0;                ///< modal, compressed: error of the contribution of x0
  Vector start = {};                     ///< dense: contribution of x0 and f_0 to z_0
  RowMatrix forcing = {};                ///< dense: contribution of f to z_j, sources times source_input^T
  Matrix source_input = {};              ///< dense
  const SampledSource* drive = nullptr;  ///< modal: phi with f = B phi

  std::size_t bytes() const;
};

class TimeOperator {
 public:
  /// The problem must outlive the operator.
  explicit TimeOperator(const DiscreteProblem& p) : p_(p) {}
  virtual ~TimeOperator() = default;
  TimeOperator(const TimeOperator&) = delete;
  TimeOperator& operator=(const TimeOperator&) = delete;

  const DiscreteProblem& problem() const { return p_; }

  /// Called after x0, f or g of the problem have changed.
  virtual void renew(const Changes&) {}
  /// From now on keeps the data that another x0 or other sources need.
  void keep_prepared() { keeps_ = true; }
  bool keeps_prepared() const { return keeps_; }

  /// Whether y may be linear between steps here. Computed once.
  const BasisChoice& basis();
  /// Why there are no weights for such y; empty if there are.
  virtual std::string missing_weights() { return ""; }
  /// Whether stepping the state with discontinuous y is so much more expensive that the weights are used as long as
  /// they do not ring.
  virtual bool prefers_weights() const { return false; }
  /// Whether implicit Euler has march data; otherwise it steps the state.
  virtual bool marches_by_euler() const { return true; }
  /// Whether steps with rough sources can be divided into parts.
  virtual bool takes_parts() const { return false; }

  /// K for the functional iteration.
  virtual KernelPlan kernel(ConvolutionChoice) = 0;
  /// What kernel(choice) applies; the same weights in every call.
  virtual KernelWeights kernel_weights(ConvolutionChoice choice) = 0;
  /// K^T with the weights of kernel(choice), for adjoint equations: <K y, u> = <y, K^T u> up to rounding of the sums.
  /// Precondition: missing_weights() is empty.
  TransposedKernel transposed_kernel(ConvolutionChoice choice) {
    return TransposedKernel(p_.backend, kernel_weights(choice).weights, p_.J + 1);
  }
  /// Computes r; returns the error of x0 in it. `work` is an array of the same shape. If f = B phi drives a Kronecker
  /// sum, `work` holds K phi afterwards, and phi is what the kernel was last applied to.
  virtual double response(const KernelPlan&, Array& work, Array& r) = 0;
  /// The same in two parts, if the contribution of x0 is separate. r <- response to f and g, with `input` as workspace;
  /// `work` as for `response`.
  virtual bool separates_x0() const { return false; }
  virtual void response_to_sources(const KernelPlan&, Array& /*input*/, Array& /*work*/, Array& /*r*/) {}
  /// r <- known + response to x0 from row 1 on; returns its error. Row 0 of `known`, which may be r, holds N x0 + g(0).
  /// `zero` must hold zeros and may be overwritten.
  virtual double add_x0(const KernelPlan&, Array& /*zero*/, const Array& /*known*/, Array& /*r*/) { return 0; }

  /// Weights of a grid with `steps` steps, J / steps a power of two: from those of a finer grid, or from the dynamics
  /// if `finer` is null.
  virtual SharedWeights weights(Index steps, const Weights* finer, Index finer_steps) = 0;
  /// K from these weights, on the grid of the problem or a coarser one.
  virtual KernelPlan finest_kernel(const SharedWeights&, ConvolutionChoice) = 0;
  std::unique_ptr<SpaceTimeKernel> kernel_of(const Weights&, Index steps, ConvolutionChoice);
  /// phi, f = B phi, if r contains K phi; r of a coarse grid then contains K phi of that grid.
  virtual const SampledSource* drive() const { return nullptr; }
  /// r of a grid with `steps` steps, if it is not r restricted to the shared grid points.
  virtual std::optional<RowMatrix> coarse_response(Index /*steps*/) { return std::nullopt; }

  /// Bytes of tables kept by the operator in addition to its plans.
  virtual std::size_t bytes_of_tables() const { return 0; }

  /// Only the weights.
  virtual MarchData march_weights(Rule, RecurrenceChoice) = 0;
  /// The rest, for the current x0, f and g of the problem; unchanged parts are kept from the last call.
  virtual void add_sources(Rule, MarchData&, const Changes&) = 0;

  /// Requested components of the states of y: (J+1) x components, row 0 = x0. `defects`: of a result whose steps were
  /// divided into parts.
  virtual RowMatrix states(Rule, const RowMatrix& y, const std::vector<Index>& components,
                           const StepDefects* defects) = 0;

 protected:
  virtual BasisChoice choose_basis() = 0;
  void forget_basis() { basis_.reset(); }
  /// Whether sine modes diagonalise K.
  virtual bool modal() const { return false; }
  /// Whether K is applied by FFT over time.
  virtual bool by_fft(ConvolutionChoice choice) const { return choice == ConvolutionChoice::fft; }

  const DiscreteProblem& p_;

 public:
  /// The dynamics by few poles, with the components of the problem; null where the operator has none.
  virtual std::shared_ptr<const PoleModel> poles() { return nullptr; }

 private:
  std::optional<BasisChoice> basis_;
  bool keeps_ = false;
};

/// Whether stepping m states is cheaper than FFT over J time points (multiplications per application of K).
bool scan_is_cheaper(double m, double n, double J);

}  // namespace bromwich
