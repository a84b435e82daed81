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
#include <string>
#include <vector>

namespace bromwich {

class Backend;

/// The probes for a voltage or current of 1 V or 1 A of `source`, an independent source: frequencies x probes. The
/// circuit is that of a periodic state and the result is its solution. `frequencies` in Hz. Throws Error naming
/// `where`: a source that is none, a result that is not solved, a change of the source that changes the sequence of
/// modes, or where e^{jwT} is a multiplier of the period.
Eigen::MatrixXcd small_signals(const Circuit&, Backend&, const Result&, const std::string& source,
                               const std::vector<double>& frequencies, const std::vector<Probe>&,
                               const std::string& where);

}  // namespace bromwich
