#pragma once
// A scene on the grid t_j = j T/J, the input of every method.

#include "../dynamics/spectrum.hpp"
#include "../scene/source_steps.hpp"
#include "../seam/upload.hpp"
#include "compression.hpp"
#include "response.hpp"
#include "shared_dynamics.hpp"
#include "step_defects.hpp"

#include <memory>
#include <mutex>

namespace bromwich {

/// One step of the state, computed on first use. Thread-safe.
class KeptStep {
 public:
  template <class Make>
  std::shared_ptr<const StepOperators> get(Make make) {
    const std::lock_guard lock(mutex_);
    if (!step_) step_ = make();
    return step_;
  }

 private:
  std::mutex mutex_;
  std::shared_ptr<const StepOperators> step_;
};

struct DiscreteProblem {
  const Scene& scene;
  Backend& backend;
  LcpClass lcp_class;  ///< of M, never `automatic`
  Index J;
  double h;
  Vector t;         ///< J+1
  SampledSource g;  ///< (J+1) x n
  SampledSource f;  ///< (J+1) x m, or x n or k values of phi where f = B phi or F phi; empty if f is zero
  Vector start;     ///< n: N x0 + g(0), the q of y_0
  std::vector<Index> components = {};  ///< of the state, to be recorded by methods that step it
  std::shared_ptr<KeptStep> exponential_step = std::make_shared<KeptStep>();  ///< of this h, see state_step
  std::shared_ptr<SharedDynamics> shared = {};                                ///< data of other grids; never null
  std::shared_ptr<const SourceSteps> sources = {};                            ///< null where no step is rough
  std::shared_ptr<const StepDefects> defects = {};  ///< of f on rough steps; dense dynamics and exponential rule only
  /// Kronecker sums, (J+1) x n: response N x to the part of f inside rough steps; null if there is none.
  std::shared_ptr<const RowMatrix> rough_response = {};

  const KroneckerDynamics* modes() const { return scene.dynamics->modes(); }
  const DenseDynamics* small_state() const { return scene.dynamics->small_state(); }
  /// Modes of the face; empty where the dynamics have none.
  FaceBasis face() const { return modes() ? modes()->face_basis() : FaceBasis{}; }
  /// phi, f = B phi, as an input beside y; null if there is none.
  const SampledSource* drive() const { return scene.f_entry == SourceEntry::through_B && f.size() > 0 ? &f : nullptr; }
};

/// Bytes of the tables on the host: sources and y.
std::size_t host_bytes(const DiscreteProblem&);

/// r <- r + rough_response, if there is one.
void add_rough_response(const DiscreteProblem&, Array& r);

/// One step of the dense state. Made once; see SharedDynamics::step.
std::shared_ptr<const StepOperators> state_step(const DiscreteProblem&, Rule);

/// F with f_j = F phi_j for the samples p.f (dense dynamics): m x width of p.f.
inline Matrix source_matrix(const DiscreteProblem& p) { return source_matrix(p.scene, *p.small_state()); }

/// All states x_j from y (dense dynamics), with the given defects or those of the problem.
RowMatrix states_from(const DiscreteProblem&, Rule, const RowMatrix& y, const StepDefects* = nullptr);

/// B y_j + f_j as rows in R^m (dense dynamics): all, or `rows` of them.
RowMatrix state_input(const DiscreteProblem&, const RowMatrix& y);
RowMatrix state_input(const DiscreteProblem&, const RowMatrix& y, Index first, Index rows);

/// r of the complementarity problems, without y: g + N e^{At} x0 + response to f; row 0 = N x0 + g(0). Dense dynamics,
/// either rule.
RowMatrix dense_response(const DiscreteProblem&, Rule);

/// N x at the time points, (J+1) x n, as r + v - g with v = K * y (w = r + v + M y).
RowMatrix trace(const DiscreteProblem&, const Array& r, const Array& v);

/// S N e^{A t_j} x0 for the Kronecker sum from contours, (J+1) x n in modes.
RowMatrix kronecker_initial_response(const DiscreteProblem&);

}  // namespace bromwich
