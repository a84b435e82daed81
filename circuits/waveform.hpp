#pragma once
// Independent sources: DC, PULSE, SIN, PWL, EXP, SFFM, expressions of time. Smooth between their breakpoints.

#include "circuits/values.hpp"

#include <functional>
#include <string>
#include <vector>

namespace bromwich::circuits {

struct Waveform {
  std::function<double(double t)> value;  ///< at a jump the value behind it
  std::function<double(double t)> slope;  ///< its derivative, behind a kink
  /// Jumps and kinks in (0, T), increasing.
  std::function<std::vector<double>(double T)> breakpoints;
  double period = 0;    ///< 0: not periodic
  bool linear = false;  ///< between its breakpoints
  bool constant = false;
};

Waveform constant_waveform(double value);

/// sin(angle + phase), the phase in degrees: exact where a multiple of 90 makes it 0, so that what begins with 0 does.
double sine_of(double angle, double phase);

/// Of a card `V name n+ n- [DC v] [AC ...] [PULSE(...)]`: `words` behind the nodes. `stop`: of .tran, default of times.
/// `settled`: as it is long after its delay, also before. Throws Error naming the place.
Waveform read_waveform(const std::vector<std::string>& words, const Parameters&, const Place&, double stop,
                       bool settled = false);

/// Of an expression of `time` and numbers, as Parameters::plain writes them; its jumps and kinks are found. Throws
/// Error naming the place.
Waveform waveform_of_time(const std::string& expression, const Place&);

/// The least time that is a multiple of all periods; 0 where there is none up to 10^4 of the longest.
double common_period(const std::vector<double>& periods);

}  // namespace bromwich::circuits
