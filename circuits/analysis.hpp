#pragma once
// The times of a netlist: of .tran, or one period.

#include "circuits/cards.hpp"
#include "circuits/netlist.hpp"
#include "circuits/values.hpp"

#include <set>
#include <string>

namespace bromwich::circuits {

/// Sets the times of .tran, and whether it has uic. Returns words that it has and that are not read. Throws Error
/// naming the place.
std::set<std::string> read_tran(const Card&, const Parameters&, Netlist&);

/// The period as the end of time, in place of .tran's: `wanted` seconds, or of 0 the least common one of the sources.
/// Throws Error naming a source, or the file.
void close_period(Netlist&, double wanted, const std::string& file_name);

}  // namespace bromwich::circuits
