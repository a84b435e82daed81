#pragma once
// Where the energy of a circuit goes over a span of time:
//
//     supplied = stored + dissipated,    ∫ -v i of sources = change of Σ C v²/2 + i^T L i/2 + ∫ v i of the others.
//
// The stored part comes from the states at both ends, the others from quadrature, so that `error` tells how well they
// agree. Energy that a loop of capacitors loses when it is closed at t = 0 is not in the span.

#include "circuits/waveforms.hpp"

#include <string>
#include <vector>

namespace bromwich {

struct ElementPower {
  std::string name;
  char kind = 'R';
  double mean = 0, rms = 0, peak = 0;  ///< of the current, A: the largest |i|
  double power = 0;                    ///< W, mean of v i; of sources what they supply, with a minus
};

/// The resistor that takes most, and its part of what sources supply; the name is empty where nothing is.
struct UseOfPower {
  std::string load;
  double efficiency = 0;
};
UseOfPower use_of_power(const std::vector<ElementPower>&);

struct CircuitBalance {
  double from = 0, to = 0;
  std::vector<ElementPower> elements;
  double supplied = 0, stored = 0, dissipated = 0;  ///< J
  double error = 0;                                 ///< of the balance, relative to what flows
  std::string load;
  double efficiency = 0;
};

/// One output over the span.
struct OutputNumbers {
  std::string name, unit;
  double mean = 0, rms = 0, min = 0, max = 0;
  double fundamental = 0;  ///< amplitude of the frequency 1 / span
  double distortion = 0;   ///< of all higher frequencies together, relative to it (THD); NaN without a fundamental
};

OutputNumbers numbers(const Probe&, const CircuitWaveforms&);

CircuitBalance balance(const Circuit&, const CircuitWaveforms&);

}  // namespace bromwich
