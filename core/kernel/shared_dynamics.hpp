#pragma once
// What all time grids of one scene share: nothing here depends on x0, f, g or the number of steps. Solves on finer and
// finer grids, those that confirm a result with half the step, and a Solver reuse the data that an earlier grid has
// made.
//
// made from                  kept for
// phi-functions of h A       the same h, and 2h by one doubling (core/numerics/matrix_phi.hpp)
// (I - h A)^{-1}             the same h
// fitted exponentials        all steps from the first sample of the fit on
// shifted solves             all grids: contours of windows at times that the grids share
// spectrum, class of M       all grids

#include "../dynamics/dynamics.hpp"
#include "../numerics/matrix_phi.hpp"
#include "../scene/scene.hpp"
#include "bromwich/result.hpp"
#include "compression.hpp"
#include "recurrence.hpp"

#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

namespace bromwich {

/// A fit on [from, T] and what follows from it.
struct KernelFit {
  ExponentialSum sum;
  double from = 0, T = 0;
  std::optional<InitialFit> initial = {};  ///< see SharedDynamics::initial_fit

  /// The error of `sum`, relative to the largest |k| on [h, T].
  double error_from(double h) const;
};

/// One dynamics. The functions may be called by several threads.
class SharedDynamics {
 public:
  /// `many_grids`: grids with half the step will follow. Fits begin at earlier times then, and the windows of contours
  /// are those that the grids share.
  explicit SharedDynamics(Dynamics, bool many_grids = false);

  const Dynamics& dynamics() const { return dynamics_; }

  /// As step_operators(A, rule, h, J), for dynamics with a small state.
  std::shared_ptr<const StepOperators> step(Rule, double h, Index J);
  /// phi_0(h A), ..., phi_5(h A) of the dense form.
  std::shared_ptr<const std::vector<Matrix>> phis(double h);
  Spectrum spectrum();
  /// A, B, N and E as dense matrices.
  const DenseDynamics& dense();

  /// Fits n^T e^{across t} b of a Kronecker sum on [h, T], or on more.
  std::shared_ptr<KernelFit> fit(double h, double T);
  /// The response to x0 by the rates of the fit.
  const InitialFit& initial_fit(Backend&, KernelFit&);

  /// Lags 0 and 1, then windows, covering 0..J, as lag_windows. With `many_grids` the windows from lag 5 on begin at
  /// 4^k times the step of the first grid, where h is that step over a power of two, or 4/3 of it.
  std::vector<LagWindow> windows(const ContourParameters&, double h, Index J, double shift);
  /// N' (z_p E - A)^{-1} B' with the inputs and outputs of `wide`, one row per node. Rows of nodes that a call for the
  /// same B' and N' has seen are kept, with `many_grids` and up to 256 MiB.
  ComplexMatrix resolvents(Backend&, const Dynamics& wide, const ComplexVector& nodes);

  PreparationCounts counts() const;

 private:
  PhiFamily& family();

  mutable std::recursive_mutex mutex_;
  Dynamics dynamics_;
  bool many_grids_;
  std::optional<PhiFamily> family_;
  std::optional<DenseDynamics> dense_;
  std::map<double, std::shared_ptr<const StepOperators>> euler_;  ///< by h
  std::optional<Spectrum> spectrum_;
  std::vector<std::shared_ptr<KernelFit>> fits_;
  double first_step_ = 0;          ///< of the windows; 0: no grid has requested them yet
  SparseMatrix inputs_, outputs_;  ///< B' and N' of rows_
  std::map<std::pair<double, double>, ComplexVector> rows_;
  PreparationCounts counts_;
};

/// The dynamics of a scene, those of the scenes that it is reduced to, and the class of their M.
class GridFamily {
 public:
  explicit GridFamily(bool many_grids = false) : many_grids_(many_grids) {}

  std::shared_ptr<SharedDynamics> of(const Dynamics&);
  /// As Scene::lcp_class; `automatic` is replaced by the result of `classify`.
  LcpClass lcp_class(const Scene&);
  /// Sums over all dynamics so far.
  PreparationCounts counts() const;

 private:
  bool many_grids_;
  std::vector<std::shared_ptr<SharedDynamics>> members_;
  std::optional<std::pair<LcpMatrix, LcpClass>> class_;
  PreparationCounts of_others_;  ///< of members that are gone, and of classifications
};

}  // namespace bromwich
