#pragma once
// Numbers of a result of a circuit over a span of time. Between breakpoints and the steps of located events, or else
// its rows and switches, the solution is smooth: integrals are Gauss quadrature of order 16 there, and extremes and
// crossings are looked for in these pieces.

#include "circuits/circuit.hpp"
#include "circuits/probe.hpp"

#include <complex>
#include <vector>

namespace bromwich {

class Backend;

/// Outputs of a solved result with all states over [from, to].
class CircuitWaveforms {
 public:
  /// Throws Error naming `where` if the result has not all states, or the span is not within its rows.
  CircuitWaveforms(const Circuit&, Backend&, const Result&, double from, double to, const std::string& where);

  double from() const { return edges_.front(); }
  double to() const { return edges_.back(); }

  double integral(const Probe&) const;
  double mean(const Probe& p) const { return integral(p) / (to() - from()); }
  double rms(const Probe&) const;
  /// The largest value; at a jump those of both sides count.
  double max(const Probe& p) const { return extreme(p, 1); }
  double min(const Probe& p) const { return -extreme(p, -1); }
  double peak_to_peak(const Probe& p) const { return max(p) - min(p); }
  /// c_1, ..., c_count of p(t) = mean + Σ Re(c_k e^{2 pi i k (t - from)/(to - from)}).
  std::vector<std::complex<double>> harmonics(const Probe&, Index count) const;
  /// ∫ p(t) e^{-i omega (t - from)} dt.
  std::complex<double> spectrum(const Probe&, double omega) const;
  /// Times at which p passes 0, up or down, increasing; `rising`: +1, -1, or 0 for both.
  std::vector<double> crossings(const Probe&, int rising) const;
  std::vector<double> values(const Probe&, const std::vector<double>& times) const;
  /// An output at one end of the span.
  double output(Index number, double end) const { return (end == from() ? ends_.row(0) : ends_.row(1))[number]; }

 private:
  double extreme(const Probe&, double sign) const;
  RowMatrix outputs_at(const std::vector<double>& times) const;
  Vector at(const Probe&, const std::vector<double>& times) const;

  const Circuit& circuit_;
  Backend& backend_;
  const Result& result_;
  std::vector<double> edges_;
  Vector t_, weights_;         ///< of the quadrature
  RowMatrix outputs_;          ///< there
  RowMatrix ends_;             ///< at both ends of the span
  std::vector<double> looks_;  ///< both sides of the edges and the points of the quadrature
  RowMatrix outputs_looks_;
};

}  // namespace bromwich
