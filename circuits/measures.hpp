#pragma once
// .meas cards: numbers of a result.
//
//     .meas [tran] NAME AVG|RMS|MIN|MAX|PP|INTEG expression [FROM=t] [TO=t]
//     .meas [tran] NAME FIND expression AT=t  |  FIND expression WHEN event  |  WHEN event
//     .meas [tran] NAME TRIG event TARG event            the time between them
//     .meas [tran] NAME PARAM='expression of other measures'
//     event:  expression=expression | expression VAL=value,  [RISE=n|FALL=n|CROSS=n, or LAST] [TD=t]  |  AT=t

#include "circuits/waveforms.hpp"

#include <optional>
#include <string>
#include <vector>

namespace bromwich {

struct MeasuredValue {
  std::string name, unit;
  double value = 0;   ///< NaN where it has none
  std::string found;  ///< why there is none, "V(out) = 5 is not reached"; empty
};

/// Throws Error naming the line of a card that cannot be read; `measures`: as Circuit::measures.
void check_measures(const Circuit&);

/// Names and units of all cards, without values.
std::vector<MeasuredValue> measures_of(const Circuit&);

/// The values of all cards, in their order, of a result with all states.
std::vector<MeasuredValue> measured(const Circuit&, Backend&, const Result&);

}  // namespace bromwich
