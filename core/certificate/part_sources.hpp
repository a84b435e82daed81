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

/// f and g on steps of equal length without breakpoints, many at once: parabolas through three Gauss points.
class StepSources {
 public:
  /// Dense dynamics; `division`: parts of a step. The scene has to outlive the object.
  StepSources(const Scene&, Index division, Index most_steps);

  bool has_f() const { return bool(scene_.f); }
  bool has_g() const { return bool(scene_.g); }
  Index steps() const { return steps_; }
  void clear() { steps_ = 0; }
  /// Another step. False: the parabolas miss the sources at one more place, and the step is not added.
  bool add(double from, double to);
  /// Coefficients of σ^k, k = 0, 1, 2, a row each step: steps x m and steps x n.
  Matrix f(std::size_t k) const;
  Matrix g(std::size_t k) const { return g_.coefficients[k].leftCols(steps_).transpose(); }

 private:
  struct Parabolas {
    Parabolas(Index width, Index most);
    bool add(const TimeFunction&, double from, double to, Index step, double resolved);
    std::array<Matrix, 3> coefficients;  ///< width x steps
    std::array<Vector, 4> values;
    Vector size;  ///< largest values so far
  };

  const Scene& scene_;
  double resolved_;
  Index steps_ = 0;
  Matrix F_;  ///< f = F phi where the scene gives phi
  Parabolas f_, g_;
};

}  // namespace bromwich
