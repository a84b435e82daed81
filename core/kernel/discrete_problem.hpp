#pragma once
// A scene on the grid t_j = j T/J: what every method starts from.

#include "../dynamics/spectrum.hpp"
#include "../scene/source_steps.hpp"
#include "../seam/upload.hpp"
#include "compression.hpp"
#include "response.hpp"
#include "step_defects.hpp"

#include <memory>
#include <mutex>

namespace bromwich {

/// One step of the state, computed on first use; several threads may ask for it.
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
  std::vector<Index> components = {};  ///< of the state, to be recorded by methods that pass through it
  std::shared_ptr<KeptStep> exponential_step = std::make_shared<KeptStep>();  ///< of this h, see state_step
  std::shared_ptr<const SourceSteps> sources = {};                            ///< null where no step is rough
  std::shared_ptr<const StepDefects> defects = {};  ///< of f on those, dense dynamics and the exponential rule
  /// Kronecker sums, (J+1) x n: the response N x to what f does inside rough steps; null where there is none.
  std::shared_ptr<const RowMatrix> rough_response = {};

  const KroneckerDynamics* kronecker() const { return std::get_if<KroneckerDynamics>(&scene.dynamics); }
  const DenseDynamics* dense() const { return std::get_if<DenseDynamics>(&scene.dynamics); }
  const SparseDynamics* sparse() const { return std::get_if<SparseDynamics>(&scene.dynamics); }
  /// phi with f = B phi that a plan adds to y, or null.
  const SampledSource* drive() const { return scene.f_entry == SourceEntry::through_B && f.size() > 0 ? &f : nullptr; }
};

/// Bytes of the tables on the host: sources and y.
std::size_t host_bytes(const DiscreteProblem&);

/// r <- r + rough_response, where there is one.
void add_rough_response(const DiscreteProblem&, Array& r);

/// One step of the dense state; the exponential one takes some twenty products of m x m matrices and is made once.
std::shared_ptr<const StepOperators> state_step(const DiscreteProblem&, Rule);

/// F with f_j = F phi_j, the samples p.f: m x their number (dense dynamics).
inline Matrix source_matrix(const DiscreteProblem& p) { return source_matrix(p.scene, *p.dense()); }

/// x_j from y, all states (dense dynamics): with the defects given, or else those of the problem.
RowMatrix states_from(const DiscreteProblem&, Rule, const RowMatrix& y, const StepDefects* = nullptr);

/// B y_j + f_j as rows in R^m (dense dynamics).
RowMatrix state_input(const DiscreteProblem&, const RowMatrix& y);

/// r of the complementarity problems with y left out: g + N e^{At} x0 + response to f, row 0 = N x0 + g(0).
/// Dense dynamics, either rule.
RowMatrix dense_response(const DiscreteProblem&, Rule);

/// N x at the time points from r and v = K * y: (J+1) x n; w = r + v + M y, so that r + v = N x + g.
RowMatrix trace(const DiscreteProblem&, const Array& r, const Array& v);

/// S N e^{A t_j} x0 for the Kronecker sum from contours, (J+1) x n in modes.
RowMatrix kronecker_initial_response(const DiscreteProblem&);

}  // namespace bromwich
