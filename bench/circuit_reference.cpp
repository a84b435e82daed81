// Waveforms of netlists by a program that goes mode by mode and shares no code with the library, as JSON on stdout.
//
//     bromwich_circuit_reference FILE...
//
// Of each circuit: its states at 40 times, spread evenly up to the end of .tran, and `difference`: how far they are
// from those of a second run, whose steps are others since it also stops at 97 other times, relative to the largest of
// each.

#include "tests/circuits/mode_reference.hpp"
#include "tests/circuits/reference_netlist.hpp"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

namespace {

using bromwich::test::mode_by_mode;
using bromwich::test::ReferenceValues;

std::vector<double> spread(double T, int parts) {
  std::vector<double> times;
  for (int k = 1; k <= parts; ++k) times.push_back(k == parts ? T : T * k / parts);
  return times;
}

nlohmann::ordered_json reference(const std::string& netlist) {
  constexpr int rows = 40, others = 97;
  const double T = bromwich::test::read_reference_netlist(netlist).stop;
  const std::vector<double> times = spread(T, rows);
  std::vector<double> more = times;
  for (const double t : spread(T, others))
    if (t < T) more.push_back(t);
  std::sort(more.begin(), more.end());
  const ReferenceValues one = mode_by_mode(netlist, times), two = mode_by_mode(netlist, more);
  nlohmann::ordered_json json{{"t", times}, {"changes_of_mode", one.changes}};
  double difference = 0;
  for (const auto& [name, values] : one.at) {
    json["states"][name] = values;
    json["largest"][name] = one.largest.at(name);
    for (std::size_t k = 0, at = 0; k < more.size(); ++k)
      if (at < times.size() && more[k] == times[at])
        difference =
            std::max(difference, std::abs(two.at.at(name)[k] - values[at++]) / std::max(one.largest.at(name), 1e-300));
  }
  json["difference"] = difference;
  return json;
}

}  // namespace

int main(int count, char** words) {
  nlohmann::ordered_json all;
  for (int i = 1; i < count; ++i) {
    std::stringstream text;
    text << std::ifstream(words[i]).rdbuf();
    try {
      all[std::filesystem::path(words[i]).stem().string()] = reference(text.str());
    } catch (const std::exception& error) {
      std::cerr << words[i] << ": " << error.what() << "\n";
      return 1;
    }
  }
  std::cout << all.dump(1) << "\n";
}
