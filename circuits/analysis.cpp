#include "circuits/analysis.hpp"

#include "circuits/waveform.hpp"
#include "core/base/error.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich::circuits {

namespace {

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

}  // namespace

std::vector<double> frequencies_of(const std::string& kind, const std::vector<double>& numbers,
                                   const std::string& where) {
  constexpr double most = 1e5, rounding = 1e-9;  // frequencies; of an interval
  const auto refuse = [&](const std::string& found) {
    throw Error(where, found, "write dec 20 100 100k: points a decade, first and last frequency");
  };
  std::vector<double> all = numbers;
  if (kind != "list") {
    if (kind != "dec" && kind != "oct" && kind != "lin") refuse(fmt::format("'{}' is unknown", kind));
    if (numbers.size() != 3) refuse(fmt::format("has {} numbers", numbers.size()));
    const double points = numbers[0], first = numbers[1], last = numbers[2];
    if (!(points >= 1 && first > 0 && last >= first)) refuse(fmt::format("{} {} {} {}", kind, points, first, last));
    const double intervals =
        kind == "lin" ? points - 1 : std::log(last / first) / std::log(kind == "dec" ? 10 : 2) * points;
    if (!(intervals < most)) refuse(fmt::format("has {:.3g} frequencies, more than {:g}", intervals, most));
    all.clear();
    for (double k = 0; k <= intervals + rounding; ++k)
      all.push_back(kind == "lin" ? first + (last - first) * k / std::max(1.0, intervals)
                                  : first * std::pow(kind == "dec" ? 10 : 2, k / points));
  }
  if (all.empty()) refuse("has no frequency");
  for (const double f : all)
    if (!(f > 0 && std::isfinite(f))) refuse(fmt::format("found the frequency {}", f));
  return all;
}

std::set<std::string> read_analysis(const Card& card, const Parameters& parameters, Netlist& netlist) {
  if (card.words[0] == ".tran") return read_tran(card, parameters, netlist);
  if (card.words[0] != ".ac") return {};
  std::vector<double> numbers;
  for (std::size_t i = 2; i < card.words.size(); ++i)
    numbers.push_back(parameters.value(card.words[i], card.place, ".ac"));
  netlist.frequencies = frequencies_of(card.words.size() > 1 ? card.words[1] : "", numbers, to_string(card.place));
  return {};
}

std::complex<double> read_signal(const std::vector<std::string>& words, const Parameters& parameters,
                                 const Place& place) {
  std::string all;
  for (const std::string& word : words) all += word + " ";
  const std::vector<std::string> list = split_arguments(all);
  const auto at = std::find(list.begin(), list.end(), "ac");
  if (at == list.end()) return 0;
  std::vector<double> given;
  for (auto next = at + 1; next != list.end() && given.size() < 2 && is_number(*next); ++next)
    given.push_back(parameters.value(*next, place, "AC"));
  return (given.empty() ? 1 : given[0]) * std::polar(1.0, given.size() < 2 ? 0 : given[1] * std::numbers::pi / 180);
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
  double T = wanted > 0 ? wanted : common_period(periods);
  if (const auto& f = netlist.frequencies; !(T > 0) && periods.empty() && !f.empty())
    T = 1 / std::sqrt(*std::min_element(f.begin(), f.end()) * *std::max_element(f.begin(), f.end()));
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
