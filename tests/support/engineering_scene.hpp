#pragma once
// Scenes as engineers have them, with sources of which an oracle knows every edge: f = F s(t), g = G s(t), where the
// signals s are constants, sines, pulses and steps.

#include "core/base/types.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace bromwich::oracle {

struct TimeSignal {
  enum class Kind { constant, sine, pulse, step };
  Kind kind = Kind::constant;
  double a = 0, b = 0, c = 0;  ///< sin(a t + b); 1 for c from every a + k b on; 1 from a on

  double value(double t) const;
  std::string text() const;  ///< the expression of scene files
};

struct EngineeringScene {
  std::string name;
  Matrix A, B, N, M, F, G;
  std::vector<TimeSignal> signals;
  Vector x0;
  Vector weight;      ///< of each state: weight_i x_i have one unit, mostly the root of an energy
  double T = 0;       ///< end of the transient
  double period = 0;  ///< of all signals together

  Index states() const { return A.rows(); }
  Index constraints() const { return N.rows(); }
};

/// The scene file; `periodic`: over one period, with x(0) = x(T) in place of x0.
std::string scene_file(const EngineeringScene&, bool periodic = false);

/// The same scene told otherwise: x = to_original x', t = time t'.
struct Retold {
  EngineeringScene scene;
  Matrix to_original;
  double time = 1;
};
enum class Telling { original, mirrored, permuted, other_units };
const char* to_string(Telling);
/// mirrored: x' = -x. permuted: states and constraints in random order. other_units: those of every x_i, y_i, w_i and
/// of time changed by 10^-3 to 10^3.
Retold retold(const EngineeringScene&, Telling, std::uint32_t seed);

/// Circuits of resistors, coils, capacitors, sources behind resistors, gated switches and 2 to 12 diodes on a random
/// connected graph.
EngineeringScene random_circuit(std::uint32_t seed);
/// Chains of masses with rigid and compliant stops, friction on moving belts with given and with varying normal force.
EngineeringScene random_masses(std::uint32_t seed);
/// Tanks between a lower and an upper level, with spill-over, pumps and check valves.
EngineeringScene random_tanks(std::uint32_t seed);

}  // namespace bromwich::oracle
