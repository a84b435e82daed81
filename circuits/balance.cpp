#include "circuits/balance.hpp"

#include <algorithm>
#include <cmath>

namespace bromwich {

namespace {

/// Of E, G, F and H as of V and I: what they take is less than 0 where they supply.
bool source(char kind) { return std::string("VIEGFHBPU").find(kind) != std::string::npos; }

double stored_energy(const Circuit& c, const CircuitWaveforms& w, double t) {
  double energy = 0;
  for (const CircuitStore& s : c.stores) {
    const auto of = [&](Index element) {
      const CircuitElement& e = c.elements[std::size_t(element)];
      const auto v = [&](Index output) { return output < 0 ? 0 : w.output(output, t); };
      return e.kind == 'C' ? v(e.from) - v(e.to) : v(e.current);
    };
    energy += s.value / 2 * of(s.a) * of(s.b);
  }
  return energy;
}

}  // namespace

OutputNumbers numbers(const Probe& p, const CircuitWaveforms& w) {
  OutputNumbers n{p.text(), p.unit(), w.mean(p), w.rms(p), w.min(p), w.max(p)};
  n.fundamental = std::abs(w.harmonics(p, 1)[0]);
  // Parseval: rms^2 = mean^2 + Σ |c_k|^2 / 2.
  const double varying = n.rms * n.rms - n.mean * n.mean, first = n.fundamental * n.fundamental / 2;
  constexpr double rounding = 1e-12;
  const bool none = !(first > rounding * n.rms * n.rms);
  n.distortion = none ? NAN : std::sqrt(std::max(0.0, varying - first) / first);
  return n;
}

UseOfPower use_of_power(const std::vector<ElementPower>& elements) {
  UseOfPower use;
  double supplied = 0, most = 0;
  for (const ElementPower& e : elements) {
    if (source(e.kind)) supplied -= e.power;
    if (e.kind == 'R' && e.power > most) most = e.power, use.load = e.name;
  }
  if (supplied > 0) use.efficiency = most / supplied;
  return use;
}

CircuitBalance balance(const Circuit& c, const CircuitWaveforms& w) {
  CircuitBalance b;
  b.from = w.from(), b.to = w.to();
  const double span = b.to - b.from;
  double flows = 0;
  for (const CircuitElement& e : c.elements) {
    const Probe current(c, 'I', e), power(c, 'P', e);
    ElementPower p{e.name, e.kind};
    p.mean = w.mean(current), p.rms = w.rms(current);
    p.peak = std::max(w.max(current), -w.min(current));
    p.power = w.mean(power);
    flows += std::abs(p.power) * span;
    if (source(e.kind))
      b.supplied -= p.power * span;
    else if (e.kind != 'C' && e.kind != 'L')
      b.dissipated += p.power * span;
    b.elements.push_back(std::move(p));
  }
  const double begin = stored_energy(c, w, b.from), end = stored_energy(c, w, b.to);
  b.stored = end - begin;
  flows = std::max({flows / 2, std::abs(begin), std::abs(end)});
  b.error = flows > 0 ? std::abs(b.supplied - b.stored - b.dissipated) / flows : 0;
  const UseOfPower use = use_of_power(b.elements);
  b.load = use.load, b.efficiency = use.efficiency;
  return b;
}

}  // namespace bromwich
