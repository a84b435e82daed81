#pragma once
// Rough steps: steps of a grid on which f or g is not linear, as the discretisation assumes. They contain a breakpoint
// of the scene, end at one where the source has a value of its own, or are found by values inside them.
//
// A rough step is divided into parts. g is linear on each, with one-sided values at its ends. f is given in pieces,
// each within one part. On each piece the phi of f = F phi is a polynomial of degree 2 through three Gauss points,
//
//     phi(start + sigma length) = c0 + c1 sigma + c2 sigma^2,   0 <= sigma <= 1,
//
// halved until it agrees with further values. Nothing is evaluated at a breakpoint itself.

#include "../base/time_function.hpp"
#include "scene.hpp"
#include "separable.hpp"

#include <vector>

namespace bromwich {

struct SourcePiece {
  double start = 0, length = 0;
  Matrix phi;  ///< k x 3: c0, c1, c2 of what SampledSource::values holds
};

struct RoughStep {
  Index step = 0;                   ///< from t_{step-1} to t_step
  std::vector<double> ends;         ///< of its parts, increasing; the last is t_step
  std::vector<SourcePiece> pieces;  ///< of f, in order; empty without f
};

/// A source with its limits from both sides.
class OneSided {
 public:
  /// `resolution`: accuracy of the times of jumps.
  OneSided(const TimeFunction&, Index width, double resolution);
  Vector after(double t, double length) const;   ///< the limit from the right; smooth on (t, t + length)
  Vector before(double t, double length) const;  ///< from the left
  void value(double t, Vector& v) const;         ///< in the form of SampledSource::values
  Vector whole(const Vector& v) const;           ///< V a if the source is separable
  Index width() const { return width_; }

 private:
  Vector limit(double t, double distance) const;
  const TimeFunction* function_;
  const Matrix* shapes_;
  Index width_;
  double resolution_;
};

/// Whether f or g has at T another value than before it. Steps end behind the jump, located solutions before it.
bool jumps_at_end(const Scene&);

struct SourceSteps {
  std::vector<RoughStep> rough;  ///< by increasing step
  double resolution = 0;         ///< of the times of jumps
  Index unresolved = 0;          ///< steps in which parts or pieces do not agree with further values
  double disagreement = 0;       ///< with parts and pieces shorter than their step, relative to the largest values
  double time = 0;               ///< of the largest disagreement
  bool jumps_of_g = false;       ///< g jumps inside a step, or at a point of the grid
  double disagreement_of_g = 0;  ///< with the linear function between points of the grid, for methods without parts

  const RoughStep* at(Index step) const;  ///< null if the step is not rough
};

/// Number of samples, unless the scene says that it names all breakpoints or has no pulses: pulses as long as T / 12288
/// are seen on any grid.
inline constexpr Index looks_at_unknown_sources = 12288;

/// `every_step`: tests values inside every step; otherwise inside some steps, and where pulses may be unnamed at
/// `looks` places (fewer of sources with many components).
SourceSteps find_source_steps(const Scene&, const Vector& t, const SampledSource& f, const SampledSource& g,
                              bool every_step, Index looks = looks_at_unknown_sources);

}  // namespace bromwich
