// Loop gains of a buck converter under voltage control, in continuous and discontinuous conduction, against two things
// that share no code with the library: a simulation of the circuit's modes, written out here, into which a small sine
// is injected; and the averaged models of Erickson and Maksimovic (Fundamentals of Power Electronics, chapters 8, 9 and
// 11).

#include "circuits/small_signal.hpp"
#include "tests/circuits/circuits.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

namespace bromwich {
namespace loop_gain_test {

using Complex = std::complex<double>;
constexpr double pi = std::numbers::pi;

/// Vin - S - L - C beside R, a diode; c' = (gain (ref - v - z) - c)/tau is compared with a ramp from 0 to 1 in each T.
struct Buck {
  double Vin = 20, L = 47e-6, C = 10e-6, R = 2, on = 1e-3, gain = 1, ref = 5, tau = 1e-3, T = 10e-6;

  std::string netlist() const {
    return fmt::format(
        "t\nVin in 0 {}\nS1 in sw pwm 0 SI\nD1 0 sw DI\nL1 sw out {}\nC1 out 0 {}\nR1 out 0 {}\nVz a out 0\nVr ref 0 "
        "{}\n"
        "E1 e 0 ref a {}\nRc e c 1k\nCc c 0 {}\nVs saw 0 PULSE(0 1 0 {} 0 0 {})\nB1 pwm 0 V={{u(V(c)-V(saw))}}\n"
        ".model SI SW(Ron={} Roff=10Meg Vt=.5)\n.model DI D(Ron={} Roff=10Meg Vfwd=0)\n.tran 1u 10u\n",
        Vin, L, C, R, ref, gain, tau / 1e3, T, T, on, on);
  }
};

/// The same, mode by mode: z = (i, v, c, injected cosine, its sine, 1), z' = G z.
class Simulation {
 public:
  using Z = Eigen::Matrix<double, 6, 1>;
  using G = Eigen::Matrix<double, 6, 6>;

  Simulation(const Buck& b, double omega, double amplitude) : b_(b) {
    for (const int mode : {closed, diode, empty}) {
      G& g = modes_[std::size_t(mode)];
      g.setZero();
      if (mode != empty) {
        g(0, 0) = -b.on / b.L, g(0, 1) = -1 / b.L;
        if (mode == closed) g(0, 5) = b.Vin / b.L;
        g(1, 0) = 1 / b.C;
      }
      g(1, 1) = -1 / (b.R * b.C);
      g(2, 1) = g(2, 3) = -b.gain / b.tau, g(2, 2) = -1 / b.tau, g(2, 5) = b.gain * b.ref / b.tau;
      g(3, 4) = -omega, g(4, 3) = omega;
    }
    z_ << 0, 0, 0, amplitude, 0, 1;
  }

  /// Periods of the ramp. Adds ∫ e^{-jwt} of v and of what is injected to `v` and `injected`, ∫ v to `mean`.
  void run(int periods, double omega) {
    v = injected = mean = 0;
    for (int k = 0; k < periods; ++k) {
      const double start = k * b_.T;
      double t = 0;
      const auto above = [&](const Z& z, double after) { return z[2] - (t + after) / b_.T; };
      const double high = z_[2] > 0 ? first(closed, b_.T, above) : 0;
      t = advance(closed, start, 0, high, omega);
      const auto current = [](const Z& z, double) { return z[0]; };
      const double falls = first(diode, b_.T - t, current);
      t = advance(diode, start, t, falls, omega);
      if (t >= b_.T) continue;
      z_[0] = 0, ++empty_periods;
      advance(empty, start, t, b_.T - t, omega);
    }
  }

  const Z& z() const { return z_; }
  Complex v = 0, injected = 0;
  double mean = 0;
  long empty_periods = 0;

 private:
  enum Mode { closed, diode, empty };

  // exp(G h) z by Taylor's series on parts of 0.5 of the norm or less.
  Z moved(Mode mode, double h, Z z) const {
    const G& g = modes_[mode];
    const int parts = 1 + int(2 * h * g.cwiseAbs().rowwise().sum().maxCoeff());
    for (int part = 0; part < parts; ++part) {
      Z term = z;
      for (int k = 1; k <= 16; ++k) z += term = (g * term * (h / parts / k)).eval();
    }
    return z;
  }

  template <class Positive>
  double first(Mode mode, double longest, const Positive& positive) const {
    if (positive(moved(mode, longest, z_), longest) > 0) return longest;
    double low = 0, high = longest;
    for (int k = 0; k < 60; ++k) {
      const double middle = (low + high) / 2;
      (positive(moved(mode, middle, z_), middle) > 0 ? low : high) = middle;
    }
    return high;
  }

  // Gauss's rule with five points on quarters.
  double advance(Mode mode, double start, double t, double length, double omega) {
    static constexpr std::array<double, 5> points{-0.9061798459386640, -0.5384693101056831, 0, 0.5384693101056831,
                                                  0.9061798459386640};
    static constexpr std::array<double, 5> weights{0.2369268850561891, 0.4786286704993665, 0.5688888888888889,
                                                   0.4786286704993665, 0.2369268850561891};
    for (int quarter = 0; quarter < 4; ++quarter)
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double after = length * (quarter + (1 + points[i]) / 2) / 4, weight = length * weights[i] / 8;
        const Z z = moved(mode, after, z_);
        const Complex turned = weight * std::polar(1.0, -omega * (start + t + after));
        v += z[1] * turned, injected += z[3] * turned, mean += z[1] * weight;
      }
    z_ = moved(mode, length, z_);
    return t + length;
  }

  const Buck b_;
  std::array<G, 3> modes_;
  Z z_;
};

struct Measured {
  Complex gain;
  double mean = 0;  ///< of V(out)
  bool empty = false;
};

/// The gain -V(out)/V(a) at f = k/(20 T), by a sine of 1 mV.
Measured injected(const Buck& b, int k) {
  constexpr int window = 20;
  const double omega = 2 * pi * k / (window * b.T);
  Simulation s(b, omega, 1e-3);
  Simulation::Z before;
  for (int rounds = 0; rounds < 1000; ++rounds) {
    before = s.z();
    s.empty_periods = 0;
    s.run(window, omega);
    if ((s.z() - before).cwiseAbs().maxCoeff() < 1e-11) break;
  }
  EXPECT_LT((s.z() - before).cwiseAbs().maxCoeff(), 1e-11) << "no periodic state";
  return {-s.v / (s.v + s.injected), s.mean / (window * b.T), s.empty_periods == window};
}

std::vector<Complex> found(const Buck& b, const std::vector<double>& frequencies) {
  const Circuit c = parse_circuit(b.netlist(), "test.cir", {}, {}, 0);
  const auto backend = make_cpu_backend(1);
  const Result r = test::periodic_state(c, *backend);
  const std::vector<Probe> probes{Probe(c, "V(out)", "test"), Probe(c, "V(a)", "test")};
  const Eigen::MatrixXcd all = small_signals(c, *backend, r, "Vz", frequencies, probes, "test");
  std::vector<Complex> gains;
  for (Index k = 0; k < all.rows(); ++k) gains.push_back(-all(k, 0) / all(k, 1));
  return gains;
}

void agrees_with_injection(const Buck& b, bool discontinuous) {
  const std::vector<int> parts{1, 3, 7, 9};  // of 5 kHz; half the frequency of the ramp is 50 kHz
  std::vector<double> f;
  for (const int k : parts) f.push_back(k / (20 * b.T));
  const std::vector<Complex> gains = found(b, f);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Measured known = injected(b, parts[i]);
    EXPECT_EQ(known.empty, discontinuous);
    EXPECT_LT(std::abs(gains[i] - known.gain), 1e-4 * std::abs(known.gain))
        << f[i] << " Hz: " << gains[i] << " against " << known.gain;
  }
}

const Buck continuous{};
const Buck discontinuous{.R = 60};

TEST(LoopGain, ContinuousAgainstAnInjectedSine) { agrees_with_injection(continuous, false); }

TEST(LoopGain, DiscontinuousAgainstAnInjectedSine) { agrees_with_injection(discontinuous, true); }

// Duty to voltage, by the averaged models: Vin / (1 + s L/R + s² L C), and a pole where the coil is empty for a while.
Complex averaged(const Buck& b, double V, bool is_discontinuous, Complex s) {
  const Complex control = b.gain / (1.0 + s * b.tau);
  if (!is_discontinuous) return control * b.Vin / (1.0 + s * b.L / b.R + s * s * b.L * b.C);
  const double M = V / b.Vin, K = 2 * b.L / (b.R * b.T), D = M * std::sqrt(K / (1 - M));
  const double gain = 2 * V / D * (1 - M) / (2 - M), pole = (2 - M) / ((1 - M) * b.R * b.C);
  return control * gain / (1.0 + s / pole);
}

// The models leave out the ripple at the comparator, and are of first order in w T.
TEST(LoopGain, AgainstAveragedModels) {
  for (const bool is_discontinuous : {false, true}) {
    const Buck& b = is_discontinuous ? discontinuous : continuous;
    const Measured known = injected(b, 1);
    ASSERT_EQ(known.empty, is_discontinuous);
    const std::vector<double> f{20, 100, 500, 2000};
    const std::vector<Complex> gains = found(b, f);
    for (std::size_t k = 0; k < f.size(); ++k) {
      const Complex s(0, 2 * pi * f[k]), model = averaged(b, known.mean, is_discontinuous, s);
      EXPECT_LT(std::abs(gains[k] - model), (0.01 + std::abs(s) * b.T) * std::abs(model))
          << f[k] << " Hz: " << gains[k] << " against " << model;
    }
  }
}

}  // namespace loop_gain_test
}  // namespace bromwich
