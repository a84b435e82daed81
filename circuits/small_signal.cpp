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

/// w + amplitude cos(omega t + phase).
Waveform with_sine(const Waveform& w, double amplitude, double omega, double phase) {
  Waveform sum = w;
  sum.value = [=](double t) { return w.value(t) + amplitude * std::cos(omega * t + phase); };
  sum.slope = [=](double t) { return w.slope(t) - amplitude * omega * std::sin(omega * t + phase); };
  sum.linear = sum.constant = false;
  if (!(sum.period > 0)) sum.period = 2 * std::numbers::pi / omega;
  return sum;
}

class SmallSignals {
 public:
  SmallSignals(const Circuit& c, Backend& backend, const Result& result, const std::string& source,
               const std::vector<Probe>& probes, const std::string& where)
      : circuit_(c), backend_(backend), probes_(probes), where_(where), element_(find(source)) {
    if (!c.scene.boundary || result.status != Status::solved || result.start.size() != c.scene.states())
      throw Error(where, "needs the solved periodic state of a netlist", "solve scene.periodic(), or with --periodic");
    start_ = result.start;
    for (std::size_t k = 0; k < c.scene.memories.size(); ++k)
      modes_.push_back(c.scene.memories[k].modes[std::size_t(result.modes(0, Index(k)))].name);
    look_at_sizes(result);
    differentiate_by_states();
  }

  Eigen::RowVectorXcd at(double frequency) {
    const double omega = 2 * std::numbers::pi * frequency, T = circuit_.scene.T;
    if (!(frequency > 0)) throw Error(where_, fmt::format("found the frequency {}", frequency), "give a positive one");
    // cos + j sin, e^{jwt}
    ComplexVector q = ComplexVector::Zero(start_.size());
    Eigen::RowVectorXcd direct = Eigen::RowVectorXcd::Zero(Index(probes_.size()));
    for (const auto& [phase, factor] : {std::pair(0.0, Complex(1, 0)), {-std::numbers::pi / 2, Complex(0, 1)}}) {
      Solved pair[2];
      for (const int sign : {0, 1}) pair[sign] = with_source(omega, phase, sign == 0 ? amplitude_ : -amplitude_);
      q += factor / (2 * amplitude_) * (pair[0].end - pair[1].end);
      direct += factor / (2 * amplitude_) * (spectrum(pair[0], omega) - spectrum(pair[1], omega));
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

 private:
  /// One period.
  struct Solved {
    std::shared_ptr<const Circuit> circuit = {};
    std::shared_ptr<const Result> result = {};
    std::shared_ptr<const CircuitWaveforms> waveforms = {};  ///< of these two
    Vector end = {};
  };

  std::size_t find(const std::string& source) const {
    const auto& all = circuit_.netlist->elements;
    for (std::size_t i = 0; i < all.size(); ++i)
      if (lower(all[i].name) == lower(source) && (all[i].kind == 'V' || all[i].kind == 'I')) return i;
    throw Error(where_, fmt::format("there is no independent source '{}'", source), "name a source V or I");
  }

  void look_at_sizes(const Result& result) {
    double volts = 0, amperes = 0;
    const RowMatrix values = output_values(circuit_, result);
    for (std::size_t k = 0; k < circuit_.outputs.size(); ++k) {
      double& largest = circuit_.outputs[k].unit == "V" ? volts : amperes;
      largest = std::max(largest, values.col(Index(k)).cwiseAbs().maxCoeff());
    }
    const auto size = [&](bool voltage) { return small_share * (voltage ? volts : amperes); };
    amplitude_ = size(circuit_.netlist->elements[element_].kind == 'V');
    steps_ = Vector::Zero(start_.size());
    for (Index k = 0; k < start_.size(); ++k) {
      const std::string& unit = circuit_.scene.units.x[std::size_t(k)];
      if (!unit.empty()) steps_[k] = size(unit == "V");  // no states: one that stays 0
    }
    if (!(amplitude_ > 0)) throw Error(where_, "the circuit is at rest", "give its sources values");
  }

  Solved solved(Circuit c, const Vector& x0) const {
    c.scene.boundary.reset();
    c.scene.x0 = x0;
    for (std::size_t k = 0; k < modes_.size(); ++k) c.scene.memories[k].start = modes_[k];
    Options options;
    options.method = Method::events;
    options.steps = 16;
    options.states = StateSelection::all;
    Solved s;
    s.circuit = std::make_shared<const Circuit>(std::move(c));
    s.result = std::make_shared<const Result>(solve(s.circuit->scene, backend_, options));
    if (s.result->status != Status::solved)
      throw Error(where_, "a small change of the circuit is not solved: " + s.result->reason, "see its periodic state");
    s.end = s.result->x.bottomRows(1).transpose();
    s.waveforms =
        std::make_shared<const CircuitWaveforms>(*s.circuit, backend_, *s.result, 0, s.circuit->scene.T, where_);
    return s;
  }

  Solved with_source(double omega, double phase, double amplitude) const {
    circuits::Netlist changed = *circuit_.netlist;
    Waveform& w = changed.elements[element_].source;
    w = with_sine(w, amplitude, omega, phase);
    return solved(make_circuit(changed, where_), start_);
  }

  void differentiate_by_states() {
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
  Eigen::RowVectorXcd spectrum(const Solved& s, double omega) const {
    Eigen::RowVectorXcd all(Index(probes_.size()));
    for (std::size_t k = 0; k < probes_.size(); ++k) all[Index(k)] = s.waveforms->spectrum(probes_[k], omega);
    return all;
  }

  const Circuit& circuit_;
  Backend& backend_;
  const std::vector<Probe>& probes_;
  const std::string& where_;
  const std::size_t element_;
  Vector start_, steps_;
  std::vector<std::string> modes_;  ///< with which the period begins
  double amplitude_ = 0;
  Matrix D_;
  std::vector<Solved> by_state_;
};

}  // namespace

Eigen::MatrixXcd small_signals(const Circuit& c, Backend& backend, const Result& result, const std::string& source,
                               const std::vector<double>& frequencies, const std::vector<Probe>& probes,
                               const std::string& where) {
  SmallSignals signals(c, backend, result, source, probes, where);
  Eigen::MatrixXcd all(Index(frequencies.size()), Index(probes.size()));
  for (std::size_t k = 0; k < frequencies.size(); ++k) all.row(Index(k)) = signals.at(frequencies[k]);
  return all;
}

}  // namespace bromwich
