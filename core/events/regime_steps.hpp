#pragma once
// What an integration with located events has for each regime that it comes to.

#include "../lcp/lcp_class.hpp"
#include "event_step.hpp"
#include "regime.hpp"
#include "short_steps.hpp"
#include "successor.hpp"

#include <map>
#include <memory>
#include <utility>
#include <vector>

namespace bromwich {

struct RegimeSteps : Regime {
  ShortSteps short_steps;
  EventSteps steps;
  Successor successor;
  bool unique;      ///< short steps determine the solution
  bool enumerates;  ///< otherwise: all active sets are tried
  /// No active set is selected by trying: a least element that is no solution of least norm.
  bool open = false;

  RegimeSteps(const Scene& all, std::vector<Index> in, LcpClass of_all, const StepLimits& limits,
              const std::shared_ptr<SourceLooks>& looks)
      : Regime(all, std::move(in), looks),
        short_steps(system, sources, all.T),
        steps(system, sources, all.T, limits),
        successor(system, sources, short_steps, steps, all.T) {
    const Index n = system.pairs();
    const Matrix M = system.M.topLeftCorner(n, n);
    const bool same_M = modes.empty() || M == to_dense(all.M).topLeftCorner(n, n);
    const LcpClass lcp_class = same_M ? of_all : selection_class(LcpMatrix(M), LcpClass::automatic);
    unique = short_steps.unique(lcp_class);
    enumerates = !unique && system.constraints() <= Successor::most_enumerated;
    open = !unique && selects_least(lcp_class) && !is_PSD(LcpMatrix(M));
  }
};

/// By the modes of the memories of a scene, made where they are first asked for.
class RegimesOfScene {
 public:
  /// The scene has to outlive the integration. Another than the first may differ in x0 alone.
  void begin(const Scene& scene, LcpClass lcp_class, const StepLimits& limits) {
    scene_ = &scene;
    class_ = lcp_class;
    limits_ = limits;
    for (auto& [modes, regime] : known_) regime->steps.begin(limits);
  }

  RegimeSteps& of(const Vector& x) {
    const std::vector<Index> modes = modes_at(*scene_, x);
    std::unique_ptr<RegimeSteps>& found = known_[modes];
    if (!found) found = std::make_unique<RegimeSteps>(*scene_, modes, class_, limits_, looks_);
    return *found;
  }

 private:
  const Scene* scene_ = nullptr;
  LcpClass class_ = LcpClass::automatic;
  StepLimits limits_;
  const std::shared_ptr<SourceLooks> looks_ = std::make_shared<SourceLooks>();
  std::map<std::vector<Index>, std::unique_ptr<RegimeSteps>> known_;
};

}  // namespace bromwich
