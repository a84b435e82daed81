#include "circuits/responses.hpp"

#include "core/base/error.hpp"

#include <fmt/format.h>

#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <optional>

namespace bromwich {

namespace {

using circuits::lower;

/// A word: the sum of probes with factors over that of others, or over 1.
struct Wanted {
  std::string name, unit;
  enum Kind : char { probe, gain, impedance } kind = probe;
  std::string source = {};                 ///< of a gain
  std::string from = {}, into = {};        ///< of an impedance
  std::vector<std::size_t> of_probe = {};  ///< numbers among all probes
};

std::optional<std::vector<std::string>> arguments_of(const std::string& word, const std::string& function) {
  if (!lower(word).starts_with(function + "(") || word.back() != ')') return std::nullopt;
  return circuits::split_arguments(word.substr(function.size()));
}

class Reading {
 public:
  Reading(const Circuit& c, const std::string& source, const std::string& where) : circuit_(c), where_(where) {
    for (const circuits::Element& e : c.netlist->elements)
      if (source.empty() ? e.signal != 0.0 : lower(e.name) == lower(source)) {
        sources_.emplace_back(e.name, source.empty() ? e.signal : 1);
        unit_of_source_ = source.empty() ? "" : e.kind == 'V' ? "V" : "A";
      }
    if (!source.empty() && sources_.empty())
      throw Error(where, fmt::format("there is no source '{}'", source), "name a source V or I");
  }

  Wanted read(const std::string& word) {
    if (const auto given = arguments_of(word, "gain")) return read_gain(word, *given);
    if (const auto given = arguments_of(word, "impedance")) return read_impedance(word, *given);
    if (sources_.empty())
      throw Error(where_, fmt::format("'{}' is a response to no source", word),
                  "write AC 1 behind a source, or name one");
    const std::size_t at = take(word);
    const std::string& unit = probes_[at].unit();
    return {word, unit_of_source_.empty() ? unit : ratio(unit), Wanted::probe, {}, {}, {}, {at}};
  }

  const std::vector<Probe>& probes() const { return probes_; }
  const std::vector<std::pair<std::string, Complex>>& sources() const { return sources_; }

 private:
  std::size_t take(const std::string& text) {
    probes_.emplace_back(circuit_, text, where_);
    return probes_.size() - 1;
  }

  std::string ratio(const std::string& unit) const {
    if (unit == unit_of_source_) return "";
    if (unit == "V") return "ohm";
    return unit == "A" ? "S" : unit + "/" + unit_of_source_;
  }

  Wanted read_gain(const std::string& word, const std::vector<std::string>& given) {
    if (given.size() == 1)
      for (const CircuitElement& e : circuit_.elements)
        if (lower(e.name) == lower(given[0]) && e.kind == 'V' && e.from >= 0 && e.to >= 0)
          return {word, "", Wanted::gain, e.name, {}, {}, {take(name_of(e.from)), take(name_of(e.to))}};
    throw Error(where_, fmt::format("'{}' names no source of 0 V between two nodes", word),
                "put one into the loop, its first node where the loop is controlled: gain(Vz)");
  }

  const std::string& name_of(Index output) const { return circuit_.outputs[std::size_t(output)].name; }

  Wanted read_impedance(const std::string& word, const std::vector<std::string>& given) {
    if (given.empty() || given.size() > 2)
      throw Error(where_, fmt::format("'{}' has {} nodes", word, given.size()),
                  "write impedance(out) or impedance(a,b)");
    const std::string from = given.size() == 2 ? given[1] : "0";
    return {word, "ohm", Wanted::impedance, {}, from, given[0], {take(fmt::format("V({},{})", given[0], from))}};
  }

  const Circuit& circuit_;
  const std::string& where_;
  std::vector<std::pair<std::string, Complex>> sources_;
  std::string unit_of_source_;
  std::vector<Probe> probes_;
};

std::vector<std::string> all_voltages(const Circuit& c) {
  std::vector<std::string> words;
  for (const CircuitOutput& o : c.outputs)
    if (o.name[0] == 'V' && o.name.find('.') == std::string::npos) words.push_back(o.name);
  return words;
}

}  // namespace

Responses responses(const Circuit& c, Backend& backend, const Result& result, std::vector<std::string> words,
                    const std::string& source, const std::vector<double>& frequencies, const std::string& where) {
  if (words.empty()) words = all_voltages(c);
  Reading reading(c, source, where);
  std::vector<Wanted> wanted;
  for (const std::string& word : words) wanted.push_back(reading.read(word));
  Responses found{frequencies, {}, {}, Eigen::MatrixXcd(Index(frequencies.size()), Index(wanted.size()))};
  for (const Wanted& w : wanted) found.names.push_back(w.name), found.units.push_back(w.unit);
  const SmallSignals signals(c, backend, result, reading.probes(), where);
  for (std::size_t k = 0; k < frequencies.size(); ++k) {
    const double f = frequencies[k];
    std::map<std::string, Eigen::RowVectorXcd> of_sources;
    const auto of_source = [&](const std::string& name) -> const Eigen::RowVectorXcd& {
      const auto known = of_sources.find(name);
      return known != of_sources.end() ? known->second
                                       : of_sources.emplace(name, signals.of_source(name, f)).first->second;
    };
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const Wanted& w = wanted[i];
      Complex& value = found.values(Index(k), Index(i));
      value = 0;
      const Index first = Index(w.of_probe[0]);
      if (w.kind == Wanted::gain)
        value = -of_source(w.source)[Index(w.of_probe[1])] / of_source(w.source)[first];
      else if (w.kind == Wanted::impedance)
        value = signals.of_current(w.from, w.into, f)[first];
      else
        for (const auto& [name, amplitude] : reading.sources()) value += amplitude * of_source(name)[first];
    }
  }
  return found;
}

Vector unwrapped_phase(const Eigen::Ref<const ComplexVector>& values) {
  Vector phase(values.size());
  for (Index k = 0; k < values.size(); ++k) {
    phase[k] = std::arg(values[k]) * 180 / std::numbers::pi;
    if (k > 0) phase[k] -= 360 * std::round((phase[k] - phase[k - 1]) / 360);
  }
  return phase;
}

StabilityMargins stability_margins(const std::vector<double>& frequencies,
                                   const Eigen::Ref<const ComplexVector>& gain) {
  const Vector decibel = 20 * gain.cwiseAbs().array().log10().matrix();
  const Vector phase = unwrapped_phase(gain);
  StabilityMargins m;
  // Between two frequencies by a line over log f; `part` of the way.
  const auto between = [](const Vector& v, Index k, double part) { return v[k] + part * (v[k + 1] - v[k]); };
  const auto frequency = [&](Index k, double part) {
    const double low = frequencies[std::size_t(k)], high = frequencies[std::size_t(k) + 1];
    return low * std::pow(high / low, part);
  };
  for (Index k = 0; k + 1 < gain.size(); ++k) {
    if (std::isnan(m.crossover) && decibel[k] >= 0 && decibel[k + 1] < 0) {
      const double part = decibel[k] / (decibel[k] - decibel[k + 1]);
      m.crossover = frequency(k, part);
      m.phase = std::remainder(180 + between(phase, k, part), 360);
    }
    const double turns = 360 * std::floor((phase[k] + 180) / 360);  // phases of -180 + turns
    if (const double above = phase[k] + 180 - turns, fall = phase[k] - phase[k + 1];
        std::isnan(m.phase_crossover) && fall > 0 && above < fall) {
      const double part = above / fall;
      m.phase_crossover = frequency(k, part);
      m.gain = -between(decibel, k, part);
    }
  }
  return m;
}

}  // namespace bromwich
