#pragma once
// Circuits of R, L, C, K < 1, V, I, diodes and gated switches, mode by mode. It shares nothing with the library: it
// reads the netlist by itself, takes diodes and switches as resistances, solves the nodal equations of each mode, and
// goes on by matrix exponentials of the state beside its sources, from one change of mode to the next.

#include <map>
#include <string>
#include <vector>

namespace bromwich::test {

struct ReferenceValues {
  std::map<std::string, double> end;              ///< "V(C1)", "I(L1)" at the end of .tran
  std::map<std::string, double> largest;          ///< of these, by absolute value
  std::map<std::string, std::vector<double>> at;  ///< these at the times that were asked for
  long changes = 0;                               ///< of modes
};

/// `times`: increasing, up to the end of .tran. Throws std::runtime_error where no mode fits, or for a card that it
/// does not know.
ReferenceValues mode_by_mode(const std::string& netlist, const std::vector<double>& times = {});

}  // namespace bromwich::test
