#pragma once
// Small signals about the periodic state of a circuit: what a sine of small amplitude of one source does to every
// output, at the same frequency.
//
// With x(t) = x*(t) + Re δ(t) and a source u + Re ε e^{jwt}, the response over the period T obeys
//
//     δ(T) = D δ(0) + ε q(w),    δ(t + T) = e^{jwT} δ(t):    δ(0) = ε (e^{jwT} - D)^{-1} q(w),
//
// and the output at w is (1/T) ∫_0^T e^{-jwt} δy dt: one row of the harmonic transfer function (Wereley & Hall 1990;
// Möllerstedt & Bernhardsson 2000). D, q and the integrals are central differences of one period of located events,
// not of transients: switches that move, gates and modes with memory count.

#include "circuits/circuit.hpp"
#include "circuits/probe.hpp"

#include <complex>
#include <memory>
#include <string>
#include <vector>

namespace bromwich {

class Backend;

/// The probes about a periodic state, for any source and frequency. Throws Error naming `where`: a result that is not
/// the solved periodic state of the circuit; a change of the source that changes the sequence of modes; a frequency at
/// which e^{jwT} is a multiplier of the period.
class SmallSignals {
 public:
  SmallSignals(const Circuit&, Backend&, const Result&, std::vector<Probe>, std::string where);
  ~SmallSignals();

  /// A value a probe, for 1 V or 1 A of an independent source; `frequency` in Hz.
  Eigen::RowVectorXcd of_source(const std::string& source, double frequency) const;
  /// The same for 1 A that is taken from the first node and put into the second one.
  Eigen::RowVectorXcd of_current(const std::string& from, const std::string& into, double frequency) const;

 private:
  struct Period;
  Eigen::RowVectorXcd of_element(std::size_t element, const circuits::Netlist&, double frequency) const;
  Period solved(Circuit, const Vector& x0) const;
  Eigen::RowVectorXcd spectrum(const Period&, double omega) const;
  void look_at_sizes(const Result&);
  void differentiate_by_states();

  const Circuit& circuit_;
  Backend& backend_;
  const std::vector<Probe> probes_;
  const std::string where_;
  Vector start_, steps_;
  std::vector<std::string> modes_;  ///< with which the period begins
  double volts_ = 0, amperes_ = 0;  ///< amplitudes of sources
  Matrix D_;
  std::vector<Period> by_state_;  ///< up and down for each state
};

/// frequencies x probes, of one source.
Eigen::MatrixXcd small_signals(const Circuit&, Backend&, const Result&, const std::string& source,
                               const std::vector<double>& frequencies, const std::vector<Probe>&,
                               const std::string& where);

}  // namespace bromwich
