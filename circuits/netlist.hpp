#pragma once
// A netlist with its subcircuits written out: elements between nodes.

#include "circuits/values.hpp"
#include "circuits/waveform.hpp"

#include <cmath>
#include <complex>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace bromwich {

/// A parameter and the values that a .step card gives it.
struct CircuitStep {
  std::string name;
  std::vector<double> values;
};

}  // namespace bromwich

namespace bromwich::circuits {

/// The straight lines of a diode. Open below `forward`, then with slope 1/on; `off` parallel to it.
struct DiodeModel {
  double forward = 0;                         ///< V
  double on = 0;                              ///< ohm
  double off = INFINITY;                      ///< ohm
  double reverse = INFINITY, on_reverse = 0;  ///< V, ohm: breakdown
  std::string straightened;                   ///< of a junction model: what it has become; empty
};

struct SwitchModel {
  double on = 1, off = INFINITY;  ///< ohm
  double threshold = 0,
         hysteresis = 0;  ///< V or A: closes above threshold + hysteresis, opens below threshold - hysteresis
};

/// A diode that conducts from a gate voltage on, until its current falls below the holding current without it.
struct ThyristorModel {
  double gate = 1;        ///< V
  double holding = 1e-3;  ///< A
  double blocks = 1e5;    ///< V: the forward voltage up to which it blocks
};

/// constant + Σ factor V(from, to) + Σ factor I(element), names in lower case.
struct LinearForm {
  struct OfVoltage {
    std::string from, to;
    double factor = 0;
  };
  struct OfCurrent {
    std::string element;
    double factor = 0;
  };
  double constant = 0;
  std::vector<OfVoltage> voltages = {};
  std::vector<OfCurrent> currents = {};
};

struct Element {
  char kind = 'R';   ///< R C L V I E G F H D S W B; of B also P, max(0, form), and U, 1 where the form is above 0
  std::string name;  ///< as it is written, "X1.R1" in a subcircuit
  Place place;
  std::vector<std::string> nodes;  ///< in lower case; "0" is ground. E, G, S: the controlling ones behind
  double value = 0;                ///< ohm, F, H, gain
  std::optional<double> initial;   ///< IC=; of S and W 1 for ON
  Waveform source;                 ///< V, I
  std::complex<double> signal;     ///< V, I: of a small-signal analysis, AC
  std::string controlled_by;       ///< F, H, W: a voltage source, in lower case
  DiodeModel diode;
  SwitchModel gate;
  std::optional<LinearForm> form;           ///< of B, P and U
  bool of_voltage = true;                   ///< of B
  bool hidden = false;                      ///< a part of B, whose node nothing else has: no output
  std::optional<ThyristorModel> thyristor;  ///< of kind D, whose nodes are anode, cathode and those of the gate
};

/// K: the coupling of the inductors, which are in lower case.
struct Coupling {
  std::string name;
  Place place;
  std::vector<std::string> inductors;
  double value = 0;
};

struct Netlist {
  std::string title;
  std::vector<Element> elements;
  std::vector<Coupling> couplings;
  std::map<std::string, std::string> written;           ///< nodes in lower case: as they are written first
  std::map<std::string, double> initial;                ///< .ic V(node)=
  std::map<std::string, double> parameters;             ///< .param of the top level
  double step = 0, stop = 0, start = 0;                 ///< .tran; step 0: not given
  bool use_initial = false;                             ///< uic
  std::vector<double> frequencies;                      ///< .ac, Hz
  bool periodic = false;                                ///< stop is the period
  std::vector<std::pair<Place, std::string>> measures;  ///< .meas of the top level, as they are written
  std::vector<CircuitStep> steps;                       ///< .step, without parameters that settings fix
  std::vector<std::string> notes;                       ///< what was skipped or straightened, one line each
  std::vector<std::filesystem::path> inputs;
};

/// Throws Error naming file, line and element. `settings` replace parameters of the top level. `period`: the
/// length of a periodic state; 0: the least common period of the sources.
Netlist read_netlist(std::string_view text, const std::string& file_name, const std::filesystem::path& folder,
                     const std::map<std::string, double>& settings, std::optional<double> period = {});

}  // namespace bromwich::circuits
