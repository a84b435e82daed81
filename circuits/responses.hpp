#pragma once
// Responses of a circuit about its periodic state over frequency, by words:
//
// V(out), I(L1), ...   a probe, per volt or ampere of one source, or for the AC amplitudes of the netlist
// gain(Vz)             -V(second node)/V(first node) of the source Vz of 0 V, for its loop (Middlebrook 1975)
// impedance(a,b)       V(a,b) for a current of 1 A from b to a; impedance(a): from ground

#include "circuits/small_signal.hpp"

#include <string>
#include <vector>

namespace bromwich {

struct Responses {
  std::vector<double> frequencies;  ///< Hz
  std::vector<std::string> names, units;
  Eigen::MatrixXcd values;  ///< frequencies x names
};

/// `source`: of the probes; empty: all with AC. No words: all voltages outside of subcircuits. Throws Error naming
/// `where`, as SmallSignals does.
Responses responses(const Circuit&, Backend&, const Result&, std::vector<std::string> words, const std::string& source,
                    const std::vector<double>& frequencies, const std::string& where);

/// In degrees, without jumps by 360 from one frequency to the next; the first one lies in (-180, 180].
Vector unwrapped_phase(const Eigen::Ref<const ComplexVector>&);

/// Of a loop gain; NaN where there is none within the frequencies.
struct StabilityMargins {
  double crossover = NAN;        ///< Hz: where its size falls below 1, the first time
  double phase = NAN;            ///< degrees there, beyond -180
  double phase_crossover = NAN;  ///< Hz: where its phase falls below -180, the first time
  double gain = NAN;             ///< dB there, below 1
};
StabilityMargins stability_margins(const std::vector<double>& frequencies, const Eigen::Ref<const ComplexVector>& gain);

}  // namespace bromwich
