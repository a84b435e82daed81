#pragma once
// What steps of collocation do, kept for modes and lengths that recur.

#include "mode.hpp"
#include "stage_systems.hpp"

#include <map>
#include <utility>
#include <vector>

namespace bromwich {

class Propagators {
 public:
  explicit Propagators(double longest) : longest_(longest) {}

  /// The longest of `longest`, 3/4, 1/2, 3/8, 1/4, ... of it that is no longer than the length.
  double grid_length(double length) const;

  /// Z on [0, h] with Z(0) = 0 and Z' = A_S Z + input, m values. Returns the polynomials that the collocation has
  /// found, until the next call. Where the input is a line, which is changed then, these are of a length of the grid
  /// and may reach beyond h: lengths from events to breakpoints do not recur.
  const LegendreCoefficients& move(const SwitchedMode&, double h, LegendreCoefficients& input, LegendreCoefficients& z,
                                   double& work);

 private:
  /// Steps of one length in one mode.
  struct Recurring {
    Index used = 0;
    std::vector<Matrix> columns;  ///< Z, (s+1) m values, by coefficient k of the input
  };

  double grid_length_above(double length) const;
  StageSystems& systems_of(const SwitchedMode&, double& work);
  void collocate(const SwitchedMode&, double h, const LegendreCoefficients& input, LegendreCoefficients& z,
                 double& work);
  void propagate(const SwitchedMode&, double h, const LegendreCoefficients& input, Index degrees,
                 LegendreCoefficients& z, double& work);

  double longest_;
  std::map<const SwitchedMode*, StageSystems> systems_;
  std::map<std::pair<const SwitchedMode*, double>, Recurring> recurring_;
  std::size_t kept_ = 0;  ///< numbers in both
  LegendreCoefficients whole_;
  StageSystems::AtStages right_, left_, part_, change_;
};

}  // namespace bromwich
