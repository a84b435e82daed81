#include "tests/circuits/reference_netlist.hpp"

#include <algorithm>
#include <numbers>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace bromwich::test {

double reference_number(const std::string& word) {
  std::size_t used = 0;
  const double value = std::stod(word, &used);
  const std::string suffix = word.substr(used);
  if (suffix.starts_with("Meg")) return value * 1e6;
  const std::map<char, double> factors{{'k', 1e3}, {'m', 1e-3}, {'u', 1e-6}, {'n', 1e-9}, {'p', 1e-12}};
  return suffix.empty() ? value : value * factors.at(suffix[0]);
}

double ReferenceSource::value(double t) const {
  if (!pulses()) return offset + amplitude * std::sin(w * t + phase);
  if (t < delay) return low;
  const double s = std::fmod(t - delay, period);
  if (s < rise) return low + (high - low) * s / rise;
  if (s < rise + width) return high;
  return s < rise + width + fall ? high - (high - low) * (s - rise - width) / fall : low;
}

namespace {

class ReferenceReader {
 public:
  ReferenceNetlist read(const std::string& netlist) {
    std::istringstream lines(netlist);
    std::string line;
    std::getline(lines, line);  // the title
    while (std::getline(lines, line)) {
      std::replace_if(
          line.begin(), line.end(), [](char c) { return c == '(' || c == ')' || c == ',' || c == '='; }, ' ');
      std::istringstream in(line);
      std::vector<std::string> words;
      for (std::string word; in >> word;) words.push_back(word);
      if (!words.empty()) card(words);
    }
    return std::move(net_);
  }

 private:
  int node(const std::string& name) {
    if (name == "0") return -1;
    return net_.nodes.emplace(name, int(net_.nodes.size())).first->second;
  }

  void card(const std::vector<std::string>& w) {
    if (w[0] == ".end") return;
    if (w[0] == ".tran") {
      net_.stop = reference_number(w[2]);
      return;
    }
    if (w[0] == ".model") {
      ReferenceModel& l = net_.models[w[1]];
      const std::map<std::string, double ReferenceModel::*> known{
          {"Ron", &ReferenceModel::on},          {"Roff", &ReferenceModel::off},
          {"Vfwd", &ReferenceModel::forward},    {"Vrev", &ReferenceModel::reverse},
          {"Rrev", &ReferenceModel::on_reverse}, {"Vt", &ReferenceModel::threshold}};
      for (std::size_t i = 3; i + 1 < w.size(); i += 2)
        if (known.contains(w[i])) l.*known.at(w[i]) = reference_number(w[i + 1]);
      return;
    }
    if (w[0][0] == 'K') {
      net_.couplings.push_back(w);
      return;
    }
    ReferencePart p{w[0][0], w[0], node(w[1]), node(w[2])};
    switch (p.kind) {
      case 'R':
      case 'L':
      case 'C':
        p.value = reference_number(w[3]);
        if (w.size() > 5 && w[4] == "IC") p.initial = reference_number(w[5]);
        break;
      case 'V':
        p.source = source(w);
        break;
      case 'D':
        p.model = w[3];
        break;
      case 'S':
        p.control_a = node(w[3]), p.control_b = node(w[4]), p.model = w[5];
        break;
      default:
        throw std::runtime_error("the reference does not know " + w[0]);
    }
    net_.parts.push_back(p);
  }

  static ReferenceSource source(const std::vector<std::string>& w) {
    std::vector<double> n;
    for (std::size_t i = 4; i < w.size(); ++i) n.push_back(reference_number(w[i]));
    ReferenceSource s;
    if (w[3] == "SIN") {
      s.offset = n[0], s.amplitude = n[1], s.w = 2 * std::numbers::pi * n[2];
      s.phase = n.size() > 5 ? n[5] * std::numbers::pi / 180 : 0;
    } else if (w[3] == "PULSE") {
      s.low = n[0], s.high = n[1], s.delay = n[2], s.rise = n[3], s.fall = n[4], s.width = n[5], s.period = n[6];
    } else {
      s.offset = reference_number(w[3]);
    }
    return s;
  }

  ReferenceNetlist net_;
};

}  // namespace

ReferenceNetlist read_reference_netlist(const std::string& text) { return ReferenceReader().read(text); }

}  // namespace bromwich::test
