#pragma once
// The times and frequencies of a netlist: of .tran, or one period, and of .ac.

#include "circuits/cards.hpp"
#include "circuits/netlist.hpp"
#include "circuits/values.hpp"

#include <complex>
#include <set>
#include <string>
#include <vector>

namespace bromwich::circuits {

/// Sets the times of .tran, with whether it has uic, or the frequencies of .ac; nothing for another card. Returns words
/// that it has and that are not read. Throws Error naming the place.
std::set<std::string> read_analysis(const Card&, const Parameters&, Netlist&);

/// dec, oct: `numbers` are points a decade or an octave, first and last; lin: points, first and last; list: these.
/// Throws Error(where, ...).
std::vector<double> frequencies_of(const std::string& kind, const std::vector<double>& numbers,
                                   const std::string& where);

/// Of the words of a source: AC magnitude and phase in degrees; 0 without.
std::complex<double> read_signal(const std::vector<std::string>& words, const Parameters&, const Place&);

/// The period as the end of time, in place of .tran's: `wanted` seconds, or of 0 the least common one of the sources.
/// Where these are constant, any period will do: with .ac it is between those of its frequencies.
/// Throws Error naming a source, or the file.
void close_period(Netlist&, double wanted, const std::string& file_name);

}  // namespace bromwich::circuits
