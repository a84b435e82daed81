#pragma once
// f and g of a scene on the parts of a certificate.

#include "../events/event_sources.hpp"
#include "parts.hpp"

#include <array>
#include <optional>

namespace bromwich {

struct PartSources {
  std::array<Vector, 3> f;  ///< coefficients of 1, σ, σ², through three Gauss points; empty without f
  std::array<Vector, 2> g;  ///< at the nodes, at the end from the left
};

class PartSampler {
 public:
  /// Dense dynamics. The scene has to outlive the sampler.
  explicit PartSampler(const Scene&);
  bool has_f() const { return has_f_; }
  PartSources on(const Part&) const;
  /// Whether the values at the nodes describe f and g on the part: at one more place f is the parabola, and g the line
  /// between its neighbours, to a hundredth of their largest values so far.
  bool resolves(const Part&, const PartSources&);

 private:
  EventSources sources_;
  bool has_f_, has_g_;
  std::optional<OneSided> at_ends_;
  Vector zero_, size_of_f_, size_of_g_;
};

}  // namespace bromwich
