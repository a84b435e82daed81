#pragma once
// American puts in the study of cycles in w: their V is local, and steps in w take the place of cycles.

#include "bench/studies/study.hpp"

namespace bromwich::app {

/// Values at the spot compared with published ones and with binomial trees (scripts/put_reference), one row each, on
/// one core of the host. Returns the lines of a table.
std::vector<std::vector<std::string>> measure_puts(bool quick, BenchReport&);

/// What the rows say.
std::string note_on_puts(const Json& rows);

}  // namespace bromwich::app
