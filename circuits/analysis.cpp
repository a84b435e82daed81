#include "circuits/analysis.hpp"

#include "circuits/waveform.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>

namespace bromwich::circuits {

std::set<std::string> read_tran(const Card& card, const Parameters& parameters, Netlist& netlist) {
  std::set<std::string> unread;
  std::vector<double> numbers;
  for (std::size_t i = 1; i < card.words.size(); ++i) {
    if (card.words[i] == "uic")
      netlist.use_initial = true;
    else if (card.words[i] == "startup" || card.words[i] == "steady" || card.words[i] == "nodiscard")
      unread.insert(".tran " + card.words[i]);
    else
      numbers.push_back(parameters.value(card.words[i], card.place, ".tran"));
  }
  if (numbers.empty()) throw Error(to_string(card.place), ".tran without a time", "write .tran STEP STOP");
  netlist.stop = numbers.size() == 1 ? numbers[0] : numbers[1];
  netlist.step = numbers.size() == 1 ? 0 : std::abs(numbers[0]);
  netlist.start = numbers.size() > 2 ? numbers[2] : 0;
  if (!(netlist.stop > 0))
    throw Error(to_string(card.place), fmt::format("the end of .tran is {}", netlist.stop), "give a positive time");
  if (netlist.start < 0 || netlist.start >= netlist.stop)
    throw Error(to_string(card.place), fmt::format("the start of .tran is {}", netlist.start),
                "give one between 0 and the end");
  return unread;
}

void close_period(Netlist& netlist, double wanted, const std::string& file_name) {
  std::vector<double> periods;
  for (const Element& e : netlist.elements) {
    if ((e.kind != 'V' && e.kind != 'I') || e.source.constant) continue;
    if (!(e.source.period > 0))
      throw Error(to_string(e.place), fmt::format("{} is not periodic", e.name),
                  "give PULSE with a period, SIN without damping, or a constant");
    periods.push_back(e.source.period);
  }
  const double T = wanted > 0 ? wanted : common_period(periods);
  if (!(T > 0))
    throw Error(file_name, periods.empty() ? "has no source with a period" : "its sources have no common period",
                "give one, --periodic 1m");
  for (const double p : periods)
    if (std::abs(T / p - std::round(T / p)) > 1e-9 * T / p)
      throw Error(file_name, fmt::format("{:.6g} s is no multiple of {:.6g} s, the period of a source", T, p),
                  "give a multiple of all periods, or auto");
  netlist.stop = T, netlist.start = 0, netlist.step = T / 200;
}

}  // namespace bromwich::circuits
