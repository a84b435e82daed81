#pragma once
// Netlists as tests/circuits/mode_reference.hpp reads them: R, L, C, K, V, D, S with numbers, .model and .tran.

#include <cmath>
#include <map>
#include <string>
#include <vector>

namespace bromwich::test {

struct ReferenceSource {  // offset + line in pieces, or offset + amplitude sin(w t + phase)
  double offset = 0, amplitude = 0, w = 0, phase = 0;
  double low = 0, high = 0, delay = 0, rise = 0, fall = 0, width = 0, period = 0;

  bool pulses() const { return period > 0; }
  double value(double t) const;
};

struct ReferencePart {
  char kind;
  std::string name;
  int a, b;          ///< nodes, -1: ground
  double value = 0;  ///< R, L, C
  double initial = 0;
  ReferenceSource source = {};
  std::string model = {};
  int control_a = -1, control_b = -1;
};

struct ReferenceModel {
  double on = 1, off = 1e12, forward = 0, reverse = INFINITY, on_reverse = 0, threshold = 0;
};

struct ReferenceNetlist {
  std::vector<ReferencePart> parts;
  std::map<std::string, int> nodes;
  std::map<std::string, ReferenceModel> models;
  std::vector<std::vector<std::string>> couplings;  ///< words of the cards K
  double stop = 0;
};

double reference_number(const std::string& word);

/// Throws std::runtime_error for a card that it does not know.
ReferenceNetlist read_reference_netlist(const std::string& text);

}  // namespace bromwich::test
