#include "circuits/small_signal.hpp"

#include "circuits/waveforms.hpp"
#include "core/base/error.hpp"
#include "core/solve/solve.hpp"

#include <fmt/format.h>

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bromwich {

namespace {

using circuits::lower;
using circuits::Waveform;

constexpr double small_share = 1e-5;  ///< of the largest voltage or current: central differences are off by its square

/// w + amplitude sin(omega t + phase), the phase in degrees.
Waveform with_sine(const Waveform& w, double amplitude, double omega, double phase) {
  Waveform sum = w;
  sum.value = [=](double t) { return w.value(t) + amplitude * circuits::sine_of(omega * t, phase); };
  sum.slope = [=](double t) { return w.slope(t) + amplitude * omega * circuits::sine_of(omega * t, phase + 90); };
  sum.linear = sum.constant = false;
  if (!(sum.period > 0)) sum.period = 2 * std::numbers::pi / omega;
  return sum;
}

}  // namespace

struct SmallSignals::Period {
  std::shared_ptr<const Circuit> circuit = {};
  std::shared_ptr<const Result> result = {};
  std::shared_ptr<const CircuitWaveforms> waveforms = {};  ///< of these two
  Vector end = {};
};

SmallSignals::SmallSignals(const Circuit& c, Backend& backend, const Result& result, std::vector<Probe> probes,
                           std::string where)
    : circuit_(c), backend_(backend), probes_(std::move(probes)), where_(std::move(where)) {
  if (!c.scene.boundary || result.status != Status::solved || result.start.size() != c.scene.states())
    throw Error(where_, "needs the solved periodic state of a netlist", "solve scene.periodic(), or with --periodic");
  start_ = result.start;
  for (std::size_t k = 0; k < c.scene.memories.size(); ++k)
    modes_.push_back(c.scene.memories[k].modes[std::size_t(result.modes(0, Index(k)))].name);
  look_at_sizes(result);
  differentiate_by_states();
}

SmallSignals::~SmallSignals() = default;

void SmallSignals::look_at_sizes(const Result& result) {
  double volts = 0, amperes = 0;
  const RowMatrix values = output_values(circuit_, result);
  for (std::size_t k = 0; k < circuit_.outputs.size(); ++k) {
    double& largest = circuit_.outputs[k].unit == "V" ? volts : amperes;
    largest = std::max(largest, values.col(Index(k)).cwiseAbs().maxCoeff());
  }
  // A circuit at rest has no size: it is linear there, or has no small signals.
  if (!(volts > 0)) volts = amperes > 0 ? amperes : 1;
  if (!(amperes > 0)) amperes = volts;
  volts_ = small_share * volts, amperes_ = small_share * amperes;
  steps_ = Vector::Zero(start_.size());
  for (Index k = 0; k < start_.size(); ++k) {
    const std::string& unit = circuit_.scene.units.x[std::size_t(k)];
    if (!unit.empty()) steps_[k] = unit == "V" ? volts_ : amperes_;  // no states: one that stays 0
  }
}

SmallSignals::Period SmallSignals::solved(Circuit c, const Vector& x0) const {
  c.scene.boundary.reset();
  c.scene.x0 = x0;
  for (std::size_t k = 0; k < modes_.size(); ++k) c.scene.memories[k].start = modes_[k];
  Options options;
  options.method = Method::events;
  options.steps = 16;
  options.states = StateSelection::all;
  Period p;
  p.circuit = std::make_shared<const Circuit>(std::move(c));
  p.result = std::make_shared<const Result>(solve(p.circuit->scene, backend_, options));
  if (p.result->status != Status::solved)
    throw Error(where_, "a small change of the circuit is not solved: " + p.result->reason, "see its periodic state");
  p.end = p.result->x.bottomRows(1).transpose();
  p.waveforms =
      std::make_shared<const CircuitWaveforms>(*p.circuit, backend_, *p.result, 0, p.circuit->scene.T, where_);
  return p;
}

void SmallSignals::differentiate_by_states() {
  D_ = Matrix::Zero(start_.size(), start_.size());
  for (Index k = 0; k < start_.size(); ++k)
    for (const int sign : {1, -1}) {
      by_state_.emplace_back();
      if (!(steps_[k] > 0)) continue;
      Vector x0 = start_;
      x0[k] += sign * steps_[k];
      by_state_.back() = solved(circuit_, x0);
      D_.col(k) += sign * by_state_.back().end / (2 * steps_[k]);
    }
}

// ∫ e^{-jwt} of the probes over the period.
Eigen::RowVectorXcd SmallSignals::spectrum(const Period& p, double omega) const {
  Eigen::RowVectorXcd all(Index(probes_.size()));
  for (std::size_t k = 0; k < probes_.size(); ++k) all[Index(k)] = p.waveforms->spectrum(probes_[k], omega);
  return all;
}

Eigen::RowVectorXcd SmallSignals::of_source(const std::string& source, double frequency) const {
  const auto& all = circuit_.netlist->elements;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (lower(all[i].name) == lower(source) && (all[i].kind == 'V' || all[i].kind == 'I'))
      return of_element(i, *circuit_.netlist, frequency);
  throw Error(where_, fmt::format("there is no independent source '{}'", source), "name a source V or I");
}

Eigen::RowVectorXcd SmallSignals::of_current(const std::string& from, const std::string& into, double frequency) const {
  circuits::Netlist more = *circuit_.netlist;
  circuits::Element current;  // behind all others, whose numbers the probes have
  current.kind = 'I';
  current.name = fmt::format("I({},{})", from, into);
  current.nodes = {lower(from), lower(into)};
  current.source = circuits::constant_waveform(0);
  more.elements.push_back(std::move(current));
  return of_element(more.elements.size() - 1, more, frequency);
}

Eigen::RowVectorXcd SmallSignals::of_element(std::size_t element, const circuits::Netlist& netlist,
                                             double frequency) const {
  const double omega = 2 * std::numbers::pi * frequency, T = circuit_.scene.T;
  if (!(frequency > 0)) throw Error(where_, fmt::format("found the frequency {}", frequency), "give a positive one");
  const double amplitude = netlist.elements[element].kind == 'V' ? volts_ : amperes_;
  const auto with_source = [&](double phase, double size) {
    circuits::Netlist changed = netlist;
    Waveform& w = changed.elements[element].source;
    w = with_sine(w, size, omega, phase);
    return solved(make_circuit(changed, where_), start_);
  };
  ComplexVector q = ComplexVector::Zero(start_.size());
  Eigen::RowVectorXcd direct = Eigen::RowVectorXcd::Zero(Index(probes_.size()));
  // cos + j sin, e^{jwt}
  for (const auto& [phase, factor] : {std::pair(90.0, Complex(1, 0)), {0.0, Complex(0, 1)}}) {
    const Period up = with_source(phase, amplitude), down = with_source(phase, -amplitude);
    q += factor / (2 * amplitude) * (up.end - down.end);
    direct += factor / (2 * amplitude) * (spectrum(up, omega) - spectrum(down, omega));
  }
  Eigen::MatrixXcd K = -D_.cast<Complex>();
  K.diagonal().array() += std::polar(1.0, omega * T);
  const Eigen::FullPivLU<Eigen::MatrixXcd> lu(K);
  if (!lu.isInvertible())
    throw Error(where_, fmt::format("the period has a multiplier on the unit circle at {:.6g} Hz", frequency),
                "choose another frequency");
  const ComplexVector start = lu.solve(q);
  for (Index k = 0; k < start_.size(); ++k)
    if (steps_[k] > 0)
      direct += start[k] / (2 * steps_[k]) *
                (spectrum(by_state_[std::size_t(2 * k)], omega) - spectrum(by_state_[std::size_t(2 * k + 1)], omega));
  return direct / T;
}

Eigen::MatrixXcd small_signals(const Circuit& c, Backend& backend, const Result& result, const std::string& source,
                               const std::vector<double>& frequencies, const std::vector<Probe>& probes,
                               const std::string& where) {
  const SmallSignals signals(c, backend, result, probes, where);
  Eigen::MatrixXcd all(Index(frequencies.size()), Index(probes.size()));
  for (std::size_t k = 0; k < frequencies.size(); ++k) all.row(Index(k)) = signals.of_source(source, frequencies[k]);
  return all;
}

}  // namespace bromwich
