#pragma once
// A netlist at many operating points: the values of .step parameters, or of others, in nested loops, and numbers of
// each solution.
//
// word            number
// mean(P)         of a probe P, V(out) or P(D1), over .tran or the period; also rms, min, max, ripple, thd
// P               its value at the end
// power(E)        W, the mean that the element E takes
// efficiency      of all that is supplied the part that the resistor with the largest power takes
// NAME            a .meas card

#include "bromwich/batch.hpp"
#include "circuits/circuit.hpp"
#include "core/result/options.hpp"

#include <functional>
#include <map>
#include <string>
#include <vector>

namespace bromwich {

class Backend;

/// One row a point, the last parameter varies fastest.
struct OperatingMap {
  std::vector<CircuitStep> steps;
  std::vector<std::string> columns, units;
  RowMatrix settings;  ///< points x steps
  RowMatrix values;    ///< points x columns; NaN where there is none
  Vector residual;     ///< of the complementarity
  std::vector<Status> status;
  std::vector<std::string> reason;

  Index points() const { return settings.rows(); }
};

/// The netlist with these values of parameters.
using ReadCircuit = std::function<Circuit(const std::map<std::string, double>&)>;

/// The first operating point that can be read. Throws what the first one throws where none can.
Circuit first_point(const ReadCircuit&, const std::vector<CircuitStep>&, const std::string& where);

/// The columns of a map that names none: the .meas cards. Without cards, a periodic state has the mean of each voltage
/// and its efficiency, a transient the voltages at its end. Nodes within subcircuits have no column.
std::vector<std::string> map_columns(const Circuit&);

/// Threads of `backend` share the points, each with a backend of `another`. A point that cannot be read has the status
/// unsupported and the reason. Throws Error(where, ...) for no point or too many, and for an unknown word of `columns`.
/// `progress` and `interrupted` are called by the calling thread alone; the points that are left then have the status
/// interrupted.
OperatingMap operating_map(const ReadCircuit&, const std::vector<CircuitStep>&, const std::vector<std::string>& columns,
                           const Options&, const Backend& backend, const MakeBackend& another,
                           const std::string& where);

}  // namespace bromwich
